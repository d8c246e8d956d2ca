"""Write the first configuration of an imported world: a busy place, as many vehicles as fit, a mast beside the road."""

from collections import defaultdict
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np

from mmw.traffic.idm.open_ends import OpenNetwork
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.spawn import spawn_points
from mmw.traffic.spawn_grid import SAME_PLACE
from mmw.worlds.importers.imported_scene import ImportedScene

AROUND = 120.0
"""Spawn points up to this far from a junction count for it [m]; design value."""

MAX_VEHICLES = 20
"""Vehicles of the first configuration, where they fit."""

SHARE = 2 / 3
"""So many vehicles for a spawn point: some points are blocked, and roads full of vehicles stand; design value."""

MAX_CAVS = 3


@dataclass(frozen=True)
class FirstScenario:
    """Values of a scenario's `traffic` and `rsus`."""

    center: tuple[float, float, float]
    """Of the busiest junction [m]."""
    vehicles: int
    cavs: int
    mast: tuple[float, float, float] | None
    """Foot of the roadside unit [m]; None if there is no place for one, or the extra `author` is not installed."""
    yaw: float
    """Its direction, to the center [deg]."""

    def entry(self, name: str, town: str) -> dict[str, Any]:
        """Return the entry of `scenarios` in a configuration.

        Args:
            name: Name of the scenario.
            town: Path of the town.
        """
        traffic = {
            "vehicle_count": self.vehicles,
            "spawn_center_m": list(self.center),
            "cav_ranks": list(range(self.cavs)),
        }
        if self.mast is None:
            return {"name": name, "town": town, "traffic": traffic}
        unit = {"name": "rsu_1", "position_m": list(self.mast), "yaw_deg": self.yaw}
        return {"name": name, "town": town, "traffic": traffic, "rsus": [unit]}


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
    count = int(min(MAX_VEHICLES, max(1, SHARE * max(near, min(len(places), MAX_VEHICLES)))))
    mast = None
    if find_spec("shapely"):  # of the extra `author`
        from mmw.cli.mast_place import mast_place

        mast = mast_place(scene.parts, graph, center)
    ahead = (center - mast)[:2] if mast is not None else np.array([1.0, 0.0])
    yaw = float(np.degrees(np.arctan2(ahead[1], ahead[0])))
    foot = None if mast is None else _rounded(mast)
    return FirstScenario(_rounded(center), count, min(MAX_CAVS, (count + 1) // 2), foot, round(yaw))


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

    More than `MAX_VEHICLES` points count as this many. Without junctions it is the spawn point nearest to the middle.

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
        rank = min(near, MAX_VEHICLES), len(inside[name])
        if near and rank > best:
            best, found = rank, middle
    return found
