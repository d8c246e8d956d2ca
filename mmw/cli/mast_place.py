"""Find a place for the mast of a roadside unit: beside the road, with a free view (extra `author`)."""

from collections.abc import Iterable, Sequence

import numpy as np
import shapely

from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.plan_geometry import twice_areas

MAST_REACH = (60.0, 150.0)
"""A mast is looked for this far around the place, the farther ones if there is none near [m]; design values."""

MAST_STEP = 2.0
"""Distance of the places that are tried for it [m]."""

KERB = (1.0, 6.0)
"""Distance of the mast from the nearest road [m]; design values."""

WALL = 1.0
"""Distance of the mast from what is built [m]; design value."""

TRIED = 60
"""As many of the nearest places are compared by their view."""

SEEN = 80.0
"""The view is that of the lanes this far around the place [m]."""

LOW = 3.0
"""Lower things do not hide vehicles from a mast: height above the road [m]; design value."""

GROUND = ("road", "road_line", "sidewalk", "terrain")
"""Classes of surfaces that a mast can stand on, or beside."""

CARRIAGEWAY = ("road", "road_line")


def mast_place(parts: Sequence[MeshPart], graph: LaneGraph, center: np.ndarray) -> np.ndarray | None:
    """Return the foot of a mast beside the road near a place, from which most of the lanes around are in sight.

    It stands on no road, under no bridge and in no building. Buildings hide what is behind them, seen from above.

    Args:
        parts: Meshes of the world.
        graph: The lanes.
        center: The place [m], shape [3].

    Returns:
        Place at the height of the nearest lane [m], shape [3]; None if there is none within the reach.
    """
    line = np.concatenate([lane.points for lane in graph.lanes.values()])
    for reach in MAST_REACH:
        roads = _triangles(parts, CARRIAGEWAY, center, reach + KERB[1])
        built = _triangles((part for part in parts if part.label not in GROUND), None, center, reach, center[2] + LOW)
        steps = np.arange(-reach, reach + MAST_STEP, MAST_STEP)
        grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2) + np.round(center[:2])
        away = np.linalg.norm(grid - center[:2], axis=1)
        grid = grid[np.argsort(away, kind="stable")][: int((away <= reach).sum())]
        spots = shapely.points(grid)
        free = _within(roads, spots, KERB[1]) & ~_within(roads, spots, KERB[0]) & ~_within(built, spots, WALL)
        grid = grid[free][:TRIED]
        if len(grid):
            near = line[np.linalg.norm(line - center, axis=1) < SEEN]
            seen = [_seen(built, spot, near[:: max(1, len(near) // 200), :2]) for spot in grid]
            spot = grid[int(np.argmax(seen))]
            level = line[np.argmin(np.linalg.norm(line[:, :2] - spot, axis=1)), 2]
            return np.array([*spot, level])
    return None


def _triangles(
    parts: Iterable[MeshPart], labels: Sequence[str] | None, center: np.ndarray, reach: float, above: float = -np.inf
) -> shapely.STRtree:
    """Return the triangles of parts around a place in plan, those that rise above a height [m]."""
    found = [np.zeros((0, 3, 3))]
    for part in parts:
        if labels is None or part.label in labels:
            corners = np.asarray(part.points, np.float64)[np.asarray(part.faces).reshape(-1, 3)]
            low, high = corners.min(axis=1), corners.max(axis=1)
            near = (low[:, :2] < center[:2] + reach).all(axis=1) & (high[:, :2] > center[:2] - reach).all(axis=1)
            found.append(corners[near & (high[:, 2] > above)])
    corners = np.concatenate(found)[:, :, :2]
    is_flat = np.abs(twice_areas(corners)) < 1e-6  # a wall, seen from above
    outlines = shapely.linestrings(corners[is_flat][:, [0, 1, 2, 0]])
    return shapely.STRtree([*shapely.polygons(corners[~is_flat]), *outlines])


def _within(tree: shapely.STRtree, spots: np.ndarray, distance: float) -> np.ndarray:
    """Return which points are nearer to triangles than a distance [m], or inside of one, shape [N]."""
    found = np.zeros(len(spots), bool)
    found[tree.query(spots, predicate="dwithin", distance=distance)[0]] = True
    return found


def _seen(built: shapely.STRtree, spot: np.ndarray, places: np.ndarray) -> float:
    """Return the share of places [N, 2] that nothing built hides from a spot in plan."""
    if not len(places):
        return 1.0
    rays = shapely.linestrings(np.stack([np.broadcast_to(spot, places.shape), places], axis=1))
    return 1.0 - len(np.unique(built.query(rays, predicate="intersects")[0])) / len(places)
