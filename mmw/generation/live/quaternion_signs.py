"""Give quaternions of live poses the signs that a saved stage has, over frames in which an actor is absent too."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmw.core.transforms import dot


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
        self._side = np.full((count, 1), np.nan)
        """1 where the reader's sign is that of the writer, -1 where it is not, NaN before the actor is there."""

    def write(self, turn: np.ndarray) -> np.ndarray:
        """Return the quaternions of the next row as the stage has them.

        Args:
            turn: Unit quaternions, shape [V, 4]; NaN where absent.

        Returns:
            Shape [V, 4]; the last one before where absent.
        """
        is_there, was_there = _are_there(turn), _are_there(self._written)
        before = np.where(was_there, self._written, turn)
        self._written = _beside(np.where(is_there, turn, before), before)
        return self._written

    def read(self, turn: np.ndarray, written: np.ndarray) -> np.ndarray:
        """Return the quaternions of the next row as they are read from the stage.

        Args:
            turn: Unit quaternions of the row with any sign, shape [V, 4]; NaN where absent.
            written: What `write` returned for the row, shape [V, 4].

        Returns:
            Shape [V, 4]; NaN where absent.
        """
        is_there, was_there = _are_there(turn), _are_there(self._read)
        out = _beside(turn, np.where(was_there, self._read, turn))
        side = _sides(out, written)
        is_back = is_there & ~was_there & np.isfinite(self._side)
        if is_back.any():
            wanted = np.where(is_back, self._side, side)
            out, side = np.where(side == wanted, out, -out), wanted
        self._side = np.where(is_there, side, self._side)
        self._read = out
        return out


@dataclass(frozen=True)
class SignsPart:
    """The signs of the actors of one of several episodes whose rows are made at once."""

    whole: QuaternionSigns
    """Signs of the actors of all these episodes, one episode after the other."""
    index: int
    """Place of the episode among them."""
    count: int
    """Their number."""


def joined(parts: Sequence[SignsPart]) -> QuaternionSigns:
    """Return the signs of the actors of all parts, one part after the other: the whole that they make up, if any.

    A whole goes on with all its parts alone, so that those of a part are its own until then.
    """
    whole = parts[0].whole
    if len(parts) == parts[0].count and all(
        part.whole is whole and part.index == place for place, part in enumerate(parts)
    ):
        return whole
    out = QuaternionSigns(0)
    out._written, out._read, out._side = (
        np.concatenate([np.split(getattr(part.whole, name), part.count)[part.index] for part in parts])
        for name in ("_written", "_read", "_side")
    )
    return out


def parted(whole: QuaternionSigns, count: int) -> list[SignsPart]:
    """Return the parts of some signs, of equal size."""
    return [SignsPart(whole, index, count) for index in range(count)]


def _are_there(turn: np.ndarray) -> np.ndarray:
    """Return which quaternions are there, shape [V, 1]; those of absent actors are NaN."""
    return ~np.isnan(turn[:, :1])


def _beside(turn: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Return quaternions with the signs that make their products with others positive, shape [V, 4]."""
    return np.where(dot(turn, before) < 0.0, -turn, turn)


def _sides(turn: np.ndarray, written: np.ndarray) -> np.ndarray:
    """Return 1 where the sign is that of the writer, else -1, shape [V, 1]."""
    return np.where(dot(turn, written) < 0.0, -1.0, 1.0)
