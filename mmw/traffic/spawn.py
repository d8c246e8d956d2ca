"""Choose start positions, drivers, models, paints and connected vehicles: what all engines draw alike."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from mmw.config import TrafficConfig
from mmw.core.errors import InputError
from mmw.traffic.demand import TrafficDemand
from mmw.traffic.polyline import sample_polyline
from mmw.traffic.roads.lane_graph import LaneGraph
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

DRIVER_FACTOR = (0.85, 1.0)
"""Range of the drivers' share of the speed limit."""

DRIVER_HEADWAY = (1.0, 1.5)
"""Range of the drivers' time gap [s]."""

RUN_OUT = 80.0
"""Routes go on this far beyond what the fastest vehicle can cover, so that no vehicle brakes for their end [m]."""

SETTLE_S = 1.5
"""Simulated before the warm-up and after the last frame, as support of the filters in time [s]."""

Route = TypeVar("Route")


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

    def bumpers(self, shape: Shape) -> tuple[float, float]:
        """Return the stations of the rear and the front bumper of a vehicle that stands here [m]."""
        half = 0.5 * shape.wheelbase
        return self.station - half - shape.rear, self.station + half + shape.front


def spawn_points(graph: LaneGraph, usable: frozenset[str]) -> list[SpawnPoint]:
    """Return points every 12 m along the usable lanes outside junctions, in order of lane name and station."""
    points: list[SpawnPoint] = []
    margin = CLEARANCE + GRID_HALF_LENGTH
    for lane in (graph.lanes[name] for name in sorted(usable)):
        if not lane.junction:
            stations = np.arange(margin, lane.plan_length - margin + 1e-9, SPACING)
            places = sample_polyline(lane.points, lane.plan_station, stations)
            points += map(SpawnPoint, [lane.name] * len(stations), stations.tolist(), map(tuple, places.tolist()))
    return points


def nearest_points(points: Sequence[SpawnPoint], center: Sequence[float], count: int) -> list[SpawnPoint]:
    """Return the points nearest to a center by 3-D distance, nearest first; ties by lane name and station.

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
        raise InputError(f"vehicle_count = {count}: the town has {len(chosen)} spawn points; give at most that many")
    return [points[index] for index in chosen]


def drawn_points(points: Sequence[SpawnPoint], demand: TrafficDemand, radius: float) -> list[SpawnPoint]:
    """Return points drawn by seed from those within a 3-D distance of the spawn center, nearest first.

    Raises:
        InputError: If there are fewer places than vehicles.
    """
    traffic, count = demand.traffic, demand.traffic.vehicle_count
    position = np.array([point.position for point in points]).reshape(-1, 3)
    distance = np.linalg.norm(position - np.asarray(traffic.spawn_center_m, np.float64), axis=1)
    chosen: list[int] = []
    for index in seeded(demand.seed, 0, 4).permutation(np.flatnonzero(distance <= radius)):
        if len(chosen) == count:
            break
        if not (np.linalg.norm(position[chosen] - position[index], axis=1) < SAME_PLACE).any():
            chosen.append(int(index))
    if len(chosen) < count:
        raise InputError(
            f"vehicle_count = {count}: there are {len(chosen)} spawn points within vary.spawn.radius_m = {radius:g} of "
            "`spawn_center_m`; give fewer vehicles, or a larger radius"
        )
    return [points[index] for index in sorted(chosen, key=lambda index: (distance[index], index))]


def connected_ranks(traffic: TrafficConfig, seed: int, *, is_drawn: bool = False) -> tuple[int, ...]:
    """Return which vehicles are CAVs: their ranks by distance to the spawn center, `cav_1` first.

    They are those of `cav_ranks`, or as many drawn by seed, from `cav_pool` or, if `is_drawn`, from all.
    """
    pool = traffic.cav_pool or (traffic.vehicle_count if is_drawn else None)
    if pool is None:
        return traffic.cav_ranks
    drawn = seeded(seed, 0, 3).choice(pool, len(traffic.cav_ranks), replace=False)
    return tuple(sorted(drawn.tolist()))


def vehicle_order(cav_ranks: Sequence[int], count: int) -> list[int]:
    """Return the ranks of all vehicles, CAVs first."""
    return [*cav_ranks, *(rank for rank in range(count) if rank not in set(cav_ranks))]


def name_vehicle(position: int, cav_count: int) -> tuple[str, str]:
    """Return name and role of a vehicle by its position in the list: `cav_1`, `cav_2`..., then `veh_001`..."""
    if position < cav_count:
        return f"cav_{position + 1}", "cav"
    return f"veh_{position - cav_count + 1:03d}", "vehicle"


@dataclass(frozen=True)
class Start:
    """A vehicle before it has a model and a route."""

    rank: int
    """By distance to the spawn center."""
    point: SpawnPoint
    is_cav: bool
    factor: float
    """The driver's share of the speed limit."""
    headway: float
    """The driver's time gap [s]."""
    generator: np.random.Generator
    """Draws the model, then the paint."""
    model: str | None = None
    """Model that the configuration gives it."""


def draw_starts(demand: TrafficDemand, usable: frozenset[str]) -> list[Start]:
    """Return the vehicles of a scenario and their drivers, by distance to the spawn center, on usable lanes.

    Raises:
        InputError: If the town has too few places.
    """
    traffic, starts = demand.traffic, []
    cav_ranks = connected_ranks(traffic, demand.seed, is_drawn=demand.spawn is not None)
    points = spawn_points(demand.town.lanes, usable)
    if demand.spawn is None:
        points = nearest_points(points, traffic.spawn_center_m, traffic.vehicle_count)
    else:
        points = drawn_points(points, demand, demand.spawn.radius_m)
    for rank, point in enumerate(points):
        generator = seeded(demand.seed, rank, 0)
        factor = generator.uniform(*DRIVER_FACTOR) * demand.drivers.speed
        headway = generator.uniform(*DRIVER_HEADWAY) * demand.drivers.headway
        number = cav_ranks.index(rank) if rank in cav_ranks else len(traffic.cav_models)
        model = traffic.cav_models[number] if number < len(traffic.cav_models) else None
        starts.append(Start(rank, point, rank in cav_ranks, factor, headway, generator, model))
    return starts


class Places:
    """Stretches of the lanes that are occupied at the start."""

    def __init__(self, graph: LaneGraph) -> None:
        """Start with empty lanes."""
        self.graph = graph
        self.occupied: dict[str, list[tuple[float, float]]] = {}

    def add(
        self, start: Start, shapes: Sequence[Shape], find_route: Callable[[Shape], tuple[Route | None, str]]
    ) -> tuple[Shape, Route]:
        """Return the first drawn model that has room and a route, and that route; occupy its stretch.

        `find_route` returns the route of a model; or None, and what prevents one.

        Raises:
            InputError: If no model has both.
        """
        point, reason = start.point, "no model has room between its neighbors"
        drawn = draw_models(shapes, start.is_cav, start.generator)
        for shape in drawn if start.model is None else _of_model(drawn, start.model):
            span = point.bumpers(shape)
            if not self._fits(point.lane, span):
                continue
            route, why = find_route(shape)
            if route is not None:
                self.occupied.setdefault(point.lane, []).append(span)
                return shape, route
            reason = why
        x, y, z = point.position
        raise InputError(
            f"spawn point on lane {point.lane!r} at ({x:.1f}, {y:.1f}, {z:.1f}) m: {reason}; every vehicle needs a "
            "route that keeps its wheels on the road; "
            + (
                "widen the road there, or add a shorter vehicle model"
                if start.model is None
                else f"choose a model other than {start.model} in cav_models, or another rank in cav_ranks"
            )
        )

    def _fits(self, lane: str, span: tuple[float, float]) -> bool:
        """Return whether a stretch is clear of junctions and of the vehicles that are there already."""
        rear, front = span
        slack = 0.5  # box centers may sit a little off the middle between the axles
        if rear < CLEARANCE - slack or front > self.graph.lanes[lane].plan_length - CLEARANCE + slack:
            return False
        others = self.occupied.get(lane, [])
        return all(front + START_GAP <= low or high + START_GAP <= rear for low, high in others)


def _of_model(shapes: Sequence[Shape], name: str) -> list[Shape]:
    """Return the shape of a model.

    Raises:
        InputError: If there is no such model.
    """
    found = [shape for shape in shapes if shape.name == name]
    if not found:
        known = ", ".join(sorted(shape.name for shape in shapes))
        raise InputError(f"traffic.cav_models: there is no model {name!r}; there are {known}; name one of them")
    return found


def draw_paint(model: Any, generator: np.random.Generator) -> str:
    """Return one of the paints of a model."""
    return model.paints[int(generator.integers(len(model.paints)))]


def draw_models(shapes: Sequence[Shape], is_cav: bool, generator: np.random.Generator) -> list[Shape]:
    """Return the models in the order in which a vehicle tries them, drawn by weight without replacement.

    Vehicles that carry sensors try low models before high ones.
    """
    weight = np.array([MODEL_WEIGHT.get(shape.name, OTHER_WEIGHT) for shape in shapes])
    order = np.argsort(-np.log(generator.random(len(shapes))) / weight, kind="stable")  # exponential races
    drawn = [shapes[index] for index in order]
    if is_cav:
        drawn.sort(key=lambda shape: shape.height > CAV_MAX_HEIGHT)
    return drawn
