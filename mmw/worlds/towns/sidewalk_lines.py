"""Draw the lines that pedestrians follow: along the sidewalks, around every block, past obstacles."""

from collections.abc import Sequence

import numpy as np
import shapely

from mmw.traffic.roads.sidewalk_prims import Sidewalk
from mmw.worlds.towns.ground_height import Ground
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.plan_geometry import at_stations, row_stations

STEP = 0.5
"""Spacing of the points of a walk line [m]."""

KERB_ROOM = 0.45
"""Least distance of a walk line from the kerb, and from the outer edge of the sidewalk [m]: half a person."""

BODY_ROOM = 0.42
"""Least distance of a walk line from any obstacle on the sidewalk [m]: half a person and a hand's breadth."""

SIDESTEP = 0.5
"""Largest lateral shift per meter [-]."""

HEADROOM = 2.1
"""Parts higher above the ground than this are no obstacles [m]."""

MIN_LENGTH = 15.0
"""Walk lines shorter than this are left out [m]."""


def sidewalk_lines(tables: Sequence[np.ndarray], obstacles: Sequence[shapely.Geometry]) -> list[Sidewalk]:
    """Return walk lines along the sidewalks.

    Each line follows the middle of its sidewalk and passes obstacles. Where there is no room, and where there
    is no sidewalk, it breaks off.
    """
    tree = shapely.STRtree(list(obstacles))
    sidewalks: list[Sidewalk] = []
    for table in tables:
        inner, outer = _resample(table[:, 2], table[:, 3])
        lateral = _lateral(inner, outer, tree)
        points = inner + lateral[:, None] * (outer - inner)
        free = np.isfinite(lateral)
        is_closed = bool(free.all())
        for run in [np.arange(len(free))] if is_closed else _runs(free):
            if STEP * len(run) >= MIN_LENGTH:
                number = len(sidewalks)
                way = points[run] if number % 2 == 0 else points[run[::-1]]  # every second line runs the other way
                sidewalks.append(Sidewalk(f"walk_{number:03d}", way, is_closed))
    return sidewalks


def obstacle_plans(parts: Sequence[MeshPart], ground: Ground) -> list[shapely.Geometry]:
    """Return the plans of the obstacles for people: parts below `HEADROOM` above the ground."""
    plans = []
    for part in parts:
        low = part.points[part.points[:, 2] < ground.height(part.points[:, 0], part.points[:, 1]) + HEADROOM]
        if len(low):
            plans.append(shapely.convex_hull(shapely.MultiPoint(low[:, :2])))
    return plans


def _resample(inner: np.ndarray, outer: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return both edges of a closed sidewalk with rows `STEP` apart along its middle."""
    inner, outer = np.concatenate([inner, inner[:1]]), np.concatenate([outer, outer[:1]])
    middle = 0.5 * (inner + outer)
    along = row_stations(middle[:, :2])
    count = max(3, int(along[-1] / STEP))
    station = along[-1] * np.arange(count) / count
    return at_stations(station, along, inner), at_stations(station, along, outer)


def _lateral(inner: np.ndarray, outer: np.ndarray, obstacles: shapely.STRtree) -> np.ndarray:
    """Return where across the sidewalk the line runs at every row, 0 inner to 1 outer edge, NaN where it cannot."""
    width = np.linalg.norm(outer - inner, axis=1)
    offsets = np.linspace(0.0, 1.0, 21)
    spots = inner[:, None, :2] + offsets[None, :, None] * (outer - inner)[:, None, :2]
    room = np.minimum(offsets, 1.0 - offsets) * width[:, None]
    free = room >= KERB_ROOM
    points = np.array(shapely.points(spots.reshape(-1, 2)))
    blocked = np.unique(obstacles.query(points, predicate="dwithin", distance=BODY_ROOM)[0])
    free.reshape(-1)[blocked] = False
    # The cheapest path through the free cells: distance from the middle costs, and so does a lateral shift.
    reach = np.clip(np.floor(SIDESTEP * STEP / np.maximum(width, 1e-6) * 20), 1, 20).astype(int)
    return _cheapest(free, (offsets - 0.5) ** 2, int(np.median(reach)))


def _cheapest(free: np.ndarray, cost: np.ndarray, reach: int) -> np.ndarray:
    """Return the cheapest column of every row, at most `reach` columns from row to row, in stretches of free rows.

    Dynamic programming over the rows; on a closed line the first row is repeated at its end, pinned to its own choice.

    Returns:
        Position of the chosen column, 0 to 1, shape [N]; NaN in rows that have no free cell to go to.
    """
    rows, columns = free.shape
    lateral = np.full(rows, np.nan)
    clear = free.sum(axis=1)  # begin where most of this row and of those four rows away is free
    start = int(np.argmax(np.minimum(clear, np.minimum(np.roll(clear, 4), np.roll(clear, -4)))))
    order = (np.arange(rows) + start) % rows
    moves = 0.02 * np.arange(-reach, reach + 1) ** 2
    total = np.full((rows, columns), np.inf)
    came = np.zeros((rows, columns), dtype=int)
    first = 0
    for k in range(rows + 1):
        row = order[k] if k < rows else -1
        if k < rows:
            here = np.where(free[row], cost, np.inf)
            if k > first:
                padded = np.pad(total[k - 1], reach, constant_values=np.inf)
                options = np.stack([padded[j : j + columns] + moves[j] for j in range(2 * reach + 1)])
                best = options.argmin(axis=0)
                here = here + options[best, np.arange(columns)]
                came[k] = np.arange(columns) + best - reach
            if np.isfinite(here).any():
                total[k] = here
                continue
        if k > first:
            column = int(np.argmin(total[k - 1]))
            for back in range(k - 1, first - 1, -1):
                lateral[order[back]] = column / (columns - 1)
                column = came[back][column]
        first = k + 1
        if k < rows and free[row].any():  # cut off from the row before, a new stretch begins here
            total[k], first = np.where(free[row], cost, np.inf), k
    return lateral


def _runs(free: np.ndarray) -> list[np.ndarray]:
    """Return the stretches of True of a closed row, which is not all True, as index arrays, in order."""
    order = np.roll(np.arange(len(free)), -int(np.argmin(free)))  # from a gap on
    return [run for run in np.split(order, np.flatnonzero(np.diff(free[order])) + 1) if free[run[0]]]
