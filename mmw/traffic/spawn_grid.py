"""Tell which spawn points are one place, and order them by distance; the same for all seeds of a town."""

from collections.abc import Iterable, Sequence
from typing import Protocol

import numpy as np

from mmw.core.remember import remembered

SAME_PLACE = 2.6
"""Points of two lanes nearer than this are one place [m]."""


class Located(Protocol):
    """A spawn point, as far as its place counts; hashable."""

    @property
    def position(self) -> tuple[float, float, float]:
        """World frame [m]."""
        ...


class SpawnGrid:
    """Spawn points of a town, and which of them are one place."""

    def __init__(self, points: Sequence[Located]) -> None:
        """Find the points near each other, among those whose x is."""
        self.position = np.array([point.position for point in points]).reshape(-1, 3)
        self.number = {point: index for index, point in enumerate(points)}
        order = np.argsort(self.position[:, 0], kind="stable")
        along = self.position[order, 0]
        ends = np.searchsorted(along, along + 1.001 * SAME_PLACE)
        self.same: list[list[int]] = [[] for _ in points]
        """Point -> the others that are the same place."""
        for place, (index, end) in enumerate(zip(order.tolist(), ends.tolist(), strict=True)):
            others = order[place + 1 : end]
            near = np.linalg.norm(self.position[others] - self.position[index], axis=1) < SAME_PLACE
            for other in others[near].tolist():
                self.same[index].append(other)
                self.same[other].append(index)

    def distance(self, center: Sequence[float]) -> np.ndarray:
        """Return the 3-D distance of every point from a center [m], shape [N]."""
        return np.linalg.norm(self.position - np.asarray(center, np.float64), axis=1)


@remembered(size=8)
def grid_of(points: Sequence[Located]) -> SpawnGrid:
    """Return the places of a town's points, which all its scenarios share."""
    return SpawnGrid(points)


@remembered(size=8)
def by_distance(points: Sequence[Located], center: tuple[float, ...]) -> list[int]:
    """Return the points by their distance to a center; ties in their order."""
    return np.argsort(grid_of(points).distance(center), kind="stable").tolist()


def places_of(grid: SpawnGrid, order: Iterable[int], count: int | None = None) -> list[int]:
    """Return the first points of an order that are not the same place as an earlier one, all or so many."""
    chosen: dict[int, None] = {}
    for index in order:
        if len(chosen) == count:
            break
        if index not in chosen and not any(other in chosen for other in grid.same[index]):
            chosen[index] = None
    return list(chosen)
