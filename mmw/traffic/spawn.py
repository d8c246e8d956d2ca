"""Choose start positions, models and connected vehicles."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mmw.config import TrafficConfig
from mmw.core.errors import InputError
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.traffic.route import plan_length, plan_stations
from mmw.traffic.vehicle_pose import Shape

SPACING = 12.0
"""Distance between spawn points along a lane [m]."""

CLEARANCE = 8.0
"""From the bumpers of a vehicle to both ends of its lane [m]."""

GRID_HALF_LENGTH = 2.5
"""Half the length of the vehicle that the spawn points are laid out for [m]; longer ones need more room."""

START_GAP = 2.5
"""Least distance between bumpers at the start [m]."""

SAME_PLACE = 2.6
"""Points of two lanes nearer than this are one place [m]."""

CAV_MAX_HEIGHT = 2.2
"""CAVs carry their LiDAR 2.5 m above the ground, so they are lower than this where such models exist [m]."""

MODEL_WEIGHT: Mapping[str, float] = {
    "sedan": 0.30,
    "hatchback": 0.24,
    "suv": 0.20,
    "pickup": 0.10,
    "van": 0.09,
    "box_truck": 0.05,
    "city_bus": 0.02,
}
"""Share of the models in traffic; a model that is not named here has `OTHER_WEIGHT`."""

OTHER_WEIGHT = 0.1


def seeded(*key: int) -> np.random.Generator:
    """Return a generator of its own for a key."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(key)))


@dataclass(frozen=True)
class SpawnPoint:
    """A place on a lane for the middle between the axles."""

    lane: str
    station: float
    """Plan length from the lane's start [m]."""
    position: tuple[float, float, float]
    """World frame [m]."""


def spawn_points(graph: LaneGraph, usable: frozenset[str]) -> list[SpawnPoint]:
    """Return points every 12 m along the lanes outside junctions, in order of lane name and station.

    Args:
        graph: All lanes.
        usable: Names of lanes that may be used.
    """
    points: list[SpawnPoint] = []
    for name in sorted(usable):
        lane = graph.lanes[name]
        if lane.junction:
            continue
        margin = CLEARANCE + GRID_HALF_LENGTH
        for station in np.arange(margin, plan_length(lane) - margin + 1e-9, SPACING):
            points.append(SpawnPoint(name, float(station), _position(lane, float(station))))
    return points


def _position(lane: Lane, station: float) -> tuple[float, float, float]:
    along = plan_stations(lane)
    x, y, z = (float(np.interp(station, along, lane.points[:, axis])) for axis in range(3))
    return x, y, z


def nearest_points(points: Sequence[SpawnPoint], center: Sequence[float], count: int) -> list[SpawnPoint]:
    """Return the points nearest to a centre by 3-D distance, nearest first; ties by lane name and station.

    Raises:
        InputError: If there are fewer than `count` places.
    """
    position = np.array([point.position for point in points]).reshape(-1, 3)
    distance = np.linalg.norm(position - np.asarray(center, np.float64), axis=1)
    chosen: list[int] = []
    for index in np.lexsort((np.arange(len(points)), distance)):
        if len(chosen) == count:
            break
        apart = np.linalg.norm(position[chosen] - position[index], axis=1)
        if not (apart < SAME_PLACE).any():
            chosen.append(int(index))
    if len(chosen) < count:
        raise InputError(
            f"vehicle_count = {count}: the town has {len(chosen)} spawn points; ask for at most that many vehicles"
        )
    return [points[index] for index in chosen]


def connected_ranks(traffic: TrafficConfig, seed: int) -> tuple[int, ...]:
    """Return which vehicles are CAVs: their ranks by distance to the spawn centre, `cav_1` first.

    Args:
        traffic: `cav_ranks`, or how many vehicles they are drawn from.
        seed: Same seed, same vehicles.
    """
    if traffic.cav_pool is None:
        return traffic.cav_ranks
    drawn = seeded(seed, 0, 3).choice(traffic.cav_pool, len(traffic.cav_ranks), replace=False)
    return tuple(sorted(drawn.tolist()))


class Places:
    """Stretches of the lanes that are occupied at the start."""

    def __init__(self, graph: LaneGraph) -> None:
        """Start with empty lanes."""
        self.graph = graph
        self.taken: dict[str, list[tuple[float, float]]] = {}

    def span(self, point: SpawnPoint, shape: Shape) -> tuple[float, float]:
        """Return the stations of both bumpers of a vehicle at a point [m]."""
        half = 0.5 * shape.wheelbase
        return point.station - half - shape.rear, point.station + half + shape.front

    def fits(self, point: SpawnPoint, shape: Shape) -> bool:
        """Return whether a vehicle has room at a point: clear of junctions and of those that are there already."""
        rear, front = self.span(point, shape)
        slack = 0.5  # box centres may sit a little off the middle between the axles
        if rear < CLEARANCE - slack or front > plan_length(self.graph.lanes[point.lane]) - CLEARANCE + slack:
            return False
        others = self.taken.get(point.lane, [])
        return all(front + START_GAP <= low or high + START_GAP <= rear for low, high in others)

    def take(self, point: SpawnPoint, shape: Shape) -> None:
        """Mark the stretch of a vehicle as taken."""
        self.taken.setdefault(point.lane, []).append(self.span(point, shape))


def draw_models(shapes: Sequence[Shape], is_cav: bool, generator: np.random.Generator) -> list[Shape]:
    """Return the models in the order in which a vehicle tries them, drawn by weight without putting back.

    Args:
        shapes: Models to choose from.
        is_cav: Whether the vehicle carries sensors; then low models come before high ones.
        generator: Source of the draw.
    """
    weight = np.array([MODEL_WEIGHT.get(shape.name, OTHER_WEIGHT) for shape in shapes])
    order = np.argsort(-np.log(generator.random(len(shapes))) / weight, kind="stable")  # exponential races
    drawn = [shapes[index] for index in order]
    if is_cav:
        drawn.sort(key=lambda shape: shape.height > CAV_MAX_HEIGHT)
    return drawn
