"""A cache as tensors on one device: a batch is a few gathers, so an epoch waits for no file."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import torch
from torch import Tensor

from examples.beam_prediction.cache import LABELS, WINDOWS, about_text, check_cache, read_parts, sources_of
from examples.beam_prediction.config import Experiment
from examples.beam_prediction.sensors import Owner, SensorData, load_sensor
from mmw.core.errors import InputError


@dataclass(frozen=True, eq=False)
class Batch:
    """Inputs of the network of B windows."""

    beams: Tensor
    """Transmit beams of the past frames, Q where there was no path, shape [B, P], int64."""
    age: Tensor
    """Frames since the sample at each past frame, shape [B, P], int64."""
    slot: Tensor
    """Number of the window's sample at each past frame, shape [B, P], int64."""
    samples: Mapping[str, Tensor]
    """Sensor -> samples that windows hold, in order, the last one again where there is no more, shape
    [B, S, channels, rows, columns], uint8."""
    references: Mapping[str, Tensor]
    """Sensor -> what they are compared with, shape [B, 1 or S, channels, rows, columns], uint8."""
    sample_beams: Tensor
    """Transmit beams of the frames that are the first to hold a sample, Q where there was no path, shape [B, S]."""


@dataclass(frozen=True, eq=False)
class BeamData:
    """F frames of all vehicles, those of a vehicle one after another, and the windows, by their first past frame.

    Mirrored windows are what would have happened in a world with left and right of the array exchanged, so that beam q
    becomes -q, or front and back, which a linear array does not tell apart.
    """

    track: Sequence[Owner]
    """Scenario, weather and vehicle of each frame, F entries."""
    peer: Sequence[str]
    """Roadside unit of each frame, F entries."""
    frame: np.ndarray
    """Frame number, shape [F], int64."""
    beams: int
    """Size of the codebook, Q."""
    past: int
    future: int
    every: int
    """Frames from one sensor sample to the next."""
    tx_beam: Tensor
    """Best transmit beam, -1 without any path, shape [F], int64."""
    gains: Tensor
    """Normalized gain of every transmit beam, NaN without any path, shape [F, Q], float32."""
    is_los: Tensor
    """True with a line of sight, shape [F], bool."""
    age: Tensor
    """Frames since the last sensor sample, shape [F], int64."""
    sensors: Mapping[str, SensorData]
    """role/sensor -> its samples."""
    starts: Mapping[str, Tensor]
    """`train` and `val` -> first past frame of each window, shape [n], int64."""

    @property
    def device(self) -> torch.device:
        """Device of the tensors."""
        return self.tx_beam.device

    def batch(self, starts: Tensor, sources: Sequence[str], mirrored: Tensor | None = None) -> Batch:
        """Return the inputs of the network of windows.

        Args:
            starts: First past frame of each, shape [B].
            sources: Sensors.
            mirrored: Whether left and right, and front and back, are exchanged, shape [B, 2], bool; None for no window.
        """
        frames = starts[:, None] + torch.arange(self.past, device=self.device)
        beams = self._turned(self.tx_beam[frames], mirrored)
        age = self.age[frames]
        slots = torch.arange((self.past - 2) // self.every + 2, device=self.device)  # as many as a window can hold
        first = starts[:, None] + (slots * self.every - age[:, :1]).clamp(0, self.past - 1)
        at_samples = self._turned(self.tx_beam[first], mirrored)
        found = {source: self.sensors[source].gather(first, mirrored) for source in sources}
        return Batch(
            beams=torch.where(beams < 0, self.beams, beams),
            age=age,
            slot=(frames - starts[:, None] + age[:, :1]) // self.every,
            samples={source: samples for source, (samples, _) in found.items()},
            references={source: references for source, (_, references) in found.items()},
            sample_beams=torch.where(at_samples < 0, self.beams, at_samples),
        )

    def targets(self, starts: Tensor, mirrored: Tensor | None = None) -> Tensor:
        """Return the best transmit beams to predict, -1 without any path, shape [B, W]."""
        return self._turned(self.tx_beam[self.future_frames(starts)], mirrored)

    def target_gains(self, starts: Tensor, mirrored: Tensor | None = None) -> Tensor:
        """Return the normalized gain of every beam in the frames to predict, NaN without any path, shape [B, W, Q]."""
        gains = self.gains[self.future_frames(starts)]
        if mirrored is None:
            return gains
        return torch.where(mirrored[:, :1, None], gains.roll(-1, dims=2).flip(2), gains)

    @functools.cached_property
    def angle(self) -> Tensor:
        """The best beam to a part of a beam, NaN without any path, shape [F], float32 (`beam_angles`)."""
        return beam_angles(self.tx_beam, self.gains)

    def future_frames(self, starts: Tensor) -> Tensor:
        """Return the frames that are predicted, shape [B, W]."""
        return starts[:, None] + self.past + torch.arange(self.future, device=self.device)

    def _turned(self, beams: Tensor, mirrored: Tensor | None) -> Tensor:
        """Return beams, those of windows whose left and right are exchanged on the other side; -1 stays."""
        if mirrored is None:
            return beams
        return torch.where(mirrored[:, :1] & (beams >= 0), (-beams) % self.beams, beams)


def beam_angles(beams: Tensor, gains: Tensor) -> Tensor:
    """Return the direction of the strongest path as a beam and a part of one, NaN without any path, shape [F].

    Between two beams of a DFT codebook with as many beams as antennas, a path is heard with amplitudes that are to each
    other as its distances from the other beam (sin(pi d) / (N sin(pi d / N)), N large), so one division finds it: the
    two-point interpolation of spectra (V. K. Jain et al., IEEE Trans. Instrum. Meas. 28(2), 1979, rectangular window).

    Args:
        beams: Best beams, -1 without any path, shape [F].
        gains: Normalized gain of every beam, shape [F, Q].
    """
    row, size = torch.arange(len(beams), device=beams.device), gains.shape[1]
    after, before = (gains[row, (beams + step) % size].sqrt() for step in (1, -1))
    part = torch.where(after > before, after / (1 + after), -before / (1 + before))
    return torch.where(beams >= 0, (beams + part) % size, torch.nan)


def load_data(cache: Path, experiment: Experiment, device: torch.device) -> BeamData:
    """Return the tensors of a cache; windows that hold a sample that is not there are left out.

    Args:
        cache: Its folder.
        experiment: Which sensors are read, and how long windows are.
        device: Where they are put.

    Raises:
        InputError: If labels, features or windows are missing, or were made with another configuration.
    """
    check_cache(cache, about_text(experiment))
    parts = {key: table.sort_by([("agent", "ascending"), ("frame", "ascending")])
             for key, table in read_parts(cache, LABELS).items()}  # fmt: skip
    track = [(*key, agent) for key, table in parts.items() for agent in table["agent"].to_pylist()]
    peer = [agent for table in parts.values() for agent in table["peer"].to_pylist()]
    columns = {name: np.concatenate([table[name].to_numpy() for table in parts.values()])
               for name in ("frame", "tx_beam", "is_los")}  # fmt: skip
    gains = np.concatenate([_matrix(table["gains"]) for table in parts.values()])
    every = experiment.features.every_frames
    frames = {
        "cav": track,
        "rsu": [(scenario, weather, unit) for (scenario, weather, _), unit in zip(track, peer, strict=True)],
        "frame": columns["frame"],
    }
    sensors = {
        source: load_sensor(cache, source, modality, experiment, frames, device)
        for source, modality in sources_of(experiment).items()
    }
    starts = _starts(pq.read_table(cache / WINDOWS), track, columns["frame"], experiment)
    for part, rows in starts.items():
        past = torch.from_numpy(rows[:, None] + np.arange(experiment.windows.past))
        whole = torch.ones(len(rows), dtype=torch.bool)
        for sensor in sensors.values():
            whole &= (sensor.row.cpu()[past] >= 0).all(dim=1)
        if not whole.any():
            raise InputError(f"{cache}: no window of {part} has all of {', '.join(sensors)}; record these sensors")
        starts[part] = rows[whole.numpy()]
    return BeamData(
        track=track,
        peer=peer,
        frame=columns["frame"],
        beams=gains.shape[1],
        past=experiment.windows.past,
        future=experiment.windows.future,
        every=every,
        tx_beam=_to(columns["tx_beam"], device),
        gains=_to(gains, device),
        is_los=_to(columns["is_los"], device),
        age=_to(columns["frame"] % every, device),
        sensors=sensors,
        starts={part: _to(rows, device) for part, rows in starts.items()},
    )


def _starts(windows: pa.Table, track: Sequence[Owner], frame: np.ndarray, experiment: Experiment) -> dict:
    """Return the first past frame of the windows of each part, as rows of the frames."""
    place = {key: row for row, key in enumerate(zip(track, frame.tolist(), strict=True))}
    starts: dict[str, list[int]] = {}
    for row in windows.to_pylist():
        own = row["scenario"], row["weather"], row["agent"]
        starts.setdefault(row["part"], []).append(place[own, row["now"] - experiment.windows.past + 1])
    return {part: np.array(rows) for part, rows in starts.items()}


def _matrix(column: pa.ChunkedArray) -> np.ndarray:
    """Return a column of lists of one length as rows."""
    return np.concatenate([chunk.flatten().to_numpy(zero_copy_only=False) for chunk in column.chunks]).reshape(
        len(column), -1
    )


def _to(array: np.ndarray, device: torch.device) -> Tensor:
    return torch.from_numpy(np.array(array)).to(device)
