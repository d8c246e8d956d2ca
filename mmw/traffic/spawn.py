"""Choose start positions, drivers, models, paints and connected vehicles: what all engines draw alike."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from mmw.config import TrafficConfig
from mmw.core.errors import InputError
from mmw.core.remember import remembered
from mmw.traffic.demand import TrafficDemand
from mmw.traffic.model_choice import draw_models, of_model
from mmw.traffic.polyline import sample_polyline
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.spawn_grid import by_distance, grid_of, places_of
from mmw.traffic.vehicle_pose import Shape

SPACING = 12.0
"""Distance between spawn points along a lane [m]."""

CLEARANCE = 8.0
"""From the bumpers of a vehicle to both ends of its lane [m]."""

GRID_HALF_LENGTH = 2.5
"""Half the length of the vehicle that the spawn points are laid out for [m]; longer ones need more room."""

START_GAP = 2.5
"""Least distance between bumpers at the start [m]."""

DRIVER_FACTOR = (0.85, 1.0)
"""Range of the drivers' share of the speed limit."""

DRIVER_HEADWAY = (1.0, 1.5)
"""Range of the drivers' time gap [s]."""

RUN_OUT = 80.0
"""Routes go on this far beyond what the fastest vehicle can cover, so that no vehicle brakes for their end [m]."""

SETTLE_S = 1.5
"""Simulated before the warm-up and after the last frame, as support of the filters in time [s]."""

MAX_NAMED = 6
"""A note names at most so many spawn points."""

Route = TypeVar("Route")
Vehicle = TypeVar("Vehicle")


class BlockedPointError(InputError):
    """Report a spawn point at which no model has room and a route."""

    def __init__(self, point: "SpawnPoint", reason: str, cure: str) -> None:
        x, y, z = point.position
        self.place = f"lane {point.lane!r} at ({x:.1f}, {y:.1f}, {z:.1f}) m: {reason}"
        super().__init__(
            f"spawn point on {self.place}; every vehicle needs a route that keeps its wheels on the road; {cure}"
        )


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


@remembered(size=8)
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
    chosen = places_of(grid_of(points), by_distance(points, tuple(center)), count)
    if len(chosen) < count:
        raise InputError(f"vehicle_count = {count}: the town has {len(chosen)} spawn points; give at most that many")
    return [points[index] for index in chosen]


def drawn_points(
    points: Sequence[SpawnPoint], demand: TrafficDemand, radius: float
) -> tuple[list[SpawnPoint], tuple[int, ...]]:
    """Return points drawn by seed from those within a 3-D distance of the spawn center, nearest first, and CAVs' ranks.

    Any point is as likely as others. Without a `cav_pool`, CAVs of seeds that follow each other start at other points,
    far from each other along the lanes, until there are no more: see `_spread_points`.

    Raises:
        InputError: If there are fewer places than vehicles.
    """
    traffic, count = demand.traffic, demand.traffic.vehicle_count
    grid = grid_of(points)
    distance = grid.distance(traffic.spawn_center_m)
    inside = np.flatnonzero(distance <= radius)
    order = seeded(demand.seed, 0, 4).permutation(inside)
    cav_count = 0 if traffic.cav_pool else len(traffic.cav_ranks)
    first = _spread_points(places_of(grid, inside.tolist()), cav_count, demand.seed)
    chosen = places_of(grid, [*first, *order.tolist()], count)
    if len(chosen) < count:
        raise InputError(
            f"vehicle_count = {count}: there are {len(chosen)} spawn points within vary.spawn.radius_m = {radius:g} of "
            "`spawn_center_m`; give fewer vehicles, or a larger radius"
        )
    ranked = sorted(chosen, key=lambda index: (distance[index], index))
    if traffic.cav_pool:
        return [points[index] for index in ranked], connected_ranks(traffic, demand.seed)
    return [points[index] for index in ranked], tuple(sorted(map(ranked.index, chosen[:cav_count])))


def _spread_points(places: Sequence[int], count: int, seed: int) -> list[int]:
    """Return as many places for a seed, others than for the seeds of the same round.

    A round takes the places in bit-reversed order of their index, the radical inverse in base 2 (van der Corput, 1935):
    however many seeds have had theirs, these are spread evenly along the lanes. Each round begins elsewhere.
    """
    if count == 0 or len(places) < count:
        return []
    turn, index = divmod(seed, len(places) // count)
    bits = (len(places) - 1).bit_length()
    reverse = [int(f"{k:0{bits}b}"[::-1], 2) for k in range(1 << bits)] if bits else [0]
    order = [k for k in reverse if k < len(places)]
    shift = int(seeded(turn, 0, 5).integers(len(places)))
    return [places[(k + shift) % len(places)] for k in order[index * count : (index + 1) * count]]


def connected_ranks(traffic: TrafficConfig, seed: int) -> tuple[int, ...]:
    """Return which vehicles are CAVs: their ranks by distance to the spawn center, `cav_1` first.

    They are those of `cav_ranks`, or as many drawn by seed from `cav_pool`.
    """
    if traffic.cav_pool is None:
        return traffic.cav_ranks
    drawn = seeded(seed, 0, 3).choice(traffic.cav_pool, len(traffic.cav_ranks), replace=False)
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
    """Model that it has to have."""
    paint: str | None = None
    """Paint that it has to have."""


def draw_starts(demand: TrafficDemand, usable: frozenset[str]) -> tuple[list[Start], tuple[int, ...]]:
    """Return the vehicles of a scenario and their drivers, by distance to the spawn center, and the ranks of the CAVs.

    They start on usable lanes; `cav_1` is first of the ranks.

    Raises:
        InputError: If the town has too few places.
    """
    traffic = demand.traffic
    points = spawn_points(demand.town.lanes, usable)
    if demand.spawn is None:
        points = nearest_points(points, traffic.spawn_center_m, traffic.vehicle_count)
        cav_ranks = connected_ranks(traffic, demand.seed)
    else:
        points, cav_ranks = drawn_points(points, demand, demand.spawn.radius_m)
    return [make_start(demand, rank, point, cav_ranks) for rank, point in enumerate(points)], cav_ranks


def make_start(demand: TrafficDemand, rank: int, point: SpawnPoint, cav_ranks: tuple[int, ...]) -> Start:
    """Return a vehicle of a rank at a place, with its driver."""
    models = demand.traffic.cav_models
    generator = seeded(demand.seed, rank, 0)
    factor = generator.uniform(*DRIVER_FACTOR) * demand.drivers.speed
    headway = generator.uniform(*DRIVER_HEADWAY) * demand.drivers.headway
    number = cav_ranks.index(rank) if rank in cav_ranks else len(models)
    model, paint = models[number] if number < len(models) else None, None
    if demand.fleet is not None and rank < len(demand.fleet):
        number = number if rank in cav_ranks else rank + sum(other > rank for other in cav_ranks)
        model, paint = demand.fleet[number]
    return Start(rank, point, rank in cav_ranks, factor, headway, generator, model, paint)


@dataclass(frozen=True)
class Placed(Generic[Vehicle]):
    """Vehicles at their starts."""

    vehicles: list[Vehicle]
    """By rank."""
    cav_ranks: tuple[int, ...]
    """Ranks of the CAVs, `cav_1` first."""
    notes: list[str]
    """Spawn points that were skipped, and vehicles for which no other was left."""


def place_starts(
    demand: TrafficDemand,
    usable: frozenset[str],
    add: Callable[[Start], Vehicle],
    suits_cav: Callable[[SpawnPoint], bool] | None = None,
) -> Placed[Vehicle]:
    """Return the vehicles of a scenario; where none can start, the point is skipped and the next one taken.

    Points behind those of `draw_starts` are the other ones nearest to the spawn center. Once there are no more, the
    vehicles that remain are left out.

    Args:
        demand: The scenario.
        usable: Lanes to start on.
        add: Makes a vehicle, or raises `BlockedPointError`.
        suits_cav: Whether a CAV can start at a point. CAVs take the nearest of such points, twice as many of which are
            kept for them; None if all suit.

    Raises:
        InputError: If the town has too few places, no vehicle can start at any of them, or one that is left out is a
            CAV.
    """
    starts, cav_ranks = draw_starts(demand, usable)
    vehicles: list[Vehicle] = []
    blocked: list[BlockedPointError] = []
    points = list(_all_points(demand, usable, [start.point for start in starts]))
    kept = [] if suits_cav is None else [point for point in points if suits_cav(point)][: 2 * len(cav_ranks)]
    free = [point for point in points if point not in kept]
    count = len(starts) if demand.fleet is None else min(len(starts), len(demand.fleet))
    while len(vehicles) < count:
        if kept and len(vehicles) > max(cav_ranks):
            kept, free = [], [point for point in points if point in kept or point in free]
        queue = (kept or free) if len(vehicles) in cav_ranks else free
        if not queue:
            break
        try:
            vehicles.append(add(make_start(demand, len(vehicles), queue.pop(0), cav_ranks)))
        except BlockedPointError as error:
            blocked.append(error)
    if blocked and not vehicles:
        raise blocked[0]
    if missing := [rank for rank in cav_ranks if rank >= len(vehicles)]:
        raise InputError(
            f"cav_ranks = {list(cav_ranks)}: vehicles can start at {len(vehicles)} spawn points only, so there is no "
            f"rank {missing[0]}; give smaller ranks{''.join(f'; blocked is {one.place}' for one in blocked[:1])}"
        )
    notes = []
    if blocked:
        named = "; ".join(error.place for error in blocked[:MAX_NAMED])
        more = f"; and {len(blocked) - MAX_NAMED} more" if len(blocked) > MAX_NAMED else ""
        notes.append(f"{len(blocked)} spawn points skipped, for no vehicle can start there: {named}{more}")
    if len(vehicles) < len(starts):
        notes.append(f"{len(vehicles)} of {len(starts)} vehicles drive: no spawn point is left for the others")
    return Placed(vehicles, cav_ranks, notes)


def _all_points(demand: TrafficDemand, usable: frozenset[str], chosen: list[SpawnPoint]) -> Iterator[SpawnPoint]:
    """Yield the chosen points, then the others by their distance to the spawn center, within the radius if any."""
    yield from chosen
    points = spawn_points(demand.town.lanes, usable)
    grid, center = grid_of(points), tuple(demand.traffic.spawn_center_m)
    order = by_distance(points, center)
    if demand.spawn is not None:
        inside = grid.distance(center) <= demand.spawn.radius_m
        order = [index for index in order if inside[index]]
    first = [grid.number[point] for point in chosen]
    yield from (points[index] for index in places_of(grid, [*first, *order])[len(first) :])


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
            BlockedPointError: If no model has both.
            InputError: If there is no model of the name that the configuration gives.
        """
        point, reason = start.point, "no model has room between its neighbors"
        drawn = draw_models(shapes, start.is_cav, start.generator)
        for shape in drawn if start.model is None else of_model(drawn, start.model):
            span = point.bumpers(shape)
            if not self._fits(point.lane, span):
                continue
            route, why = find_route(shape)
            if route is not None:
                self.occupied.setdefault(point.lane, []).append(span)
                return shape, route
            reason = why
        raise BlockedPointError(
            point,
            reason,
            "widen the road there, or add a shorter vehicle model"
            if start.model is None
            else f"choose a model other than {start.model} in cav_models, or another rank in cav_ranks",
        )

    def _fits(self, lane: str, span: tuple[float, float]) -> bool:
        """Return whether a stretch is clear of junctions and of the vehicles that are there already."""
        rear, front = span
        slack = 0.5  # box centers may sit a little off the middle between the axles
        if rear < CLEARANCE - slack or front > self.graph.lanes[lane].plan_length - CLEARANCE + slack:
            return False
        others = self.occupied.get(lane, [])
        return all(front + START_GAP <= low or high + START_GAP <= rear for low, high in others)
