"""Changes of lanes: who wants one, whether it is safe, and the line that it follows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from mmw.traffic.idm.driver import STANDSTILL_GAP, asking_distance, follow_leader
from mmw.traffic.idm.junctions import Held
from mmw.traffic.idm.vehicle import ROOM, Car, Mark, Plan, count_entered
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.traffic.route import EXTENSION, PATH_STEP, Line, branch_line, plan_stations

POLITENESS = 0.25
"""MOBIL: weight of what others gain or lose. Source: Kesting, Treiber, Helbing 2007: 0.2 to 0.5 are realistic."""

THRESHOLD = 0.2
"""MOBIL: least advantage [m/s^2]. Source: as above, 0.1; more here, since every change takes a new route."""

SAFE_BRAKING = 2.0
"""MOBIL: hardest braking that a change may ask of the new follower, and of the driver [m/s^2]; the comfortable one."""

BETWEEN_CHANGES = 6.0
"""Least time from one change, begun or found impossible, to the next [s]; design value."""

DECIDE_EVERY = 10
"""Engine steps from one look at the neighbour lanes to the next."""

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
"""From this share of the change on, a vehicle is out of the way of those on the lane that it leaves: 2.9 m of 3.5 m."""

SETTLE = 3.0
"""The front bumper is on the middle of the new lane this far before the lane ends [m]."""

FARTHEST_ASIDE = 1.6
"""Lanes lie side by side where their middles are at most this many lane widths apart."""

SIDE_GAP = 1.0
"""Bumpers of vehicles on the new lane must be this far from those of the vehicle [m]."""

LOOK_BACK = 60.0
"""New followers are looked for this far behind the beginning of the new lane [m]."""

Leader = tuple[float, float, Mark | None]
"""Gap [m], inf if there is none; speed [m/s]; who it is."""


@dataclass(frozen=True)
class View:
    """State of the engine at one step."""

    cars: Sequence[Car]
    marks: dict[str, list[Mark]]
    """Vehicles on every lane; those who change lanes are on both."""
    leaders: Sequence[Leader]
    held: list[Held]
    time: float
    """[s]."""
    step: int
    """Steps since the engine's start (count)."""


def advantage(own: tuple[float, float], new: tuple[float, float], old: tuple[float, float]) -> float:
    """Return what a change brings to the driver and, weighted, to both followers [m/s^2].

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
    """Return how long a change of lanes takes at least [s], for a distance aside [m]."""
    return (QUINTIC_PEAK * aside / LATERAL_ACCELERATION) ** 0.5


class Beside:
    """Mapping of a position on one lane to the lane beside it, computed on first use."""

    def __init__(self, graph: LaneGraph) -> None:
        """Keep the lanes."""
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
        ends = []
        for lane, at in ((self.graph.lanes[name], station), (self.graph.lanes[other], across)):
            along = plan_stations(lane)
            ends.append([float(np.interp(at, along, lane.points[:, axis])) for axis in range(2)])
        return across, float(np.hypot(ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]))

    def line(self, car: Car, other: str, start: int, length: float, onward: Sequence[Lane]) -> tuple[Line, list[float]]:
        """Return the line of a change to a lane and on, and where each of its lanes begins [m].

        Args:
            car: Who changes.
            other: Name of the lane beside it.
            start: Row of the car's line where the change begins.
            length: Length of the change [m].
            onward: Lanes after `other`.
        """
        line, lane = car.line, self.graph.lanes[other]
        count = round(length / PATH_STEP)
        rows = np.arange(start, start + count + 1)
        here = line.station[rows] - car.begins[car.segment]
        there = self.across(line.lanes[car.segment], other, here)
        along = plan_stations(lane)
        beside = np.stack([np.interp(there, along, lane.points[:, axis]) for axis in range(3)], axis=1)
        share = blend_share(np.arange(count + 1) / count)[:, None]
        change = line.points[rows] + share * (beside - line.points[rows])
        rest = lane.points[along > there[-1] + 1e-6]
        parts = [change, rest, *(after.points for after in onward)]
        last = np.cumsum([len(part) for part in parts])[1:] - 1
        names = (line.lanes[car.segment], other, *(after.name for after in onward))
        new = branch_line(line, start, np.concatenate(parts), names, [count // 2, *last])
        reached = line.station[start] + float(np.linalg.norm(np.diff(change[:, :2], axis=0), axis=1).sum())
        ends = new.ends.tolist()
        begins = [*car.begins[: car.segment + 1], reached - float(there[-1]), *ends[car.segment + 1 : -1]]
        return new, begins


def _project(lane: Lane, other: Lane) -> tuple[np.ndarray, np.ndarray]:
    """Return stations on a lane, and those of the nearest places on another one, ascending."""
    a, step = other.points[:-1, :2], np.diff(other.points[:, :2], axis=0)
    square = (step**2).sum(axis=1).clip(1e-12)
    to = lane.points[:, None, :2] - a
    share = np.clip((to * step).sum(axis=-1) / square, 0, 1)
    miss = np.linalg.norm(to - share[..., None] * step, axis=-1)
    best = miss.argmin(axis=1)
    rows = np.arange(len(best))
    found = plan_stations(other)[best] + share[rows, best] * np.sqrt(square[best])
    return plan_stations(lane), np.maximum.accumulate(found)


@dataclass(frozen=True)
class Wanted:
    """A change of lanes that a driver wants and that is safe."""

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
    """Decides for all vehicles, and has their ways planned anew."""

    def __init__(self, graph: LaneGraph, beside: Beside, plan: Callable[[int, Car, Wanted, float], Plan | None]):
        """Keep the lanes.

        Args:
            graph: The town's lanes.
            beside: Which places of two lanes lie side by side.
            plan: Returns the way of vehicle (index, car) with a wanted change at a time [s], None if it has none.
        """
        self.graph = graph
        self.beside = beside
        self.plan = plan
        self.done: list[tuple[float, int, str, str]] = []
        """Time [s], vehicle, lane before, lane after."""

    def decide(self, view: View) -> None:
        """Begin the changes that are due; the cars and the marks are changed in place."""
        for index, car in enumerate(view.cars):
            if (view.step + 3 * index) % DECIDE_EVERY or not self._is_free(car, view, view.leaders[index]):
                continue
            lane = self.graph.lanes[car.line.lanes[car.segment]]
            options = [self._consider(index, view, lane, side) for side in (lane.left, lane.right) if side]
            options = [option for option in options if option is not None]
            if not options:
                continue
            best = max(options, key=lambda option: option.advantage)
            car.settled = view.time
            plan = self.plan(index, car, best, view.time)
            if plan is None or not _can_take(car, plan):
                continue
            car.follow(plan)
            car.granted = count_entered(plan.passages, car.segment)
            view.held[:] = [hold for hold in view.held if hold.vehicle != index or hold.start < car.nose]
            car.changes += 1
            self.done.append((view.time, index, lane.name, best.lane))
            mark = Mark(best.rear, best.rear + car.shape.length, index, car.segment + 1)
            view.marks.setdefault(best.lane, []).append(mark)

    def _is_free(self, car: Car, view: View, leader: Leader) -> bool:
        """Return whether a driver may think of a change: on one lane, behind somebody, not in a junction."""
        if leader[2] is None or car.change is not None or car.rear_segment != car.segment:
            return False
        name = car.line.lanes[car.segment]
        ahead = view.cars[leader[2].vehicle].line.lanes[leader[2].segment]
        return not self.graph.lanes[name].junction and ahead == name and view.time - car.settled >= BETWEEN_CHANGES

    def _consider(self, index: int, view: View, lane: Lane, other: str) -> Wanted | None:
        """Return the change to a lane beside, or None if it is unsafe, brings nothing or does not fit."""
        car, leader = view.cars[index], view.leaders[index]
        begin, wanted = car.begins[car.segment], car.wanted_speed(car.station)
        row = int(np.ceil((car.station + AHEAD + EXTENSION) / PATH_STEP))
        start = row * PATH_STEP - EXTENSION
        front, aside = self.beside.at(lane.name, other, car.nose - begin)
        least = blend_time(aside)
        length = max(MIN_LENGTH, least * min(wanted, car.speed + GAIN_OF_SPEED))
        length = PATH_STEP * round(length / PATH_STEP)
        left = car.ends[car.segment] - lane.stop - car.nose
        if start + length + car.shape.front + SETTLE > car.ends[car.segment] or left < asking_distance(car.speed):
            return None
        _, later = self.beside.at(lane.name, other, start + length - begin)
        if max(aside, later) > FARTHEST_ASIDE * lane.width:
            return None  # the other lane begins later, ends earlier or bends away
        way = start + CLEAR_SHARE * length - car.nose
        if leader[0] + leader[1] * way / max(car.speed, 2.0) < way + STANDSTILL_GAP:
            return None
        rear = front - car.shape.length
        gap, speed = inf, 0.0
        for mark in view.marks.get(other, ()):
            if mark.front > rear - SIDE_GAP:
                if mark.rear < front + SIDE_GAP:
                    return None
                if mark.rear - front < gap:
                    gap, speed = mark.rear - front, view.cars[mark.vehicle].speed
        own = (
            follow_leader(car.speed, wanted, car.headway, *leader[:2]),
            follow_leader(car.speed, wanted, car.headway, gap, speed),
        )
        if own[1] < -SAFE_BRAKING or own[1] - own[0] < THRESHOLD:
            return None
        if not self._has_place(view, other, rear):
            return None
        new = _follower(view, other, rear, index)
        new_change = (0.0, 0.0)
        if new is not None:
            behind = view.cars[new[0]]
            before = _acceleration(behind, *view.leaders[new[0]][:2])
            new_change = (before, _acceleration(behind, new[1], car.speed))
            if new_change[1] < -SAFE_BRAKING:
                return None
        old = _follower(view, lane.name, car.tail - begin, index)
        old_change = (0.0, 0.0)
        if old is not None:
            behind, further = view.cars[old[0]], old[1] + car.shape.length + leader[0]
            old_change = (_acceleration(behind, old[1], car.speed), _acceleration(behind, further, leader[1]))
        gain = advantage(own, new_change, old_change)
        return Wanted(other, row, length, length / least, gain, rear) if gain > THRESHOLD else None

    def _has_place(self, view: View, other: str, rear: float) -> bool:
        """Return whether those who have been let into a lane still have room on it behind a new leader."""
        for vehicle in {hold.vehicle for hold in view.held}:
            car = view.cars[vehicle]
            for way in car.passages[: car.granted]:
                if way.exit_lane == other and way.exit_start > car.tail and rear < car.shape.length + 2 * ROOM:
                    return False
        return True


def _acceleration(car: Car, gap: float, speed: float) -> float:
    return follow_leader(car.speed, car.wanted_speed(car.station), car.headway, gap, speed)


def _follower(view: View, lane: str, rear: float, index: int) -> tuple[int, float] | None:
    """Return who would follow a vehicle whose rear bumper is at a station of a lane, and how far behind [m]."""
    best: tuple[int, float] | None = None
    for mark in view.marks.get(lane, ()):
        if mark.vehicle != index and mark.front <= rear and (best is None or rear - mark.front < best[1]):
            best = (mark.vehicle, rear - mark.front)
    if best is not None:
        return best
    for vehicle, car in enumerate(view.cars):
        if vehicle == index:
            continue
        for segment in range(car.ahead[1] + 1, len(car.ends)):
            away = car.begins[segment] - car.nose
            if away > LOOK_BACK:
                break
            if car.line.lanes[segment] == lane and (best is None or away + rear < best[1]):
                best = (vehicle, away + rear)
    return best


def _can_take(car: Car, plan: Plan) -> bool:
    """Return whether the new way asks for no sudden braking."""
    row = int((car.station + EXTENSION) / PATH_STEP)
    ahead = int((car.station + car.speed + EXTENSION) / PATH_STEP)
    slowest = min(plan.limit[row : ahead + 1])
    return slowest >= min(car.speed - 0.3, car.wanted_speed(car.station))
