"""Tracks, the frames of one agent in one scenario and weather, and the latest sample at each of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from mmw.core.errors import InputError

if TYPE_CHECKING:
    from mmw.dataset import Dataset


@dataclass(frozen=True, eq=False)
class Track:
    """One agent in one scenario and weather."""

    scenario: str
    weather: str
    agent: str
    role: str
    """`cav` or `rsu`."""
    frames: np.ndarray
    """Frames in which it is there, growing, shape [F], int64."""

    @property
    def name(self) -> tuple[str, str, str]:
        """Scenario, weather and agent."""
        return self.scenario, self.weather, self.agent

    @cached_property
    def first(self) -> int:
        """Its first frame."""
        return int(self.frames[0])

    @property
    def runs(self) -> np.ndarray:
        """Number of the unbroken run of frames that each frame from the first to the last is in, -1 for a missing
        frame, shape [last - first + 1], int64."""
        found = np.full(int(self.frames[-1]) - self.first + 1, -1, dtype=np.int64)
        found[self.frames - self.first] = np.cumsum(np.diff(self.frames, prepend=self.first) > 1)
        return found

    @property
    def longest_run(self) -> int:
        """Frames in its longest unbroken run."""
        runs = self.runs
        return int(np.bincount(runs[runs >= 0]).max())


@dataclass(frozen=True, eq=False)
class LatestSamples:
    """Sample of each frame of a track: the latest one at or before it."""

    row: np.ndarray
    """Row of the sample, -1 for none, shape [last - first + 1], int64."""
    frame: np.ndarray
    """Frame of the sample, -1 for none, same shape, int64."""


def find_latest(track: Track, frames: np.ndarray, rows: np.ndarray, max_age: int) -> LatestSamples:
    """Return the sample of each frame of a track: the latest one at or before it in the same unbroken run of frames.

    Args:
        track: The track.
        frames: Frames of the samples, growing, shape [n].
        rows: Their rows, shape [n].
        max_age: Frames that a sample may be older than the frame.
    """
    runs = track.runs
    wanted = np.arange(len(runs)) + track.first
    if not len(frames):
        return LatestSamples(np.full(len(runs), -1, dtype=np.int64), np.full(len(runs), -1, dtype=np.int64))
    place = np.searchsorted(frames, wanted, side="right") - 1
    own = frames[np.maximum(place, 0)]
    is_there = (place >= 0) & (wanted - own <= max_age) & (runs >= 0) & (own >= track.first)
    is_there &= runs[np.clip(own - track.first, 0, len(runs) - 1)] == runs
    return LatestSamples(np.where(is_there, rows[np.maximum(place, 0)], -1), np.where(is_there, own, -1))


def find_tracks(dataset: "Dataset") -> list[Track]:
    """Return the tracks of a dataset, by scenario, weather and agent.

    Raises:
        InputError: If there is no table `poses`, or an agent has two poses in a frame.
    """
    rows = dataset.read("poses", columns=["scenario", "weather", "frame", "agent", "role"])
    frames, roles = rows.column("frame").to_numpy(), rows.column("role").cast(pa.string()).to_pylist()
    found = []
    for (scenario, weather, agent), some in groups(rows, ("scenario", "weather", "agent")).items():
        own = np.sort(frames[some].astype(np.int64))
        if (np.diff(own) == 0).any():
            raise InputError(f"{dataset.root}: poses of {scenario} {weather} {agent} repeat a frame; run mmw verify")
        found.append(Track(scenario, weather, agent, roles[some[0]], own))
    return sorted(found, key=lambda track: track.name)


def groups(table: pa.Table, names: Sequence[str]) -> dict[tuple[str, ...], np.ndarray]:
    """Return the row numbers of every combination of values of name columns, in the order of the table."""
    codes, values = np.zeros(table.num_rows, dtype=np.int64), []
    for name in names:
        encoded = table.column(name).cast(pa.string()).combine_chunks().dictionary_encode()
        if isinstance(encoded, pa.ChunkedArray):
            encoded = encoded.combine_chunks()
        values.append(encoded.dictionary.to_pylist())
        codes = codes * max(len(values[-1]), 1) + encoded.indices.to_numpy(zero_copy_only=False)
    order = np.argsort(codes, kind="stable")
    starts = np.flatnonzero(np.diff(codes[order], prepend=-1))
    found = {}
    for some in np.split(order, starts[1:]) if len(order) else []:
        code, key = int(codes[some[0]]), []
        for known in reversed(values):
            code, index = divmod(code, len(known))
            key.insert(0, known[index])
        found[tuple(key)] = some
    return found
