"""One sensor's samples as tensors: the sample of each frame, its reference, and mirrored worlds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from examples.beam_prediction.cache import columns_of, folder_of, read_parts
from examples.beam_prediction.config import Experiment
from examples.beam_prediction.features import feature_arrays

Owner = tuple[str, str, str]
"""Scenario, weather and agent."""


@dataclass(frozen=True, eq=False)
class SensorData:
    """All samples of one sensor of one role, N of them, for F frames of vehicles."""

    is_in_array: bool
    """True for a roadside unit: its columns are beams of the transmitter."""
    modality: str
    """`lidar` or `camera`."""
    samples: Tensor
    """Shape [N, channels, rows, columns], uint8."""
    row: Tensor
    """Sample that each frame holds, -1 for none, shape [F], int64."""
    usual: Tensor
    """Median of all samples of each agent, which is what a unit that stands there for long knows; of vehicles it is
    not used. Shape [agents, channels, rows, columns], uint8."""
    agent: Tensor
    """Agent of each sample, shape [N], int64."""

    def gather(self, frames: Tensor, mirrored: Tensor | None) -> tuple[Tensor, Tensor]:
        """Return the samples of frames, and their references.

        A sample of the roadside unit is compared with what it usually sees, one of a vehicle with the one before.

        Args:
            frames: Shape [B, S], in the order of time.
            mirrored: Whether left and right, and front and back of the transmitter's array, are exchanged, shape
                [B, 2], bool; None for no window.

        Returns:
            Two arrays of shape [B, S, channels, rows, columns] and [B, 1 or S, ...], uint8.
        """
        rows = self.row[frames]
        found = self.samples[rows]
        if self.is_in_array:
            reference = self.usual[self.agent[rows[:, :1]]]
        else:
            reference = torch.cat([found[:, :1], found[:, :-1]], dim=1)
        return self._mirror(found, mirrored), self._mirror(reference, mirrored)

    def _mirror(self, samples: Tensor, mirrored: Tensor | None) -> Tensor:
        """Return samples of mirrored worlds.

        A mirrored vehicle still drives forwards: at whichever plane the world is mirrored, its left becomes its right.
        """
        if mirrored is None:
            return samples
        left, front = mirrored.view(-1, 2, 1, 1, 1, 1).unbind(1)
        samples = torch.where(left if self.is_in_array else left ^ front, samples.flip(-1), samples)
        if not self.is_in_array:
            return samples
        return torch.where(front, samples.roll(samples.shape[-2] // 2, dims=-2), samples)


def load_sensor(
    cache: Path,
    source: str,
    modality: str,
    experiment: Experiment,
    frames: Mapping[str, Sequence[Owner] | np.ndarray],
    device: torch.device,
) -> SensorData:
    """Return one sensor of a cache.

    Args:
        cache: Its folder.
        source: role/sensor.
        modality: `lidar` or `camera`.
        experiment: Sizes of features, and how often they are there.
        frames: `cav` and `rsu`: vehicle and roadside unit of each frame, F entries; `frame`: its number, shape [F].
        device: Where it is put.

    Raises:
        InputError: If the cache does not have it.
    """
    arrays: list[np.ndarray] = []
    place: dict[tuple[Owner, int], int] = {}
    for key, table in read_parts(cache, folder_of(source)).items():
        arrays.append(feature_arrays(table["data"].to_pylist(), modality, experiment.features, columns_of(experiment)))
        for agent, frame in zip(table["agent"].to_pylist(), table["frame"].to_pylist(), strict=True):
            place[(*key, agent), frame] = len(place)
    role = source.split("/")[0]
    held = np.asarray(frames["frame"]) // experiment.features.every_frames * experiment.features.every_frames
    row = [place.get(key, -1) for key in zip(frames[role], held.tolist(), strict=True)]
    owners = {owner: number for number, owner in enumerate(dict.fromkeys(owner for owner, _ in place))}
    agent = torch.tensor([owners[owner] for owner, _ in place])
    samples = torch.from_numpy(np.concatenate(arrays)).to(device)
    usual = [samples[(agent == number).to(device)].median(dim=0).values for number in owners.values()]
    return SensorData(
        role == "rsu", modality, samples, torch.tensor(row, device=device), torch.stack(usual), agent.to(device)
    )
