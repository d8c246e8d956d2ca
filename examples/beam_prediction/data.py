"""A cache as tensors on one device: a batch is a few gathers, so an epoch waits for no file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import torch
from torch import Tensor

from examples.beam_prediction.cache import LABELS, WINDOWS, columns_of, folder_of, read_parts, sources_of
from examples.beam_prediction.config import Experiment
from examples.beam_prediction.features import feature_arrays

Track = tuple[str, str, str]
"""Scenario, weather and agent."""


@dataclass(frozen=True, eq=False)
class Batch:
    """What the network sees of B windows."""

    beams: Tensor
    """Transmit beams of the past frames, Q where there was no path, shape [B, P], int64."""
    age: Tensor
    """Frames since the sample that each past frame holds was taken, shape [B, P], int64."""
    slot: Tensor
    """Which of the window's samples each past frame holds, shape [B, P], int64."""
    samples: Mapping[str, Tensor]
    """Sensor -> samples that windows hold, in order, the last one again where there is no more, shape
    [B, S, channels, rows, columns], uint8."""


@dataclass(frozen=True, eq=False)
class BeamData:
    """F frames of all vehicles, those of a vehicle one after another, and the windows, by their first past frame.

    A mirrored window is what would have happened in a world with left and right exchanged: beam q becomes -q, and
    samples are turned round.
    """

    track: Sequence[Track]
    """Scenario, weather and vehicle of each frame, F entries."""
    peer: Sequence[str]
    """Roadside unit of each frame, F entries."""
    frame: np.ndarray
    """Frame number, shape [F], int64."""
    beams: int
    """Size of the codebook, Q."""
    past: int
    future: int
    tx_beam: Tensor
    """Best transmit beam, -1 without any path, shape [F], int64."""
    gains: Tensor
    """Normalised gain of every transmit beam, NaN without any path, shape [F, Q], float32."""
    is_los: Tensor
    """True with a line of sight, shape [F], bool."""
    every: int
    """Frames from one sensor sample to the next."""
    age: Tensor
    """Frames since the last sensor sample, shape [F], int64."""
    samples: Mapping[str, Tensor]
    """Sensor -> all its samples, shape [N, channels, rows, columns], uint8."""
    sample_row: Mapping[str, Tensor]
    """Sensor -> sample that each frame holds, shape [F], int64."""
    modality: Mapping[str, str]
    """Sensor -> `lidar` or `camera`."""
    starts: Mapping[str, Tensor]
    """`train` and `val` -> first past frame of each window, shape [n], int64."""

    @property
    def device(self) -> torch.device:
        """Where the tensors are."""
        return self.tx_beam.device

    def batch(self, starts: Tensor, sources: Sequence[str], mirrored: Tensor | None = None) -> Batch:
        """Return what the network sees of windows.

        Args:
            starts: First past frame of each, shape [B].
            sources: Sensors.
            mirrored: True for those that are mirrored, shape [B]; None for none.
        """
        frames = starts[:, None] + torch.arange(self.past, device=self.device)
        beams = self.turned(self.tx_beam[frames], mirrored)
        age = self.age[frames]
        slots = torch.arange((self.past - 2) // self.every + 2, device=self.device)  # as many as a window can hold
        first = (slots * self.every - age[:, :1]).clamp(0, self.past - 1)
        samples = {}
        for source in sources:
            rows = self.sample_row[source][starts[:, None] + first]
            samples[source] = self.samples[source][rows]
            if mirrored is not None:
                flag = mirrored.view(-1, 1, 1, 1, 1)
                samples[source] = torch.where(flag, samples[source].flip(-1), samples[source])
        held = (frames - starts[:, None] + age[:, :1]) // self.every
        return Batch(torch.where(beams < 0, self.beams, beams), age, held, samples)

    def targets(self, starts: Tensor, mirrored: Tensor | None = None) -> Tensor:
        """Return the best transmit beams to predict, -1 without any path, shape [B, W]."""
        return self.turned(self.tx_beam[self.future_frames(starts)], mirrored)

    def target_gains(self, starts: Tensor, mirrored: Tensor | None = None) -> Tensor:
        """Return the normalised gain of every beam in the frames to predict, NaN without any path, shape [B, W, Q]."""
        gains = self.gains[self.future_frames(starts)]
        if mirrored is None:
            return gains
        return torch.where(mirrored[:, None, None], gains.roll(-1, dims=2).flip(2), gains)

    def turned(self, beams: Tensor, mirrored: Tensor | None) -> Tensor:
        """Return beams, those of mirrored windows on the other side; -1 stays. Shape [B, n]."""
        if mirrored is None:
            return beams
        return torch.where(mirrored[:, None] & (beams >= 0), (-beams) % self.beams, beams)

    def future_frames(self, starts: Tensor) -> Tensor:
        """Return the frames that are predicted, shape [B, W]."""
        return starts[:, None] + self.past + torch.arange(self.future, device=self.device)


def load_data(cache: Path, experiment: Experiment, device: torch.device) -> BeamData:
    """Return the tensors of a cache; windows that hold a sample that is not there are left out.

    Args:
        cache: Its folder.
        experiment: Which sensors are read, and how long windows are.
        device: Where they are put.

    Raises:
        ValueError: If labels, features or windows are missing.
    """
    parts = {key: table.sort_by([("agent", "ascending"), ("frame", "ascending")])
             for key, table in read_parts(cache, LABELS).items()}  # fmt: skip
    track = [(*key, agent) for key, table in parts.items() for agent in table["agent"].to_pylist()]
    peer = [agent for table in parts.values() for agent in table["peer"].to_pylist()]
    columns = {name: np.concatenate([table[name].to_numpy() for table in parts.values()])
               for name in ("frame", "tx_beam", "is_los")}  # fmt: skip
    gains = np.concatenate([_matrix(table["gains"]) for table in parts.values()])
    every = experiment.features.every_frames
    held = columns["frame"] - columns["frame"] % every
    samples, sample_row = {}, {}
    for source, modality in sources_of(experiment).items():
        arrays, place = _features(cache, source, modality, experiment)
        owners = peer if source.startswith("rsu/") else [agent for *_, agent in track]
        keys = zip(((*own[:2], owner) for own, owner in zip(track, owners, strict=True)), held.tolist(), strict=True)
        rows = [place.get(key, -1) for key in keys]
        samples[source], sample_row[source] = _to(arrays, device), _to(np.array(rows), device)
    starts = _starts(pq.read_table(cache / WINDOWS), track, columns["frame"], experiment)
    for part, rows in starts.items():
        past = rows[:, None] + np.arange(experiment.windows.past)
        whole = np.all([(row.cpu().numpy()[past] >= 0).all(axis=1) for row in sample_row.values()], axis=0)
        starts[part] = rows[np.broadcast_to(whole, len(rows))]
        if not len(starts[part]):
            raise ValueError(f"{cache}: no window of {part} has all of {', '.join(samples)}; record these sensors")
    return BeamData(
        track=track,
        peer=peer,
        frame=columns["frame"],
        beams=gains.shape[1],
        past=experiment.windows.past,
        future=experiment.windows.future,
        tx_beam=_to(columns["tx_beam"], device),
        gains=_to(gains, device),
        is_los=_to(columns["is_los"], device),
        every=every,
        age=_to(columns["frame"] % every, device),
        samples=samples,
        sample_row=sample_row,
        modality=sources_of(experiment),
        starts={part: _to(rows, device) for part, rows in starts.items()},
    )


def _features(
    cache: Path, source: str, modality: str, experiment: Experiment
) -> tuple[np.ndarray, dict[tuple[Track, int], int]]:
    """Return all samples of a sensor, and the row of the sample of each agent and frame."""
    arrays, place, count = [], {}, 0
    for key, table in read_parts(cache, folder_of(source)).items():
        arrays.append(feature_arrays(table["data"].to_pylist(), modality, experiment.features, columns_of(experiment)))
        for agent, frame in zip(table["agent"].to_pylist(), table["frame"].to_pylist(), strict=True):
            place[(*key, agent), frame] = count
            count += 1
    return np.concatenate(arrays), place


def _starts(windows: pa.Table, track: Sequence[Track], frame: np.ndarray, experiment: Experiment) -> dict:
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
