"""The engine: all vehicles advanced together, each braked by its leader, by bends and by junctions not yet free."""

from math import inf, isnan, sqrt

import numpy as np

from mmw.traffic.idm.driver import (
    BRAKING,
    PREVIEW,
    STANDSTILL_GAP,
    STEP,
    asking_distance,
    desired_acceleration,
    follow_leader,
    integrate,
)
from mmw.traffic.idm.junctions import ConflictTable, Held, Passage, Request, grant_requests
from mmw.traffic.idm.lane_change import LaneChanges, Leader, View
from mmw.traffic.idm.vehicle import ROOM, STOP_BRAKING, Car, Mark, usable_length
from mmw.traffic.idm.wait_causes import STANDING, find_causes
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.signals import SignalPlan, must_stop, shown, turns_left

COAST = 3.0
"""A vehicle on the exit lane is expected to brake no harder than this, which adds to the room [m/s^2]."""

BLOCKED_AFTER = 4.0
"""A vehicle that has stood this long on an exit lane may be blocked itself; before, it is expected to move on [s]."""

QUEUE_GAP = 5.0
"""A standing vehicle whose leader is nearer than this waits for it [m]."""


class Engine:
    """All vehicles of a scenario, advanced together in fixed steps."""

    def __init__(
        self,
        graph: LaneGraph,
        cars: list[Car],
        changes: LaneChanges | None = None,
        plans: dict[str, SignalPlan] | None = None,
        start: float = 0.0,
    ) -> None:
        """Place the vehicles and give them a first speed that lets everybody stop in comfort.

        Args:
            graph: The town's lanes.
            cars: The vehicles; they are moved in place.
            changes: Decides about changes of lanes; nobody changes without it.
            plans: Traffic lights by junction; without them, or where a junction has none, priorities count.
            start: Time at the first step, on the clock of the traffic lights [s].
        """
        self.graph = graph
        self.cars = cars
        self.changes = changes
        self.plans = plans or {}
        self.start = start
        self.table = ConflictTable(graph)
        self.held: list[Held] = []
        self.time = 0.0
        self.steps = 0
        self.states: dict[str, dict[str, str]] = {}
        self.blockers: dict[int, list[int]] = {}
        """Vehicle -> those that it waits for, at this step."""
        self.at_red: set[int] = set()
        """Vehicles that wait for green, at this step."""
        for car in cars:
            car.place()
        self.marks = self._mark_lanes()
        for index, car in enumerate(cars):
            gap, _, _ = self._leader(index)
            stop = max(0.0, car.stop_station() - car.nose)
            following = max(0.0, gap - STANDSTILL_GAP) / 2.0
            car.speed = min(car.wanted_speed(car.station), sqrt(2 * 1.2 * stop), following)

    def run(self, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Advance the vehicles.

        Returns:
            Stations [m], speeds [m/s] and whether a vehicle stands with a cause, at every step, start included, each
            of shape [steps + 1, V].
        """
        station = [[car.station for car in self.cars]]
        speed = [[car.speed for car in self.cars]]
        waits = [[False] * len(self.cars)]
        for _ in range(steps):
            self._advance()
            station.append([car.station for car in self.cars])
            speed.append([car.speed for car in self.cars])
            waits.append(find_causes([car.speed for car in self.cars], self.blockers, self.at_red))
        return np.array(station), np.array(speed), np.array(waits)

    def _advance(self) -> None:
        self.blockers, self.at_red = {}, set()
        self.marks = self._mark_lanes()
        leaders = [self._leader(index) for index in range(len(self.cars))]
        if self.plans:
            self._show_lights()
        self._grant(leaders)
        if self.changes is not None:
            self.changes.decide(View(self.cars, self.marks, leaders, self.held, self.time, self.steps))
        wishes = [desired_acceleration(car, *leader[:2]) for car, leader in zip(self.cars, leaders, strict=True)]
        for index, (car, wanted) in enumerate(zip(self.cars, wishes, strict=True)):
            integrate(car, wanted)
            car.stopped_time = car.stopped_time + STEP if car.speed < STANDING else 0.0
            car.place()
            gap, _, mark = leaders[index]
            if mark is not None and gap < QUEUE_GAP:
                self.blockers.setdefault(index, []).append(mark.vehicle)
        self.time += STEP
        self.steps += 1

    def _mark_lanes(self) -> dict[str, list[Mark]]:
        marks: dict[str, list[Mark]] = {}
        for index, car in enumerate(self.cars):
            first, last = car.occupied
            for segment in range(first, last + 1):
                begin = car.begins[segment]
                mark = Mark(car.tail - begin, car.nose - begin, index, segment)
                marks.setdefault(car.line.lanes[segment], []).append(mark)
        return marks

    def _leader(self, index: int) -> Leader:
        """Return gap [m], speed [m/s] and mark of the next vehicle on the path; infinite gap if there is none.

        During a change of lanes there may be one on each; the one that asks for more braking counts. Who is on the lane
        that is left, but farther ahead than the vehicle goes on that lane, does not count.
        """
        car = self.cars[index]
        nose = car.nose
        horizon = nose + 15.0 + car.speed * (car.headway + 1.0) + car.speed**2 / BRAKING
        first, last = car.ahead
        found: list[Leader] = []
        for segment in range(first, len(car.ends)):
            begin = car.begins[segment]
            if begin > horizon:
                break
            best: Mark | None = None
            for mark in self.marks.get(car.line.lanes[segment], ()):
                if mark.vehicle == index or (best is not None and mark.rear >= best.rear):
                    continue
                if segment <= last and mark.front <= nose - begin:
                    continue
                best = mark
            if best is None:
                continue
            gap = begin + best.rear - nose
            reach = car.shape.front + STANDSTILL_GAP
            if segment < last and car.change is not None and nose + gap >= car.change.clear + reach:
                continue
            found.append((gap, self.cars[best.vehicle].speed, best))
            if segment >= last:
                break
        if len(found) > 1:
            wanted = car.wanted_speed(car.station)
            return min(found, key=lambda leader: follow_leader(car.speed, wanted, car.headway, *leader[:2]))
        return found[0] if found else (inf, 0.0, None)

    def _show_lights(self) -> None:
        """Read the lights; who has been let in and can still stop does so when the light leaves green."""
        self.states = {name: plan.state(self.start + self.time) for name, plan in self.plans.items()}
        for index, car in enumerate(self.cars):
            for number, passage in enumerate(car.passages[: car.granted]):
                away = passage.stop - car.nose
                lane = self.graph.lanes[passage.connections[0][0]]
                if away <= 0 or shown(self.states, lane) == "green" or not must_stop(away, car.speed):
                    continue
                for revoked in car.passages[number : car.granted]:
                    revoked.asked_at = np.nan
                car.granted = number
                self.held = [hold for hold in self.held if hold.vehicle != index or hold.start < passage.start]
                car.stop_braking = max(STOP_BRAKING, car.speed**2 / (2 * max(away - PREVIEW * car.speed, 0.1)))
                break

    def _grant(self, leaders: list[Leader]) -> None:
        self.held = [hold for hold in self.held if self.cars[hold.vehicle].tail < hold.end]
        requests = []
        for index, car in enumerate(self.cars):
            if car.granted == len(car.passages):
                continue
            away = car.stop_station() - car.nose
            if away > asking_distance(car.speed):
                continue
            if self._waits_behind(car, leaders[index][2]):
                continue
            passage = car.passages[car.granted]
            ways = [self.graph.lanes[name] for name, _, _ in passage.connections]
            if any(shown(self.states, way) != "green" for way in ways):
                self.at_red.add(index)
                continue
            if isnan(passage.asked_at):
                passage.asked_at = self.time
            lit = bool(ways[0].signal and self.states)
            has_room, will_have_room, before = self._room(index, passage)
            waits = lit and turns_left(ways[0])
            requests.append(Request(index, car.shape, passage, has_room, will_have_room, before, lit, waits))
        if requests:
            station = [car.station for car in self.cars]
            for index in grant_requests(self.table, requests, self.held, station, self.time, self.blockers):
                self.cars[index].granted += 1
                self.cars[index].stop_braking = STOP_BRAKING

    def _waits_behind(self, car: Car, mark: Mark | None) -> bool:
        """Return whether the leader still needs the permission that the vehicle would ask for."""
        if mark is None:
            return False
        leader = self.cars[mark.vehicle]
        name = leader.line.lanes[mark.segment]
        segment = car.index_of(name)
        mine = car.stop_station() - car.begins[segment]
        return mark.rear < mine and leader.stop_station() - leader.begins[mark.segment] < mine + 0.5

    def _room(self, index: int, passage: Passage) -> tuple[bool, bool, tuple[int, ...]]:
        """Return whether there is room behind a junction now, whether there will be once others have moved on, and who
        is there or on the way there."""
        if not passage.exit_lane:
            return True, True, ()
        car = self.cars[index]
        segment = car.index_of(passage.exit_lane, passage.first_segment)
        now = soon = usable_length(self.graph.lanes[passage.exit_lane], car.begins[segment], car.ends[segment])
        inside = {index}
        for mark in self.marks.get(passage.exit_lane, ()):
            if mark.vehicle not in inside:
                inside.add(mark.vehicle)
                leader = self.cars[mark.vehicle]
                now = min(now, mark.rear + leader.speed**2 / (2 * COAST))
                soon = min(soon, mark.rear) if leader.stopped_time > BLOCKED_AFTER else soon
        for other in {hold.vehicle for hold in self.held} - inside:
            leader = self.cars[other]
            ways = leader.passages[: leader.granted]
            if any(way.exit_lane == passage.exit_lane and way.exit_start > leader.nose for way in ways):
                inside.add(other)
                now -= leader.shape.length + STANDSTILL_GAP
        need = car.shape.length + ROOM
        return now >= need, soon >= need, tuple(sorted(inside - {index}))
