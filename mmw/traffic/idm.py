"""Car following: each vehicle on its own path, braked by its leader, by bends and by junctions it may not enter yet."""

from dataclasses import dataclass, field
from math import sqrt

import numpy as np

from mmw.town.lanes import LaneGraph
from mmw.traffic.junctions import ConflictTable, Held, Passage, Request, grant_requests
from mmw.traffic.pose import Shape, Stance
from mmw.traffic.route import EXTENSION, PATH_STEP, Line

STEP = 0.05
"""Time step of the engine [s]."""

ACCELERATION = 1.8
"""IDM: comfortable acceleration [m/s^2]."""

BRAKING = 2.0
"""IDM: comfortable deceleration [m/s^2]."""

STANDSTILL_GAP = 2.0
"""IDM: gap between bumpers at rest [m]."""

HARDEST_BRAKING = 6.0
"""Limit of deceleration [m/s^2]."""

JERK = 5.0
"""Limit of the change of acceleration [m/s^3]."""

PREVIEW = 0.5
"""A driver looks this far ahead in time at the speed that the road asks for [s]."""

STOP_SHORT = 1.2
"""Vehicles wait with the bumper this far before the junction [m]."""

STOP_BRAKING = 1.8
"""Planned deceleration towards a stop line [m/s^2]."""

ROOM = 2.5
"""A vehicle enters a junction only if the lane behind it has its length and this much more [m]."""

COAST = 3.0
"""A vehicle on the exit lane is expected to brake no harder than this, which adds to the room [m/s^2]."""

STANDING = 0.5
"""A vehicle slower than this counts as standing [m/s]."""

BLOCKED_AFTER = 4.0
"""A vehicle that has stood this long on an exit lane may be blocked itself; before, it is expected to move on [s]."""


@dataclass
class Car:
    """A vehicle in the engine."""

    stance: Stance
    limit: list[float]
    """Wanted speed at every sample of the path [m/s]."""
    station: float
    """Front axle [m]."""
    headway: float
    """IDM: time gap [s]."""
    passages: list[Passage]
    speed: float = 0.0
    acceleration: float = 0.0
    granted: int = 0
    """Passages that the vehicle may enter, counted from the first."""
    segment: int = 0
    """Index of the lane under the front bumper."""
    rear_segment: int = 0
    """Index of the lane under the rear bumper."""
    stood: float = 0.0
    """Time since it last moved [s]."""
    begins: list[float] = field(default_factory=list)
    """Station where each lane of the path begins [m]."""

    def __post_init__(self) -> None:
        self.shape: Shape = self.stance.track.shape
        self.line: Line = self.stance.track.line
        self.ends: list[float] = self.line.ends.tolist()
        self.begins = [0.0, *self.ends[:-1]]

    @property
    def nose(self) -> float:
        """Station of the front bumper [m]."""
        return self.station + self.shape.front

    @property
    def tail(self) -> float:
        """Station of the rear bumper [m]."""
        return self.station - self.shape.behind

    def place(self) -> None:
        """Find the lanes under both bumpers."""
        while self.segment + 1 < len(self.ends) and self.nose >= self.ends[self.segment]:
            self.segment += 1
        while self.rear_segment < self.segment and self.tail >= self.ends[self.rear_segment]:
            self.rear_segment += 1

    def stop_station(self) -> float:
        """Return where the front bumper has to stop, as things are [m]."""
        if self.granted < len(self.passages):
            return self.passages[self.granted].start - STOP_SHORT
        return self.ends[-1] - STOP_SHORT

    def wanted_speed(self, station: float) -> float:
        """Return the speed that the road asks for at a station of the front axle [m/s]."""
        return self.limit[min(int((station + EXTENSION) / PATH_STEP), len(self.limit) - 1)]


def find_passages(line: Line, graph: LaneGraph, shape: Shape) -> list[Passage]:
    """Return the junctions on a path; those without room for the vehicle between them form one passage."""
    begins = [0.0, *line.ends[:-1].tolist()]
    ends = line.ends.tolist()
    passages: list[Passage] = []
    index = 0
    while index < len(line.lanes):
        if not graph.lanes[line.lanes[index]].junction:
            index += 1
            continue
        first = index
        connections = []
        while index < len(line.lanes):
            lane = graph.lanes[line.lanes[index]]
            if lane.junction:
                connections.append((lane.name, begins[index], ends[index]))
            elif ends[index] - begins[index] >= shape.length + ROOM:
                break
            index += 1
        has_exit = index < len(line.lanes)
        passages.append(
            Passage(
                connections=tuple(connections),
                start=begins[first],
                first_segment=first,
                exit_lane=line.lanes[index] if has_exit else "",
                exit_start=begins[index] if has_exit else ends[-1],
                priority=graph.lanes[line.lanes[first]].priority,
            )
        )
    return passages


@dataclass(frozen=True)
class Mark:
    """A vehicle on a lane; stations from the start of the lane [m]."""

    rear: float
    front: float
    vehicle: int
    segment: int


class Engine:
    """All vehicles of a scenario, advanced together in fixed steps."""

    def __init__(self, graph: LaneGraph, cars: list[Car]) -> None:
        """Place the vehicles and give them a first speed that lets everybody stop in comfort."""
        self.cars = cars
        self.table = ConflictTable(graph)
        self.held: list[Held] = []
        self.time = 0.0
        for car in cars:
            car.place()
        self.marks = self._mark_lanes()
        for index, car in enumerate(cars):
            gap, _, _ = self._leader(index)
            stop = max(0.0, car.stop_station() - car.nose)
            following = max(0.0, gap - STANDSTILL_GAP) / 2.0
            car.speed = min(car.wanted_speed(car.station), sqrt(2 * 1.2 * stop), following)

    def run(self, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Advance and return stations [m] and speeds [m/s] at every step, start included, shape [steps + 1, V]."""
        station = [[car.station for car in self.cars]]
        speed = [[car.speed for car in self.cars]]
        for _ in range(steps):
            self._advance()
            station.append([car.station for car in self.cars])
            speed.append([car.speed for car in self.cars])
        return np.array(station), np.array(speed)

    def _advance(self) -> None:
        self.marks = self._mark_lanes()
        leaders = [self._leader(index) for index in range(len(self.cars))]
        self._grant(leaders)
        wishes = [self._wish(car, *leader[:2]) for car, leader in zip(self.cars, leaders, strict=True)]
        for car, wish in zip(self.cars, wishes, strict=True):
            _integrate(car, wish)
            car.stood = car.stood + STEP if car.speed < STANDING else 0.0
            car.place()
        self.time += STEP

    def _mark_lanes(self) -> dict[str, list[Mark]]:
        marks: dict[str, list[Mark]] = {}
        for index, car in enumerate(self.cars):
            for segment in range(car.rear_segment, car.segment + 1):
                begin = car.begins[segment]
                mark = Mark(car.tail - begin, car.nose - begin, index, segment)
                marks.setdefault(car.line.lanes[segment], []).append(mark)
        return marks

    def _leader(self, index: int) -> tuple[float, float, Mark | None]:
        """Return gap [m], speed [m/s] and mark of the next vehicle on the path; infinite gap if there is none."""
        car = self.cars[index]
        nose = car.nose
        horizon = nose + 15.0 + car.speed * (car.headway + 1.0) + car.speed**2 / BRAKING
        for segment in range(car.segment, len(car.ends)):
            begin = car.begins[segment]
            if begin > horizon:
                break
            best: Mark | None = None
            for mark in self.marks.get(car.line.lanes[segment], ()):
                if mark.vehicle == index or (best is not None and mark.rear >= best.rear):
                    continue
                if segment == car.segment and mark.front <= nose - begin:
                    continue
                best = mark
            if best is not None:
                return begin + best.rear - nose, self.cars[best.vehicle].speed, best
        return np.inf, 0.0, None

    def _grant(self, leaders: list[tuple[float, float, Mark | None]]) -> None:
        self.held = [hold for hold in self.held if self.cars[hold.vehicle].tail < hold.end]
        requests = []
        for index, car in enumerate(self.cars):
            if car.granted == len(car.passages):
                continue
            away = car.stop_station() - car.nose
            if away > car.speed**2 / (2 * STOP_BRAKING) + (PREVIEW + 0.3) * car.speed + 2.0:
                continue
            if self._waits_behind(car, leaders[index][2]):
                continue
            passage = car.passages[car.granted]
            if np.isnan(passage.asked_at):
                passage.asked_at = self.time
            requests.append(Request(index, car.shape, passage, *self._room(index, passage)))
        if requests:
            station = [car.station for car in self.cars]
            for index in grant_requests(self.table, requests, self.held, station, self.time):
                self.cars[index].granted += 1

    def _waits_behind(self, car: Car, mark: Mark | None) -> bool:
        """Return whether the leader still needs the permission that the vehicle would ask for."""
        if mark is None:
            return False
        leader = self.cars[mark.vehicle]
        name = leader.line.lanes[mark.segment]
        segment = car.line.lanes.index(name, car.rear_segment)
        mine = car.stop_station() - car.begins[segment]
        return mark.rear < mine and leader.stop_station() - leader.begins[mark.segment] < mine + 0.5

    def _room(self, index: int, passage: Passage) -> tuple[bool, bool]:
        """Return whether there is room behind a junction now, and whether there will be once others have moved on."""
        if not passage.exit_lane:
            return True, True
        car = self.cars[index]
        segment = car.line.lanes.index(passage.exit_lane, passage.first_segment)
        now = soon = car.ends[segment] - car.begins[segment]
        inside = {index}
        for mark in self.marks.get(passage.exit_lane, ()):
            if mark.vehicle not in inside:
                inside.add(mark.vehicle)
                leader = self.cars[mark.vehicle]
                now = min(now, mark.rear + leader.speed**2 / (2 * COAST))
                soon = min(soon, mark.rear) if leader.stood > BLOCKED_AFTER else soon
        for other in {hold.vehicle for hold in self.held} - inside:
            leader = self.cars[other]
            ways = leader.passages[: leader.granted]
            if any(way.exit_lane == passage.exit_lane and way.exit_start > leader.nose for way in ways):
                now -= leader.shape.length + STANDSTILL_GAP
        need = car.shape.length + ROOM
        return now >= need, soon >= need

    def _wish(self, car: Car, gap: float, leader_speed: float) -> float:
        """Return the acceleration that the driver wants [m/s^2].

        Source: intelligent driver model, Treiber, Hennecke, Helbing, Phys. Rev. E 62 (2000), 1805, equations 3 and 4,
        with exponent 4; bends and stop lines are speeds to be reached at a point, followed with a preview.
        """
        speed = car.speed
        wanted = car.wanted_speed(car.station)
        wish = free = max(ACCELERATION * (1 - (speed / wanted) ** 4), -BRAKING)
        if gap < np.inf:
            closing = speed * (speed - leader_speed) / (2 * sqrt(ACCELERATION * BRAKING))
            target = STANDSTILL_GAP + max(0.0, speed * car.headway + closing)
            wish = free - ACCELERATION * (target / max(gap, 0.1)) ** 2
        ahead = car.station + speed * PREVIEW
        wish = min(wish, (car.wanted_speed(ahead) - speed) / PREVIEW)
        left = car.stop_station() - car.nose - speed * PREVIEW
        wish = min(wish, (sqrt(2 * STOP_BRAKING * max(0.0, left)) - speed) / PREVIEW)
        return max(wish, -HARDEST_BRAKING)


def _integrate(car: Car, wish: float) -> None:
    """Move a vehicle by one step with linearly changing acceleration."""
    if car.speed == 0.0 and wish < 0.1:
        car.acceleration = 0.0
        return
    before = car.acceleration
    after = min(max(wish, before - JERK * STEP), before + JERK * STEP)
    after = max(after, -sqrt(2 * JERK * car.speed))  # can still be let go before the vehicle stands
    speed = car.speed + 0.5 * STEP * (before + after)
    if speed <= 0.0:
        car.station += max(0.0, car.speed * STEP / 3)
        car.speed = car.acceleration = 0.0
        return
    car.station += max(0.0, car.speed * STEP + STEP**2 * (2 * before + after) / 6)
    car.speed, car.acceleration = speed, after
