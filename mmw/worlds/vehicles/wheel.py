"""One wheel: a tyre with round shoulders, and a dished rim with spokes before a dark brake."""

import numpy as np

from mmw.core.errors import InputError
from mmw.worlds.vehicles.primitives import Shape, quads, weld

SEGMENTS = 30
"""Facets around the axis of every shipped wheel; design value."""


def wheel(radius: float, width: float, rim: float, spokes: int) -> Shape:
    """Return one wheel about the y axis, outer side at +y, centered on the origin.

    Args:
        radius: Tyre radius [m]; a vertex lies exactly at the lowest point.
        width: Tyre width [m].
        rim: Rim radius [m].
        spokes: Number of spokes; it divides `SEGMENTS` into parts of at least two facets.

    Returns:
        A closed shape with parts `rubber`, `rims` and `trim` (behind the spokes, and the inner side).

    Raises:
        InputError: If the spokes do not divide the facets.
    """
    if SEGMENTS % spokes or 2 * spokes > SEGMENTS:
        raise InputError(
            f"wheel: {spokes} spokes on {SEGMENTS} segments; needed is a multiple of 2 or more; change one"
        )
    half, wall = width / 2, radius - rim
    # (radius, y, depth between the spokes) from the hub's outer center over the tread to the inner center.
    profile = [
        (0.0, half - 0.028, 0.0), (0.24 * rim, half - 0.034, 0.0), (0.30 * rim, half - 0.042, 0.07),
        (0.86 * rim, half - 0.020, 0.07), (0.90 * rim, half - 0.014, 0.0), (rim, half - 0.016, 0.0),
        (rim + 0.4 * wall, half, 0.0), (rim + 0.8 * wall, half - 0.1 * wall, 0.0), (radius, half - 0.35 * wall, 0.0),
        (radius, -half + 0.35 * wall, 0.0), (rim + 0.5 * wall, -half, 0.0), (0.0, -half + 0.01, 0.0),
    ]  # fmt: skip
    per_spoke = SEGMENTS // spokes
    angle = 2 * np.pi * np.arange(SEGMENTS + 1) / SEGMENTS - np.pi / 2
    angle[-1] = angle[0]
    is_gap = np.arange(SEGMENTS + 1) % per_spoke >= (per_spoke + 1) // 2
    ring, y, depth = (np.array(column) for column in zip(*profile, strict=True))
    grid = np.empty((SEGMENTS + 1, len(profile), 3))
    grid[..., 0] = np.cos(angle)[:, None] * ring
    grid[..., 1] = y - np.where(is_gap[:, None], depth, 0.0)
    grid[..., 2] = np.sin(angle)[:, None] * ring

    def part(a: int, b: int) -> str:
        if 5 <= b <= 9:
            return "rubber"
        is_open = 1 <= b <= 3 and is_gap[a] and is_gap[a + 1]
        return "trim" if b == 10 or is_open else "rims"

    return weld(quads(grid, part))
