"""The vehicles of a scenario: models, paints, and routes that their bodies can drive, also after a change of lanes."""

from collections.abc import Callable

import numpy as np

from mmw.core.errors import InputError
from mmw.traffic.ground_height import Ground
from mmw.traffic.idm.lane_change import CLEAR_SHARE, Beside, Wanted
from mmw.traffic.idm.vehicle import Car, Change, Plan, find_passages, lane_begins
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.traffic.route import choose_lanes, join_lanes, living_lanes, plan_length
from mmw.traffic.spawn import Places, SpawnPoint, draw_models, seeded
from mmw.traffic.speed_profile import speed_limit
from mmw.traffic.vehicle_pose import MAX_STEER, Shape, Stance, Track, follow_line, stand_on_ground

DRIVER_FACTOR = (0.85, 1.0)
"""Range of the drivers' share of the speed limit."""

DRIVER_HEADWAY = (1.0, 1.5)
"""Range of the drivers' time gap [s]."""

RUN_OUT = 80.0
"""Routes go on this far beyond what the fastest vehicle can cover, so that nobody brakes for their end [m]."""


class Fleet:
    """Puts vehicles on the road, each with a route that its body can drive."""

    def __init__(self, graph: LaneGraph, ground: Ground, shapes: list[Shape], duration: float, seed: int) -> None:
        """Keep what routes are made from.

        Args:
            graph: The town's lanes.
            ground: The drivable surface.
            shapes: Models to draw from.
            duration: Time that routes have to last [s].
            seed: Seeds every draw.
        """
        self.graph = graph
        self.ground = ground
        self.shapes = shapes
        self.duration = duration
        self.seed = seed
        self.fastest = max(lane.speed for lane in graph.lanes.values())
        alive = living_lanes(graph)
        self.has_circuit = bool(alive)
        self.alive = alive or frozenset(graph.lanes)
        self.places = Places(graph)
        self.beside = Beside(graph)
        self.closed: set[tuple[str, str]] = set()
        """(model, lane) pairs that the model cannot drive without leaving the road."""

    def add(self, point: SpawnPoint, rank: int, is_cav: bool, generator: np.random.Generator) -> Car:
        """Place a vehicle; `generator` draws the driver and the model, seed and rank the route.

        Raises:
            InputError: If no model has room, or none can drive from here without leaving the road.
        """
        factor, headway = generator.uniform(*DRIVER_FACTOR), generator.uniform(*DRIVER_HEADWAY)
        reason = "no model has room between its neighbours"
        for shape in draw_models(self.shapes, is_cav, generator):
            if not self.places.fits(point, shape):
                continue
            start = point.station + 0.5 * shape.wheelbase
            stance, why = self._find_route(point, shape, start, rank)
            if stance is not None:
                self.places.take(point, shape)
                line = stance.track.line
                limit = speed_limit(stance, self.graph, factor).tolist()
                plan = Plan(stance, limit, lane_begins(line), find_passages(line, self.graph, shape))
                return Car(plan, start, headway, factor)
            reason = why
        x, y, z = point.position
        raise InputError(
            f"spawn point on lane {point.lane!r} at ({x:.1f}, {y:.1f}, {z:.1f}) m: {reason}; every vehicle needs a way "
            "that keeps its wheels on the road; widen the road there, or add a shorter vehicle model"
        )

    def _find_route(self, point: SpawnPoint, shape: Shape, start: float, rank: int) -> tuple[Stance | None, str]:
        """Return a stance along a route that the model can drive, or None and what stood in the way."""

        def drive(lanes: list[Lane]) -> tuple[Stance | None, int, str]:
            return self._drive(follow_line(join_lanes(lanes), shape), lanes, start)

        need = self.fastest * self.duration + RUN_OUT
        return self._search(shape, point.lane, need, (self.seed, rank, 1), drive)

    def change(self, rank: int, car: Car, wanted: Wanted, elapsed: float) -> Plan | None:
        """Return the way of a vehicle that changes lanes and goes on by a new random route; None if there is none.

        Args:
            rank: The vehicle.
            car: The same.
            wanted: The change.
            elapsed: Time since the engine's start [s].
        """
        before = car.plan.stance
        begins: list[float] = []

        def drive(lanes: list[Lane]) -> tuple[Stance | None, int, str]:
            line, begins[:] = self.beside.line(car, wanted.lane, wanted.row, wanted.length, lanes[1:])
            track = follow_line(line, car.shape, before.track, wanted.row)
            path = [*(self.graph.lanes[name] for name in car.line.lanes[: car.segment + 1]), *lanes]
            stance, culprit, why = self._drive(track, path, car.station, before, wanted.row)
            return stance, culprit - car.segment - 1, why

        need = self.fastest * max(0.0, self.duration - elapsed) + RUN_OUT
        stance, _ = self._search(car.shape, wanted.lane, need, (self.seed, rank, 1, car.changes + 1), drive)
        if stance is None:
            return None
        line = stance.track.line
        start = float(line.station[wanted.row])
        change = Change(car.segment, start + CLEAR_SHARE * wanted.length, start + wanted.length)
        slow = (start, start + wanted.length, wanted.speed)
        limit = speed_limit(stance, self.graph, car.factor, slow).tolist()
        return Plan(stance, limit, begins, find_passages(line, self.graph, car.shape), change)

    def _search(
        self,
        shape: Shape,
        first: str,
        need: float,
        key: tuple[int, ...],
        drive: Callable[[list[Lane]], tuple[Stance | None, int, str]],
    ) -> tuple[Stance | None, str]:
        """Return a stance along a random route from a lane on, or None and what stood in the way.

        A route is driven from end to end before it is accepted. The connection that fails is closed for the model.

        Args:
            shape: The model.
            first: Lane that the route begins with.
            need: Length of the route after this lane [m].
            key: Seeds the draws.
            drive: Returns a stance along lanes; or None, the index of the lane that cannot be driven (negative if it
                lies before `first`), and why.
        """
        why = "no way on"

        def is_open(name: str) -> bool:
            return name in self.alive and (shape.name, name) not in self.closed

        while is_open(first):
            names = choose_lanes(self.graph, first, need, seeded(*key), is_open)
            lanes = [self.graph.lanes[name] for name in names]
            if sum(plan_length(lane) for lane in lanes[1:]) < need and self.has_circuit:
                self.closed.add((shape.name, names[-1]))
                continue
            stance, culprit, why = drive(lanes)
            if stance is not None:
                return stance, ""
            if culprit < 0:
                break
            self.closed.add((shape.name, names[culprit]))
        return None, why

    def _drive(
        self, track: Track, lanes: list[Lane], start: float, before: Stance | None = None, row: int = 0
    ) -> tuple[Stance | None, int, str]:
        """Return the stance along a track; or None, the index of the lane to blame, and why."""
        steep = np.flatnonzero((np.abs(track.steer) > MAX_STEER) & (track.line.station >= start))
        stance = None
        if len(steep):
            lost, what = float(track.line.station[steep[0]]), "the bend is too tight"
        else:
            stance, lost, what = stand_on_ground(track, self.ground, start, before, row)
        if stance is not None:
            return stance, 0, ""
        at = int(np.searchsorted(track.line.station, lost))
        x, y = track.front[at]
        return None, _culprit(lanes, track, lost), f"{what} for model {track.shape.name!r} near ({x:.1f}, {y:.1f}) m"


def _culprit(lanes: list[Lane], track: Track, lost: float) -> int:
    """Return the index of the lane to blame for what happens at a station: the junction just before, or the lane."""
    ends = track.line.ends
    index = min(int(np.searchsorted(ends, lost, side="right")), len(ends) - 1)
    reach = lost - track.shape.behind - 6.0
    for back in range(index, -1, -1):
        if lanes[back].junction:
            return back
        if back and ends[back - 1] < reach:
            break
    return index
