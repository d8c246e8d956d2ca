"""Advance all vehicles together: each is braked by its leader, by bends and by junctions that are not free."""

from math import inf, isnan, sqrt

import numpy as np

from mmw.traffic.idm.driver import (
    BRAKING,
    PREVIEW,
    STANDSTILL_GAP,
    STEP,
    desired_acceleration,
    follow_leader,
    integrate,
    request_distance,
)
from mmw.traffic.idm.junctions import Passage, Request, Reservation, conflict_table, grant_requests
from mmw.traffic.idm.lane_change import LaneChanges, Leader
from mmw.traffic.idm.open_ends import Arrivals
from mmw.traffic.idm.vehicle import ROOM, STOP_BRAKING, Car, OccupiedSpan, usable_length
from mmw.traffic.idm.wait_causes import STANDING
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.signals import SignalPlan, light_state, must_stop, turns_left

COAST = 3.0
"""A vehicle on the exit lane is expected to brake no harder than this, which adds to the room [m/s^2]."""

BLOCKED_AFTER = 4.0
"""A vehicle stopped for longer on an exit lane may be blocked itself; before, it is expected to move on [s]."""

QUEUE_GAP = 5.0
"""A standing vehicle whose leader is nearer than this waits for it [m]."""


class IdmEngine:
    """All vehicles of a scenario, advanced together in steps of 50 ms."""

    def __init__(
        self,
        graph: LaneGraph,
        cars: list[Car],
        changes: LaneChanges | None = None,
        plans: dict[str, SignalPlan] | None = None,
        start: float = 0.0,
        arrivals: Arrivals | None = None,
    ) -> None:
        """Place the vehicles and give them a first speed from which all can stop in comfort.

        Args:
            graph: The town's lanes.
            cars: The vehicles; they are moved in place.
            changes: Decides about changes of lanes; None for no changes.
            plans: Traffic lights by junction; elsewhere priorities count.
            start: Time at the first step, on the clock of the traffic lights [s].
            arrivals: Lets vehicles enter for those that leave; None if nobody enters.
        """
        self.graph = graph
        self.cars = cars
        self.changes = changes
        self.plans = plans or {}
        self.start = start
        self.arrivals = arrivals
        self.table = conflict_table(graph)
        self.reservations: list[Reservation] = []
        self.leaders: list[Leader] = []
        self.time = 0.0
        """Time since the first step [s]."""
        self.steps = 0
        self.states: dict[str, dict[str, str]] = {}
        self.blockers: dict[int, list[int]] = {}
        """Vehicle -> those that it waits for, at this step."""
        self.at_red: set[int] = set()
        """Vehicles that wait for green, at this step."""
        for car in cars:
            car.place()
        self.spans = self._find_spans()
        for index in range(len(cars)):
            self._set_first_speed(index)

    def _set_first_speed(self, index: int) -> None:
        car = self.cars[index]
        gap, _, _ = self._leader(index)
        stop = max(0.0, car.stop_station() - car.front)
        following = max(0.0, gap - STANDSTILL_GAP) / 2.0
        car.speed = min(car.desired_speed(car.station), sqrt(2 * 1.2 * stop), following)

    def add(self, car: Car) -> None:
        """Let a vehicle enter, with a speed from which it can stop in comfort."""
        car.entered_at = self.steps
        car.place()
        self.cars.append(car)
        self._set_first_speed(len(self.cars) - 1)

    def step(self) -> None:
        """Advance all vehicles by `STEP` seconds."""
        self.blockers, self.at_red = {}, set()
        self.spans = self._find_spans()
        self.leaders = leaders = [self._leader(index) for index in range(len(self.cars))]
        if self.plans:
            self._show_lights()
        self._grant(leaders)
        if self.changes is not None:
            self.changes.decide(self)
        desired = [self._desire(index, leader) for index, leader in enumerate(leaders)]
        for index, (car, acceleration) in enumerate(zip(self.cars, desired, strict=True)):
            if car.left_at is not None:
                car.stand_at(car.station + STEP * car.speed)  # unseen, so that its last motion can be smoothed
                continue
            integrate(car, acceleration)
            car.stopped_time = car.stopped_time + STEP if car.speed < STANDING else 0.0
            car.place()
            gap, _, span = leaders[index]
            if span is not None and gap < QUEUE_GAP:
                self.blockers.setdefault(index, []).append(span.vehicle)
            if car.plan.leaves and car.front >= car.ends[-1]:
                car.left_at = self.steps + 1
        self.time += STEP
        self.steps += 1
        if self.arrivals is not None:
            self.arrivals.admit(self)

    def _desire(self, index: int, leader: Leader) -> float:
        """Return the acceleration that the driver of a vehicle behind a leader desires [m/s^2]."""
        return desired_acceleration(self.cars[index], *leader[:2])

    def _find_spans(self) -> dict[str, list[OccupiedSpan]]:
        spans: dict[str, list[OccupiedSpan]] = {}
        for index, car in enumerate(self.cars):
            if car.left_at is not None:
                continue
            first, last = car.occupied
            rear, front, begins, lanes = car.rear, car.front, car.begins, car.lanes
            for segment in range(first, last + 1):
                begin = begins[segment]
                span = OccupiedSpan(rear - begin, front - begin, index, segment)
                spans.setdefault(lanes[segment], []).append(span)
        return spans

    def _leader(self, index: int) -> Leader:
        """Return gap [m], speed [m/s] and span of the next vehicle on the path; infinite gap if there is none.

        During a change of lanes there may be one on each; the one that needs more braking counts, unless the vehicle
        leaves its lane before reaching it.
        """
        car = self.cars[index]
        if car.left_at is not None:
            return inf, 0.0, None
        front, begins, lanes, spans = car.front, car.begins, car.lanes, self.spans
        horizon = front + 15.0 + car.speed * (car.headway + 1.0) + car.speed**2 / BRAKING
        first, last = car.ahead
        found: list[Leader] = []
        for segment in range(first, len(car.ends)):
            begin = begins[segment]
            if begin > horizon:
                break
            others = spans.get(lanes[segment])
            if others is None:
                continue
            best: OccupiedSpan | None = None
            nearest, least = inf, front - begin if segment <= last else -inf
            for span in others:
                if span.rear < nearest and span.front > least and span.vehicle != index:
                    best, nearest = span, span.rear
            if best is None:
                continue
            gap = begin + nearest - front
            reach = car.shape.front + STANDSTILL_GAP
            if segment < last and car.change is not None and front + gap >= car.change.clear + reach:
                continue
            found.append((gap, self.cars[best.vehicle].speed, best))
            if segment >= last:
                break
        if len(found) > 1:
            desired = car.desired_speed(car.station)
            return min(found, key=lambda leader: follow_leader(car.speed, desired, car.headway, *leader[:2]))
        return found[0] if found else (inf, 0.0, None)

    def _show_lights(self) -> None:
        """Read the lights; a vehicle that may enter but can still stop does so when the light leaves green."""
        self.states = {name: plan.state(self.start + self.time) for name, plan in self.plans.items()}
        for index, car in enumerate(self.cars):
            for number, passage in enumerate(car.passages[: car.granted]):
                away = passage.stop - car.front
                lane = self.graph.lanes[passage.connections[0][0]]
                if away <= 0 or light_state(self.states, lane) == "green" or not must_stop(away, car.speed):
                    continue
                for revoked in car.passages[number : car.granted]:
                    revoked.requested_at = np.nan
                car.granted = number
                self.cancel_reservations(index, passage.start)
                car.stop_braking = max(STOP_BRAKING, car.speed**2 / (2 * max(away - PREVIEW * car.speed, 0.1)))
                break

    def cancel_reservations(self, vehicle: int, station: float) -> None:
        """Give up what a vehicle has reserved from a station on [m]."""
        self.reservations = [
            reservation
            for reservation in self.reservations
            if reservation.vehicle != vehicle or reservation.start < station
        ]

    def _grant(self, leaders: list[Leader]) -> None:
        self.reservations = [
            reservation for reservation in self.reservations if self.cars[reservation.vehicle].rear < reservation.end
        ]
        requests = []
        # Vehicles with a reservation, and the exits that they have not reached.
        reserved = {reservation.vehicle for reservation in self.reservations}
        bound = {index: self._exits_ahead(self.cars[index]) for index in reserved}
        for index, car in enumerate(self.cars):
            if car.granted == len(car.passages):
                continue
            away = car.stop_station() - car.front
            if away > request_distance(car.speed):
                continue
            if self._waits_behind(car, leaders[index][2]):
                continue
            passage = car.passages[car.granted]
            lanes = [self.graph.lanes[name] for name, _, _ in passage.connections]
            if any(light_state(self.states, lane) != "green" for lane in lanes):
                self.at_red.add(index)
                continue
            if isnan(passage.requested_at):
                passage.requested_at = self.time
            lit = bool(lanes[0].signal and self.states)
            has_room, will_have_room, before = self._room(index, passage, reserved, bound)
            waits = lit and turns_left(lanes[0])
            requests.append(Request(index, car.shape, passage, has_room, will_have_room, before, lit, waits))
        if requests:
            station = [car.station for car in self.cars]
            for index in grant_requests(self.table, requests, self.reservations, station, self.time, self.blockers):
                self.cars[index].granted += 1
                self.cars[index].stop_braking = STOP_BRAKING

    def _waits_behind(self, car: Car, span: OccupiedSpan | None) -> bool:
        """Return whether the leader still waits for the same junction."""
        if span is None:
            return False
        leader = self.cars[span.vehicle]
        name = leader.lanes[span.segment]
        segment = car.index_of(name)
        mine = car.stop_station() - car.begins[segment]
        return span.rear < mine and leader.stop_station() - leader.begins[span.segment] < mine + 0.5

    def _exits_ahead(self, car: Car) -> list[str]:
        """Return the lanes behind the granted junctions whose exit a vehicle has not reached."""
        return [one.exit_lane for one in car.passages[: car.granted] if one.exit_start > car.front]

    def _room(
        self, index: int, passage: Passage, reserved: set[int], bound: dict[int, list[str]]
    ) -> tuple[bool, bool, tuple[int, ...]]:
        """Return whether there is room behind a junction now and once others have moved on, and these others.

        Args:
            index: Vehicle that requests it.
            passage: The junction.
            reserved: Vehicles that have a reservation.
            bound: Vehicle with a reservation -> lanes that it is bound for.
        """
        if not passage.exit_lane:
            return True, True, ()
        car = self.cars[index]
        segment = car.index_of(passage.exit_lane, passage.first_segment)
        now = soon = usable_length(self.graph.lanes[passage.exit_lane], car.begins[segment], car.ends[segment])
        inside = {index}
        for span in self.spans.get(passage.exit_lane, ()):
            if span.vehicle not in inside:
                inside.add(span.vehicle)
                leader = self.cars[span.vehicle]
                now = min(now, span.rear + leader.speed**2 / (2 * COAST))
                soon = min(soon, span.rear) if leader.stopped_time > BLOCKED_AFTER else soon
        for other in reserved - inside:
            if passage.exit_lane in bound[other]:
                inside.add(other)
                now -= self.cars[other].shape.length + STANDSTILL_GAP
        need = car.shape.length + ROOM
        return now >= need, soon >= need, tuple(sorted(inside - {index}))
