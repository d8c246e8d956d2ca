"""Write the first configuration of an imported world: a busy place, as many vehicles as fit, a mast beside the road."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from mmw.traffic.idm.open_ends import OpenNetwork
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.spawn import SAME_PLACE, spawn_points
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.plan_geometry import twice_areas

AROUND = 120.0
"""Spawn points up to this far from a junction count for it [m]; design value."""

MOST_VEHICLES = 20
"""Vehicles of the first configuration, where they fit."""

SHARE = 2 / 3
"""So many vehicles for a spawn point: some points are blocked, and roads full of vehicles stand; design value."""

MOST_CAVS = 3

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
"""What does not rise this far above the road does not hide vehicles from a mast [m]."""

GROUND = ("road", "road_line", "sidewalk", "terrain")
"""Classes of surfaces that a mast can stand on, or beside."""

CARRIAGEWAY = ("road", "road_line")


@dataclass(frozen=True)
class FirstScenario:
    """Values of a scenario's `traffic` and `rsus`."""

    center: tuple[float, float, float]
    """Of the busiest junction [m]."""
    vehicles: int
    cavs: int
    mast: tuple[float, float, float] | None
    """Foot of the roadside unit [m]; None if there is no place for one."""
    yaw: float
    """Its direction, to the center [deg]."""


def first_scenario(scene: ImportedScene) -> FirstScenario | None:
    """Return values that a scenario of a world with lanes can start with, None if no vehicle has a place on them."""
    graph = scene.lanes
    if graph is None:
        return None
    points = spawn_points(graph, OpenNetwork(graph).usable)
    places = _distinct(np.array([point.position for point in points]).reshape(-1, 3))
    if not len(places):
        return None
    center = busiest_place(graph, places)
    near = (np.linalg.norm(places - center, axis=1) < AROUND).sum()
    count = int(min(MOST_VEHICLES, max(1, SHARE * max(near, min(len(places), MOST_VEHICLES)))))
    mast = mast_place(scene.parts, graph, center)
    ahead = (center - mast)[:2] if mast is not None else np.array([1.0, 0.0])
    yaw = float(np.degrees(np.arctan2(ahead[1], ahead[0])))
    foot = None if mast is None else _rounded(mast)
    return FirstScenario(_rounded(center), count, min(MOST_CAVS, (count + 1) // 2), foot, round(yaw))


def _rounded(point: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 1) + 0.0 for value in point)
    return x, y, z


def _distinct(places: np.ndarray) -> np.ndarray:
    """Return places [N, 3] without those at which a vehicle of another one stands."""
    kept: list[int] = []
    for index in range(len(places)):
        if not (np.linalg.norm(places[kept] - places[index], axis=1) < SAME_PLACE).any():
            kept.append(index)
    return places[kept]


def busiest_place(graph: LaneGraph, places: np.ndarray) -> np.ndarray:
    """Return the middle of the junction with the most spawn points around it, and of equal ones the most lanes.

    More than `MOST_VEHICLES` points count as this many. Without junctions it is the spawn point nearest to the middle.

    Args:
        graph: The lanes.
        places: Spawn points [m], shape [N, 3].
    """
    inside: dict[str, list[np.ndarray]] = defaultdict(list)
    for lane in graph.lanes.values():
        if lane.junction:
            inside[lane.junction].append(lane.points)
    best, found = (-1, -1), places[np.argmin(np.linalg.norm(places - places.mean(axis=0), axis=1))]
    for name in sorted(inside):
        middle = np.concatenate(inside[name]).mean(axis=0)
        near = int((np.linalg.norm(places - middle, axis=1) < AROUND).sum())
        rank = min(near, MOST_VEHICLES), len(inside[name])
        if near and rank > best:
            best, found = rank, middle
    return found


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
