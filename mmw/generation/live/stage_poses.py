"""Give live poses the bits that a saved stage gives them, over frames in which an actor is absent too."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.core.packed_arrays import borrow_arrays
from mmw.core.repeated_launch import launch_again
from mmw.kernels.core.stage_poses import read_kernel, written_kernel
from mmw.usd.orient_matrices import orient_matrices, rounds_as_usd


class StagePoses:
    """Poses row by row, as `actor_poses` reads them from a stage in meters that `animate` writes them into.

    A stage turns quaternions into matrices, which costs the last bits. It has no samples where an actor is absent: USD
    interpolates between the last one before and the first one after, on the short way, as their product is positive.
    So the reader's signs, which follow neighboring frames, are those of the writer's after the gap if they were before
    it, else the opposite ones.
    """

    def __init__(self, count: int) -> None:
        """Start before the first row of `count` actors."""
        self._written = np.full((count, 4), np.nan)
        self._read = np.full((count, 4), np.nan)
        self._side = np.full(count, np.nan)
        """1 where the reader's sign is that of the writer, -1 where it is not, NaN before the actor is there."""

    def read_back(self, poses: np.ndarray, skipped: int = 0) -> np.ndarray:
        """Return the poses of the next rows as a stage has them.

        Args:
            poses: Body to world, shape [R, V, 7]; NaN where absent.
            skipped: Rows at the beginning that are written and not read, all if there are fewer.

        Returns:
            Those that are read, shape [n, V, 7]; NaN where absent.
        """
        rows, count = poses.shape[:2]
        skipped = min(skipped, rows)
        read, turns = rows - skipped, ((count,), wp.vec4d)
        block = borrow_arrays(
            "cpu", (poses.shape, wp.float64), turns, ((rows, count), wp.vec4d), ((read, count), wp.mat33d), turns,
            ((count,), wp.float64), ((read, count, 7), wp.float64), turns, ((count,), wp.float64),
        )  # fmt: skip
        given, before, written, matrices, read_before, side_before, *found = block.host
        given[...], before[...], read_before[...], side_before[...] = poses, self._written, self._read, self._side
        known, first, turned, matrix, *others = block.arrays
        is_ours = rounds_as_usd()
        launch_again(written_kernel, (count,), [known, first, skipped, is_ours, turned, matrix], "cpu")
        if not is_ours:
            matrices[...] = _matrices_by_usd(written[skipped:])
        launch_again(read_kernel, (count,), [known, turned, matrix, skipped, *others], "cpu")
        self._written = written[-1].copy()
        made, self._read, self._side = (values.copy() for values in found)
        block.release()
        return made


def _matrices_by_usd(written: np.ndarray) -> np.ndarray:
    """Return the matrices of quaternions [R, V, 4], NaN where none was written yet, as USD makes them."""
    turns = np.where(np.isnan(written), [0.0, 0.0, 0.0, 1.0], written)
    return orient_matrices(turns.reshape(-1, 4)).reshape(*written.shape[:2], 3, 3)


@dataclass(frozen=True)
class StagePosesPart:
    """The actors of one of several episodes whose rows are made at once."""

    whole: StagePoses
    """The actors of all these episodes, one episode after the other."""
    index: int
    """Place of the episode among them."""
    count: int
    """Their number."""


def joined(parts: Sequence[StagePosesPart]) -> StagePoses:
    """Return the actors of all parts, one part after the other: the whole that they make up, if any.

    A whole goes on with all its parts alone, so that the state of a part is its own until then.
    """
    whole = parts[0].whole
    if len(parts) == parts[0].count and all(
        part.whole is whole and part.index == place for place, part in enumerate(parts)
    ):
        return whole
    out = StagePoses(0)
    out._written, out._read, out._side = (
        np.concatenate([np.split(getattr(part.whole, name), part.count)[part.index] for part in parts])
        for name in ("_written", "_read", "_side")
    )
    return out


def parted(whole: StagePoses, count: int) -> list[StagePosesPart]:
    """Return the parts of a whole, of equal size."""
    return [StagePosesPart(whole, index, count) for index in range(count)]
