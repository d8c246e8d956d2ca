"""Give quaternions of live poses the signs that a saved stage has, over frames in which an actor is absent too."""

from collections.abc import Sequence

import numpy as np

from mmw.core.transforms import continuous


class QuaternionSigns:
    """Signs row by row, as `animate` writes them into a stage and as `actor_poses` reads them from it.

    A stage has no samples where an actor is absent: USD interpolates between the last one before and the first one
    after, on the short way, as their product is positive. So the reader's signs, which follow neighboring frames, are
    those of the writer's after the gap if they were before it, else the opposite ones.
    """

    def __init__(self, count: int) -> None:
        """Start before the first row of `count` actors."""
        self._written = np.full((count, 4), np.nan)
        self._read = np.full((count, 4), np.nan)
        self._side = np.full(count, np.nan)
        """1 where the reader's sign is that of the writer, -1 where it is not, NaN before the actor is there."""

    @staticmethod
    def joined(parts: Sequence["QuaternionSigns"]) -> "QuaternionSigns":
        """Return the signs of the actors of all parts, one part after the other."""
        out = QuaternionSigns(0)
        out._written = np.concatenate([part._written for part in parts])
        out._read = np.concatenate([part._read for part in parts])
        out._side = np.concatenate([part._side for part in parts])
        return out

    def parts(self, count: int) -> list["QuaternionSigns"]:
        """Return the signs of `count` parts of equal size that were joined."""
        out = []
        for written, read, side in zip(
            *(np.split(values, count) for values in (self._written, self._read, self._side)), strict=True
        ):
            part = QuaternionSigns(0)
            part._written, part._read, part._side = written.copy(), read.copy(), side.copy()
            out.append(part)
        return out

    def write(self, turn: np.ndarray) -> np.ndarray:
        """Return the quaternions of the next row as the stage has them.

        Args:
            turn: Unit quaternions, shape [V, 4]; NaN where absent.

        Returns:
            Shape [V, 4]; the last one before where absent.
        """
        is_there, was_there = (np.isfinite(rows).all(axis=1, keepdims=True) for rows in (turn, self._written))
        before = np.where(was_there, self._written, turn)
        self._written = continuous(np.stack([before, np.where(is_there, turn, before)]))[1]
        return self._written

    def read(self, turn: np.ndarray, written: np.ndarray) -> np.ndarray:
        """Return the quaternions of the next row as they are read from the stage.

        Args:
            turn: Unit quaternions of the row with any sign, shape [V, 4]; NaN where absent.
            written: What `write` returned for the row, shape [V, 4].

        Returns:
            Shape [V, 4]; NaN where absent.
        """
        is_there, was_there = (np.asarray(np.isfinite(rows).all(axis=1)) for rows in (turn, self._read))
        out = continuous(np.stack([np.where(was_there[:, None], self._read, turn), turn]))[1]
        is_back = is_there & ~was_there & np.isfinite(self._side)
        wanted = np.where(is_back, self._side, _sides(out, written))
        out[_sides(out, written) != wanted] *= -1.0
        self._side = np.where(is_there, wanted, self._side)
        self._read = out
        return out


def _sides(turn: np.ndarray, written: np.ndarray) -> np.ndarray:
    """Return 1 where the sign is that of the writer, else -1, shape [V]."""
    return np.where(np.sum(turn * written, axis=1) < 0.0, -1.0, 1.0)
