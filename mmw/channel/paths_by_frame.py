"""Part the paths of several frames that were traced together, as if each frame had been traced alone."""

from collections.abc import Sequence

import numpy as np

from mmw.channel.frame_paths import unchecked_paths
from mmw.channel.path_table import SAMPLE_COLUMNS, CarrierPaths


class PathsByFrame:
    """Paths of several frames, which count 0, 1 ... in their keys, parted by frame."""

    def __init__(self, paths: CarrierPaths, numbers: Sequence[int], carriers: int) -> None:
        """Find the links and paths of every frame at once.

        Args:
            paths: Paths of the frames by `FramePaths`, whose links are in the order of the frames.
            numbers: Number of each frame in the keys of its paths.
            carriers: Number of carriers of the tables, whose rows `row` counts.
        """
        self._carrier_hz = paths.carrier_hz
        frame, keys = paths.keys["frame"], paths.keys.copy()
        links = np.searchsorted(frame, np.arange(len(numbers) + 1))
        ends = np.searchsorted(paths.link, links)
        keys["frame"] = np.asarray(numbers)[frame]
        of = frame[paths.link]
        counts = np.count_nonzero(paths.interaction, axis=1).tolist()
        self._keys, self._link = keys, paths.link - links[of]
        self._columns = {name: getattr(paths, name) for name in SAMPLE_COLUMNS}
        self._columns["row"] = paths.row - carriers * ends[of]
        self._links, self._ends = links.tolist(), ends.tolist()
        self._depths = [max(counts[a:b], default=0) for a, b in zip(self._ends[:-1], self._ends[1:], strict=True)]

    def of(self, frame: int) -> CarrierPaths:
        """Return the paths of a frame, given by its place."""
        own, depth = slice(*self._ends[frame : frame + 2]), self._depths[frame]
        columns = {name: values[own] for name, values in self._columns.items()}
        for name in ("interaction", "vertex"):
            columns[name] = columns[name][:, :depth]
        links = slice(*self._links[frame : frame + 2])
        return unchecked_paths(**columns, carrier_hz=self._carrier_hz, keys=self._keys[links], link=self._link[own])
