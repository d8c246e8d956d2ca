"""Give vehicles models, paints and routes that their bodies can drive, also after a change of lanes."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from weakref import WeakValueDictionary

import numpy as np

from mmw.core.remember import remembered
from mmw.traffic.demand import TrafficDemand
from mmw.traffic.ground_height import Ground
from mmw.traffic.idm.lane_change import CLEAR_SHARE, DesiredChange, adjacent_lanes
from mmw.traffic.idm.open_ends import open_network
from mmw.traffic.idm.vehicle import Car, Change, Plan, find_passages
from mmw.traffic.model_choice import draw_models, draw_paint
from mmw.traffic.roads.lane_graph import Lane
from mmw.traffic.route import Line, choose_lanes, join_lanes
from mmw.traffic.spawn import RUN_OUT, BlockedPointError, Places, SpawnPoint, Start, make_start, seeded, spawn_points
from mmw.traffic.speed_profile import speed_limit
from mmw.traffic.vehicle_pose import MAX_STEER, Shape, Stance, Track, follow_line, place_on_ground

SLOWEST = 1.5
"""A CAV whose way ends before the scenario drives at least this fast [m/s]; design value, a walking pace."""

UNHURRIED = 0.8
"""Share of a CAV's time to the end of the network that it may use: it brakes before the end; design value."""

NOWHERE = "the lane leads nowhere"
"""Why no route begins on a lane from which no other lane or exit can be reached."""


@remembered(size=4)
def _driven(ground: Ground) -> WeakValueDictionary[tuple[object, ...], Stance]:
    """Return the stances on a town's ground that some vehicle still has, by lanes, shape and station of the start.

    An episode that starts anew, beside the one before, finds its own.
    """
    return WeakValueDictionary()


class Fleet:
    """Puts vehicles on the road, each with a route that its body can drive."""

    def __init__(self, demand: TrafficDemand, duration: float, *, may_leave: bool = True) -> None:
        """Start with empty lanes.

        Args:
            demand: The scenario.
            duration: Time that routes have to last [s].
            may_leave: Whether vehicles but CAVs leave the network where its roads end; else they stop there.
        """
        self.demand = demand
        self.graph = graph = demand.town.lanes
        self.duration = duration
        self.may_leave = may_leave
        self.fastest = max(lane.speed for lane in graph.lanes.values())
        self.network = open_network(graph)
        self.usable = self.network.usable
        self.places = Places(graph)
        self.adjacent = adjacent_lanes(graph)
        self.closed: dict[tuple[str, str], str] = {}
        """(model, lane) pairs that the model cannot drive without leaving the road, and why."""
        self.closed_to_cavs: set[tuple[str, str]] = set()
        """The same for what does not last long enough for a CAV."""
        self.stay = self._time_to_stay()

    def _time_to_stay(self) -> float:
        """Return how long the roads ahead of a CAV last, at the least [s].

        That is the duration of the scenario; in a network in which too few places have such roads, it is the longest
        time that twice as many places have as there are CAVs.
        """
        count = 2 * len(self.demand.traffic.cav_ranks)
        points = spawn_points(self.graph, self.usable) if count and self.network.exits else []
        times = sorted((self.network.time_left(point) for point in points), reverse=True)
        return min(self.duration, times[min(count, len(times)) - 1]) if times else 0.0

    def suits_cav(self, point: SpawnPoint) -> bool:
        """Return whether the roads ahead of a place last long enough for a CAV."""
        return self.network.time_left(point) >= self.stay

    def add(self, start: Start) -> Car:
        """Place a vehicle with a model, a paint and a route.

        Raises:
            BlockedPointError: If no model has room, or none can drive from here without leaving the road.
        """
        shape, stance = self.places.add(start, self.demand.shapes, lambda shape: self._find_route(start, shape, 0.0))
        return self._make_car(start, shape, stance)

    def enter(self, rank: int, point: SpawnPoint, elapsed: float) -> Car:
        """Return a vehicle that enters the network some time after the engine's start [s].

        Raises:
            BlockedPointError: If no model can drive from here without leaving the road.
        """
        start = make_start(self.demand, rank, point, ())
        reason = ""
        for shape in draw_models(self.demand.shapes, False, start.generator):
            stance, reason = self._find_route(start, shape, elapsed)
            if stance is not None:
                return self._make_car(start, shape, stance)
        raise BlockedPointError(point, reason, "widen the road there")

    def _find_route(self, start: Start, shape: Shape, elapsed: float) -> tuple[Stance | None, str]:
        need = self.fastest * max(0.0, self.duration - elapsed) + RUN_OUT
        driven = _driven(self.demand.ground)

        def drive(lanes: list[Lane]) -> tuple[Stance | None, int, str]:
            station = start.point.station + 0.5 * shape.wheelbase
            way = (*(lane.name for lane in lanes), shape, station)
            known = driven.get(way)
            if known is not None:
                return known, 0, ""
            found = self._drive(follow_line(join_lanes(lanes), shape), lanes, station)
            if found[0] is not None:
                driven[way] = found[0]
            return found

        stay = 0.0
        if start.is_cav and self.stay:
            stay = self.stay + start.point.station / self.graph.lanes[start.point.lane].speed
        key = self.demand.seed, start.rank, 1
        stance, why = self._search(shape, start.point.lane, need, key, drive, stay)
        if stance is None and stay > 0.0:  # no way lasts: the CAV takes one that ends, and waits there
            stance, why = self._search(shape, start.point.lane, need, key, drive, 0.0)
        return stance, why

    def _driver_factor(self, start: Start, line: Line) -> float:
        """Return the driver's share of the speed limits: a CAV slows down for a way that ends before the scenario."""
        if not (start.is_cav and line.lanes[-1] in self.network.exits):
            return start.factor
        first = self.graph.lanes[start.point.lane]
        whole = self.network.crossing_time(line.lanes)
        time = whole - start.point.station / first.speed
        least = SLOWEST * whole / float(line.ends[-1])
        return min(start.factor, max(least, UNHURRIED * time / self.duration))

    def _make_car(self, start: Start, shape: Shape, stance: Stance) -> Car:
        line = stance.track.line
        start = replace(start, factor=self._driver_factor(start, line))
        limit = speed_limit(stance, self.graph, start.factor).tolist()
        begins = [0.0, *line.ends[:-1].tolist()]
        plan = Plan(
            stance, limit, begins, find_passages(line, self.graph, shape), leaves=self._leaves(line, start.is_cav)
        )
        paint = start.paint or draw_paint(self.demand.catalog[shape.name], start.generator)
        station = start.point.station + 0.5 * shape.wheelbase
        return Car(plan, station, start.headway, start.factor, paint, is_cav=start.is_cav)

    def _leaves(self, line: Line, is_cav: bool) -> bool:
        return self.may_leave and not is_cav and line.lanes[-1] in self.network.exits

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

        need, stay = self.fastest * max(0.0, self.duration - elapsed) + RUN_OUT, 0.0
        if car.is_cav and self.stay:
            place = desired.rear + car.shape.length
            stay = max(0.0, self.stay - elapsed) + place / self.graph.lanes[desired.lane].speed
        key = self.demand.seed, rank, 1, car.changes + 1
        stance, _ = self._search(car.shape, desired.lane, need, key, drive, stay)
        if stance is None:
            return None
        line = stance.track.line
        start = float(line.station[desired.row])
        change = Change(car.segment, start + CLEAR_SHARE * desired.length, start + desired.length)
        slow = (start, start + desired.length, desired.speed)
        limit = speed_limit(stance, self.graph, car.factor, slow).tolist()
        passages, leaves = find_passages(line, self.graph, car.shape), self._leaves(line, car.is_cav)
        return Plan(stance, limit, begins, passages, change, leaves)

    def _search(
        self,
        shape: Shape,
        first: str,
        need: float,
        key: tuple[int, ...],
        drive: Callable[[list[Lane]], tuple[Stance | None, int, str]],
        stay: float,
    ) -> tuple[Stance | None, str]:
        """Return a stance along a random route of a length [m] after a first lane, or None and what prevents one.

        A route is driven from end to end before it is accepted. The connection that fails is closed for the model.
        A route may be shorter if it ends where vehicles leave the network; that of a CAV then lasts for the time `stay`
        at the speed limits [s], which is 0 for others.
        `drive` returns a stance; or None, the index of the lane that fails (negative before `first`), and why.
        """
        why = self.closed.get((shape.name, first), NOWHERE)

        def is_open(name: str) -> bool:
            is_closed = (shape.name, name) in self.closed or (stay > 0.0 and (shape.name, name) in self.closed_to_cavs)
            return name in self.usable and not is_closed

        def lasts(names: Sequence[str]) -> bool:
            return stay == 0.0 or self.network.crossing_time(names[:-1]) + self.network.time[names[-1]] >= stay

        while is_open(first):
            names = choose_lanes(self.graph, first, need, seeded(*key), is_open, lasts)
            lanes = [self.graph.lanes[name] for name in names]
            is_short = sum(lane.plan_length for lane in lanes[1:]) < need and self.network.ends_well
            if is_short and not (names[-1] in self.network.exits and lasts(names)):
                if stay > 0.0:
                    self.closed_to_cavs.add((shape.name, names[-1]))
                else:
                    self.closed[shape.name, names[-1]] = NOWHERE
                continue
            stance, culprit, why = drive(lanes)
            if stance is not None:
                return stance, ""
            if culprit < 0:
                break
            self.closed[shape.name, names[culprit]] = why
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
