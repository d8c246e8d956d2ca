"""Raised medians: a kerbed island between the two directions of a road, closed at both ends."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from mmw.worlds.towns.strip_mesh import Surface, quads

KERB = "curb"
"""Material of the kerb stones."""


def add_island(
    surface: Surface,
    material: str,
    tops: Sequence[np.ndarray],
    feet: Sequence[np.ndarray],
    is_end: tuple[bool, bool],
) -> None:
    """Add the kerbs and the top of a raised median along some rows of a road.

    Args:
        surface: Takes the faces.
        material: Material of the top.
        tops: Of every row, the borders of the island's top from right to left [m], each [4, 3].
        feet: Of every row, the vertices at the foot of the right and of the left kerb, each [2].
        is_end: Whether the island begins at the first row, and whether it ends at the last.
    """
    index = [surface.add_points(points) for points in tops]
    rows = [np.concatenate([foot[:1], top, foot[1:]]) for foot, top in zip(feet, index, strict=True)]
    for lower, upper in pairwise(rows):
        cells = quads(lower, upper).reshape(-1, 2, 3)
        surface.add_faces(KERB, cells[[0, 1, 3, 4]])
        surface.add_faces(material, cells[2])
    for row, ends in ((0, is_end[0]), (-1, is_end[1])):
        if ends and rows:
            fan = _fan(rows[row])
            surface.add_faces(KERB, fan if row == 0 else fan[:, ::-1])


def _fan(row: np.ndarray) -> np.ndarray:
    """Return the triangles of a section through the island that look against the road, shape [4, 3].

    The first and the last vertex are the feet; the outer ones of the top are straight above them.
    """
    right, left, top = row[0], row[-1], row[1:-1]
    fan = [(left, top[k], top[k + 1]) for k in range(len(top) - 1)]
    return np.array([(left, right, top[0]), *fan], dtype=np.int64)
