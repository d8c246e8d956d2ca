"""Give vehicles models, paints and routes that their bodies can drive, also after a change of lanes."""

from collections.abc import Callable

import numpy as np

from mmw.traffic.demand import TrafficDemand
from mmw.traffic.idm.lane_change import CLEAR_SHARE, AdjacentLanes, DesiredChange
from mmw.traffic.idm.vehicle import Car, Change, Plan, find_passages
from mmw.traffic.roads.lane_graph import Lane
from mmw.traffic.route import choose_lanes, endless_lanes, join_lanes
from mmw.traffic.spawn import RUN_OUT, Places, Start, draw_paint, seeded
from mmw.traffic.speed_profile import speed_limit
from mmw.traffic.vehicle_pose import MAX_STEER, Shape, Stance, Track, follow_line, place_on_ground


class Fleet:
    """Puts vehicles on the road, each with a route that its body can drive."""

    def __init__(self, demand: TrafficDemand, duration: float) -> None:
        """Start with empty lanes.

        Args:
            demand: The scenario.
            duration: Time that routes have to last [s].
        """
        self.demand = demand
        self.graph = graph = demand.town.lanes
        self.duration = duration
        self.fastest = max(lane.speed for lane in graph.lanes.values())
        endless = endless_lanes(graph)
        self.has_circuit = bool(endless)
        self.endless = endless or frozenset(graph.lanes)
        self.places = Places(graph)
        self.adjacent = AdjacentLanes(graph)
        self.closed: set[tuple[str, str]] = set()
        """(model, lane) pairs that the model cannot drive without leaving the road."""

    def add(self, start: Start) -> Car:
        """Place a vehicle with a model, a paint and a route.

        Raises:
            BlockedPointError: If no model has room, or none can drive from here without leaving the road.
        """
        need = self.fastest * self.duration + RUN_OUT

        def find_route(shape: Shape) -> tuple[Stance | None, str]:
            def drive(lanes: list[Lane]) -> tuple[Stance | None, int, str]:
                station = start.point.station + 0.5 * shape.wheelbase
                return self._drive(follow_line(join_lanes(lanes), shape), lanes, station)

            return self._search(shape, start.point.lane, need, (self.demand.seed, start.rank, 1), drive)

        shape, stance = self.places.add(start, self.demand.shapes, find_route)
        line = stance.track.line
        limit = speed_limit(stance, self.graph, start.factor).tolist()
        plan = Plan(stance, limit, [0.0, *line.ends[:-1].tolist()], find_passages(line, self.graph, shape))
        paint = draw_paint(self.demand.catalog[shape.name], start.generator)
        return Car(plan, start.point.station + 0.5 * shape.wheelbase, start.headway, start.factor, paint)

    def change(self, rank: int, car: Car, desired: DesiredChange, elapsed: float) -> Plan | None:
        """Return the path of a vehicle that changes lanes and follows a new random route; None if there is none.

        `elapsed` is the time since the engine's start [s].
        """
        before = car.plan.stance
        begins: list[float] = []

        def drive(lanes: list[Lane]) -> tuple[Stance | None, int, str]:
            line, begins[:] = self.adjacent.line(car, desired.lane, desired.row, desired.length, lanes[1:])
            track = follow_line(line, car.shape, before.track, desired.row)
            path = [*(self.graph.lanes[name] for name in car.line.lanes[: car.segment + 1]), *lanes]
            stance, culprit, why = self._drive(track, path, car.station, before, desired.row)
            return stance, culprit - car.segment - 1, why

        need = self.fastest * max(0.0, self.duration - elapsed) + RUN_OUT
        stance, _ = self._search(car.shape, desired.lane, need, (self.demand.seed, rank, 1, car.changes + 1), drive)
        if stance is None:
            return None
        line = stance.track.line
        start = float(line.station[desired.row])
        change = Change(car.segment, start + CLEAR_SHARE * desired.length, start + desired.length)
        slow = (start, start + desired.length, desired.speed)
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
        """Return a stance along a random route of a length [m] after a first lane, or None and what prevents one.

        A route is driven from end to end before it is accepted. The connection that fails is closed for the model.
        `drive` returns a stance; or None, the index of the lane that fails (negative before `first`), and why.
        """
        why = "the lane leads nowhere"

        def is_open(name: str) -> bool:
            return name in self.endless and (shape.name, name) not in self.closed

        while is_open(first):
            names = choose_lanes(self.graph, first, need, seeded(*key), is_open)
            lanes = [self.graph.lanes[name] for name in names]
            if sum(lane.plan_length for lane in lanes[1:]) < need and self.has_circuit:
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
            stance, lost, what = place_on_ground(track, self.demand.ground, start, before, row)
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
