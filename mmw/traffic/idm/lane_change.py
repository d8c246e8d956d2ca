"""Decide changes of lanes: whether one pays and is safe, and the line that it follows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from mmw.core.remember import remembered
from mmw.traffic.idm.driver import STANDSTILL_GAP, follow_leader, request_distance
from mmw.traffic.idm.vehicle import ROOM, Car, OccupiedSpan, Plan
from mmw.traffic.polyline import sample_polyline
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.traffic.route import EXTENSION, PATH_STEP, Line, branch_line

if TYPE_CHECKING:
    from mmw.traffic.idm.engine import IdmEngine

POLITENESS = 0.25
"""MOBIL: weight of what others gain or lose. Source: Kesting, Treiber, Helbing 2007: 0.2 to 0.5 are realistic."""

THRESHOLD = 0.2
"""MOBIL: least advantage [m/s^2]. Source: as above, 0.1; more here, since every change needs a new route."""

SAFE_BRAKING = 2.0
"""MOBIL: hardest braking that a change may cause for the new follower and the driver [m/s^2]; the comfortable one."""

BETWEEN_CHANGES = 6.0
"""Least time from one change, begun or found impossible, to the next [s]; design value."""

DECIDE_EVERY = 10
"""Engine steps from one look at the neighbor lanes to the next."""

AHEAD = 6.0
"""A change begins this far ahead of the front axle [m]: what the low pass of the path already reads stays as it is."""

LATERAL_ACCELERATION = 1.5
"""Limit of the acceleration aside during a change on a straight road [m/s^2]; design value."""

QUINTIC_PEAK = 10 / 3**0.5
"""Largest second derivative of 10 u^3 - 15 u^4 + 6 u^5 on 0..1."""

MIN_LENGTH = 25.0
"""Shortest change [m]; design value."""

GAIN_OF_SPEED = 1.5
"""A change is laid out for this much more than the speed at its beginning [m/s], if the road allows it."""

CLEAR_SHARE = 0.7
"""From this share of the change on, a vehicle no longer obstructs the lane that it leaves: 2.9 m of 3.5 m."""

SETTLE = 3.0
"""The front bumper is on the middle of the new lane this far before the lane ends [m]."""

FARTHEST_ASIDE = 1.6
"""Lanes lie side by side where their middles are at most this many lane widths apart."""

SIDE_GAP = 1.0
"""Bumpers of vehicles on the new lane must be this far from those of the vehicle [m]."""

LOOK_BACK = 60.0
"""New followers are looked for this far behind the beginning of the new lane [m]."""

Leader = tuple[float, float, OccupiedSpan | None]
"""Gap [m], inf if there is none; speed [m/s]; where it is."""


def advantage(own: tuple[float, float], new: tuple[float, float], old: tuple[float, float]) -> float:
    """Return the gain of a change for the driver and, weighted, for both followers [m/s^2].

    Args:
        own: The driver's acceleration before and after the change [m/s^2].
        new: That of the follower on the new lane; equal numbers if there is none.
        old: That of the follower on the old lane.

    Source: MOBIL, Kesting, Treiber, Helbing, Transp. Res. Rec. 1999 (2007), 86, equation 2, without preferred side.
    """
    return own[1] - own[0] + POLITENESS * (new[1] - new[0] + old[1] - old[0])


def blend_share(u: np.ndarray) -> np.ndarray:
    """Return how far aside a change is, 0 to 1, at shares u of its length; speed and acceleration aside end at 0."""
    return u**3 * (10 - 15 * u + 6 * u**2)


def blend_time(aside: float) -> float:
    """Return the least duration of a change of lanes [s] over a distance aside [m]."""
    return (QUINTIC_PEAK * aside / LATERAL_ACCELERATION) ** 0.5


class AdjacentLanes:
    """Mapping of a position on one lane to the lane beside it, computed on first use."""

    def __init__(self, graph: LaneGraph) -> None:
        self.graph = graph
        self._tables: dict[tuple[str, str], tuple[np.ndarray, np.ndarray]] = {}

    def across(self, name: str, other: str, station: np.ndarray) -> np.ndarray:
        """Return the stations on lane `other` beside stations on lane `name` [m], shape [N]."""
        key = (name, other)
        if key not in self._tables:
            self._tables[key] = _project(self.graph.lanes[name], self.graph.lanes[other])
        return np.interp(station, *self._tables[key])

    def at(self, name: str, other: str, station: float) -> tuple[float, float]:
        """Return the station on lane `other` beside a station on lane `name`, and how far aside that place is [m]."""
        across = float(self.across(name, other, np.array([station]))[0])
        here, there = (
            sample_polyline(lane.points[:, :2], lane.plan_station, np.array([at]))[0]
            for lane, at in ((self.graph.lanes[name], station), (self.graph.lanes[other], across))
        )
        return across, float(np.hypot(*(there - here)))

    def line(self, car: Car, other: str, start: int, length: float, onward: Sequence[Lane]) -> tuple[Line, list[float]]:
        """Return the line of a change to another lane and the lanes onward, and where each of its lanes begins [m].

        The change begins at a row of the car's line and has a length [m].
        """
        line, lane = car.line, self.graph.lanes[other]
        count = round(length / PATH_STEP)
        rows = np.arange(start, start + count + 1)
        here = line.station[rows] - car.begins[car.segment]
        there = self.across(line.lanes[car.segment], other, here)
        along = lane.plan_station
        adjacent = sample_polyline(lane.points, along, there)
        share = blend_share(np.arange(count + 1) / count)[:, None]
        change = line.points[rows] + share * (adjacent - line.points[rows])
        rest = lane.points[along > there[-1] + 1e-6]
        parts = [change, rest, *(after.points for after in onward)]
        last = np.cumsum([len(part) for part in parts])[1:] - 1
        names = (line.lanes[car.segment], other, *(after.name for after in onward))
        new = branch_line(line, start, np.concatenate(parts), names, [count // 2, *last])
        reached = line.station[start] + float(np.linalg.norm(np.diff(change[:, :2], axis=0), axis=1).sum())
        ends = new.ends.tolist()
        begins = [*car.begins[: car.segment + 1], reached - float(there[-1]), *ends[car.segment + 1 : -1]]
        return new, begins


@remembered(size=4)
def adjacent_lanes(graph: LaneGraph) -> AdjacentLanes:
    """Return the mapping of a town's lanes to those beside them, which all its scenarios share."""
    return AdjacentLanes(graph)


def _project(lane: Lane, other: Lane) -> tuple[np.ndarray, np.ndarray]:
    """Return stations on a lane, and those of the nearest places on another one, ascending."""
    a, step = other.points[:-1, :2], np.diff(other.points[:, :2], axis=0)
    square = (step**2).sum(axis=1).clip(1e-12)
    to = lane.points[:, None, :2] - a
    share = np.clip((to * step).sum(axis=-1) / square, 0, 1)
    miss = np.linalg.norm(to - share[..., None] * step, axis=-1)
    best = miss.argmin(axis=1)
    rows = np.arange(len(best))
    found = other.plan_station[best] + share[rows, best] * np.sqrt(square[best])
    return lane.plan_station, np.maximum.accumulate(found)


@dataclass(frozen=True)
class DesiredChange:
    """A change of lanes that pays for the driver and is safe."""

    lane: str
    row: int
    """Sample of the car's line where it begins."""
    length: float
    """[m]."""
    speed: float
    """Limit during the change [m/s]."""
    advantage: float
    """[m/s^2]."""
    rear: float
    """Station of the rear bumper on the new lane [m]."""


class LaneChanges:
    """Decides for all vehicles, and has their paths planned anew.

    `plan` returns the path of vehicle (index, car) with a desired change at a time [s], None if there is none.
    """

    def __init__(
        self, graph: LaneGraph, adjacent: AdjacentLanes, plan: Callable[[int, Car, DesiredChange, float], Plan | None]
    ):
        self.graph = graph
        self.adjacent = adjacent
        self.plan = plan
        self.done: list[tuple[float, int, str, str]] = []
        """Time [s], vehicle, lane before, lane after."""

    def decide(self, engine: "IdmEngine") -> None:
        """Begin the changes that are due; the cars and the spans are changed in place."""
        for index, car in enumerate(engine.cars):
            if (engine.steps + 3 * index) % DECIDE_EVERY or not self._is_free(car, engine, engine.leaders[index]):
                continue
            lane = self.graph.lanes[car.line.lanes[car.segment]]
            options = [self._consider(index, engine, lane, side) for side in (lane.left, lane.right) if side]
            options = [option for option in options if option is not None]
            if not options:
                continue
            best = max(options, key=lambda option: option.advantage)
            car.settled = engine.time
            self._begin(engine, index, lane, best)

    def ask(self, engine: "IdmEngine", index: int, side: str) -> bool:
        """Begin a change to the `left` or `right` that is safe, whether it gains anything or not; return whether."""
        car = engine.cars[index]
        lane = self.graph.lanes[car.line.lanes[car.segment]]
        other = lane.left if side == "left" else lane.right
        if not other or lane.junction or car.change is not None or car.rear_segment != car.segment:
            return False
        found = self._consider(index, engine, lane, other, is_asked=True)
        return found is not None and self._begin(engine, index, lane, found)

    def _begin(self, engine: "IdmEngine", index: int, lane: Lane, best: DesiredChange) -> bool:
        car = engine.cars[index]
        plan = self.plan(index, car, best, engine.time)
        if plan is None or not _is_smooth(car, plan):
            return False
        car.follow(plan)
        car.granted = sum(passage.first_segment <= car.segment for passage in plan.passages)
        engine.cancel_reservations(index, car.front)
        car.changes += 1
        self.done.append((engine.time, index, lane.name, best.lane))
        span = OccupiedSpan(best.rear, best.rear + car.shape.length, index, car.segment + 1)
        engine.spans.setdefault(best.lane, []).append(span)
        return True

    def _is_free(self, car: Car, engine: "IdmEngine", leader: Leader) -> bool:
        """Return whether a driver may change: on one lane, behind another vehicle, not in a junction."""
        if leader[2] is None or car.change is not None or car.rear_segment != car.segment:
            return False
        name = car.line.lanes[car.segment]
        ahead = engine.cars[leader[2].vehicle].line.lanes[leader[2].segment]
        return not self.graph.lanes[name].junction and ahead == name and engine.time - car.settled >= BETWEEN_CHANGES

    def _consider(
        self, index: int, engine: "IdmEngine", lane: Lane, other: str, is_asked: bool = False
    ) -> DesiredChange | None:
        """Return the change to a lane beside, or None if it is unsafe, gains nothing unless asked, or does not fit."""
        car, leader = engine.cars[index], engine.leaders[index]
        begin, desired = car.begins[car.segment], car.desired_speed(car.station)
        row = int(np.ceil((car.station + AHEAD + EXTENSION) / PATH_STEP))
        start = row * PATH_STEP - EXTENSION
        front, aside = self.adjacent.at(lane.name, other, car.front - begin)
        least = blend_time(aside)
        length = max(MIN_LENGTH, least * min(desired, car.speed + GAIN_OF_SPEED))
        length = PATH_STEP * round(length / PATH_STEP)
        left = car.ends[car.segment] - lane.stop - car.front
        if start + length + car.shape.front + SETTLE > car.ends[car.segment] or left < request_distance(car.speed):
            return None
        _, later = self.adjacent.at(lane.name, other, start + length - begin)
        if max(aside, later) > FARTHEST_ASIDE * lane.width:
            return None  # the other lane begins later, ends earlier or bends away
        distance = start + CLEAR_SHARE * length - car.front
        if leader[0] + leader[1] * distance / max(car.speed, 2.0) < distance + STANDSTILL_GAP:
            return None
        rear = front - car.shape.length
        gap, speed = inf, 0.0
        for span in engine.spans.get(other, ()):
            if span.front > rear - SIDE_GAP:
                if span.rear < front + SIDE_GAP:
                    return None
                if span.rear - front < gap:
                    gap, speed = span.rear - front, engine.cars[span.vehicle].speed
        own = (
            follow_leader(car.speed, desired, car.headway, *leader[:2]),
            follow_leader(car.speed, desired, car.headway, gap, speed),
        )
        if own[1] < -SAFE_BRAKING or (own[1] - own[0] < THRESHOLD and not is_asked):
            return None
        if not self._has_place(engine, other, rear):
            return None
        new = _follower(engine, other, rear, index)
        new_change = (0.0, 0.0)
        if new is not None:
            behind = engine.cars[new[0]]
            before = _acceleration(behind, *engine.leaders[new[0]][:2])
            new_change = (before, _acceleration(behind, new[1], car.speed))
            if new_change[1] < -SAFE_BRAKING:
                return None
        old = _follower(engine, lane.name, car.rear - begin, index)
        old_change = (0.0, 0.0)
        if old is not None:
            behind, further = engine.cars[old[0]], old[1] + car.shape.length + leader[0]
            old_change = (_acceleration(behind, old[1], car.speed), _acceleration(behind, further, leader[1]))
        gain = advantage(own, new_change, old_change)
        pays = is_asked or gain > THRESHOLD
        return DesiredChange(other, row, length, length / least, gain, rear) if pays else None

    def _has_place(self, engine: "IdmEngine", other: str, rear: float) -> bool:
        """Return whether vehicles that may enter a lane still have room on it behind a new leader."""
        cars = [engine.cars[vehicle] for vehicle in {reservation.vehicle for reservation in engine.reservations}]
        return not any(
            passage.exit_lane == other and passage.exit_start > car.rear and rear < car.shape.length + 2 * ROOM
            for car in cars
            for passage in car.passages[: car.granted]
        )


def _acceleration(car: Car, gap: float, speed: float) -> float:
    return follow_leader(car.speed, car.desired_speed(car.station), car.headway, gap, speed)


def _follower(engine: "IdmEngine", lane: str, rear: float, index: int) -> tuple[int, float] | None:
    """Return the follower of a vehicle whose rear bumper is at a station of a lane, and how far behind it is [m]."""
    best: tuple[int, float] | None = None
    for span in engine.spans.get(lane, ()):
        if span.vehicle != index and span.front <= rear and (best is None or rear - span.front < best[1]):
            best = (span.vehicle, rear - span.front)
    if best is not None:
        return best
    for vehicle, car in enumerate(engine.cars):
        if vehicle == index:
            continue
        for segment in range(car.ahead[1] + 1, len(car.ends)):
            away = car.begins[segment] - car.front
            if away > LOOK_BACK:
                break
            if car.line.lanes[segment] == lane and (best is None or away + rear < best[1]):
                best = (vehicle, away + rear)
    return best


def _is_smooth(car: Car, plan: Plan) -> bool:
    """Return whether the new path needs no sudden braking."""
    row = int((car.station + EXTENSION) / PATH_STEP)
    ahead = int((car.station + car.speed + EXTENSION) / PATH_STEP)
    slowest = min(plan.limit[row : ahead + 1])
    return slowest >= min(car.speed - 0.3, car.desired_speed(car.station))
