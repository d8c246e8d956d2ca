"""The IDM engine with vehicles that somebody else drives, and with bodies off the lanes that vehicles brake for."""

from collections.abc import Sequence
from math import inf, nan, sqrt
from typing import Any

from mmw.traffic.idm.driver import BRAKING, HARDEST_BRAKING, PREVIEW, desired_acceleration, follow_leader
from mmw.traffic.idm.engine import IdmEngine
from mmw.traffic.idm.junctions import Reservation
from mmw.traffic.idm.lane_change import Leader
from mmw.traffic.idm.vehicle import STOP_BRAKING, STOP_SHORT, Car, OccupiedSpan
from mmw.traffic.live.control import Control
from mmw.traffic.live.obstacles import BlockedSpan, Body, lane_samples

TARGET_BRAKING = 3.0
"""Hardest deceleration towards a lower target speed [m/s^2]; design value."""


class LiveEngine(IdmEngine):
    """All vehicles of a scenario, some of them driven by controls; without any, the vehicles move as in `IdmEngine`.

    A vehicle that follows its route is seen by others as ever. One that enters a junction without leave gets what it
    takes: others wait for it, unless they are in the junction already.
    """

    def __init__(self, *args: Any) -> None:
        """Place the vehicles; arguments as of `IdmEngine`."""
        self.controls: dict[int, Control] = {}
        """Vehicle -> what it is told to do."""
        self.absent: set[int] = set()
        """Vehicles that have left the lanes."""
        self._held: dict[int, int] = {}
        """Vehicle that has come back -> step up to which it stands still."""
        self._blocked: dict[str, list[BlockedSpan]] = {}
        self._gap: dict[int, float] = {}
        super().__init__(*args)
        self.samples = lane_samples(self.graph)

    def command(self, index: int, control: Control) -> None:
        """Take a control of a vehicle on its route from the next step on; an empty one gives it back to its driver."""
        car = self.cars[index]
        if control.is_empty:
            self.controls.pop(index, None)
            car.settled = self.time
            return
        self.controls[index] = control
        car.settled = inf  # its driver changes no lanes

    def remove(self, index: int) -> None:
        """Take a vehicle off the lanes."""
        car = self.cars[index]
        self.controls.pop(index, None)
        self.absent.add(index)
        self.cancel_reservations(index, -inf)
        car.passages, car.granted, car.speed, car.acceleration = [], 0, 0.0, 0.0

    def resume(self, index: int, station: float, hold_steps: int) -> None:
        """Put a vehicle back on its path, at rest with its front axle at a station [m]; its driver goes on.

        Args:
            index: A vehicle that was removed.
            station: Where it is on a lane and in no junction.
            hold_steps: Steps in which it stands still.
        """
        car = self.cars[index]
        for passage in car.plan.passages:
            passage.requested_at = nan
        car.follow(car.plan)
        car.stand_at(station)
        car.speed = car.acceleration = car.stopped_time = 0.0
        car.segment = car.rear_segment = 0
        car.place()
        car.granted = sum(passage.first_segment <= car.segment for passage in car.passages)
        car.stop_braking, car.settled = STOP_BRAKING, self.time
        self.absent.discard(index)
        self._held[index] = self.steps + hold_steps

    def place_bodies(self, bodies: Sequence[Body]) -> None:
        """Say where the bodies off the lanes are, for the next step."""
        self._blocked = {}
        for body in bodies:
            for lane, span in self.samples.blocked(body).items():
                self._blocked.setdefault(lane, []).append(span)

    def step(self) -> None:
        """Advance all vehicles by `STEP` seconds."""
        self._gap = {}
        for index, control in self.controls.items():
            if control.acceleration_m_s2 is not None:
                self._enter_unasked(index)
        super().step()
        if self.changes is not None:
            for index, control in list(self.controls.items()):
                if control.lane_change and self.changes.ask(self, index, control.lane_change):
                    self.controls[index] = Control(control.acceleration_m_s2, control.target_speed_m_s)

    def _enter_unasked(self, index: int) -> None:
        """Reserve the connections that a vehicle enters without leave."""
        car = self.cars[index]
        while car.granted < len(car.passages) and car.passages[car.granted].start <= car.front:
            passage = car.passages[car.granted]
            self.reservations += [Reservation(index, car.shape, *connection) for connection in passage.connections]
            car.granted += 1
            car.stop_braking = STOP_BRAKING

    def _desire(self, index: int, leader: Leader) -> float:
        control, car = self.controls.get(index), self.cars[index]
        if index in self.absent or self.steps < self._held.get(index, 0):
            return 0.0
        if control is not None and control.acceleration_m_s2 is not None:
            left = max(0.0, car.ends[-1] - STOP_SHORT - car.front - car.speed * PREVIEW)
            at_end = (sqrt(2 * STOP_BRAKING * left) - car.speed) / PREVIEW
            return max(min(control.acceleration_m_s2, at_end), -HARDEST_BRAKING)
        desired = desired_acceleration(car, *leader[:2])
        if control is not None and control.target_speed_m_s is not None:
            towards = max((control.target_speed_m_s - car.speed) / PREVIEW, -TARGET_BRAKING)
            desired = min(desired, towards)
        return desired

    def _find_spans(self) -> dict[str, list[OccupiedSpan]]:
        found = super()._find_spans()
        if not self.absent:
            return found
        return {lane: [span for span in spans if span.vehicle not in self.absent] for lane, spans in found.items()}

    def _leader(self, index: int) -> Leader:
        if index in self.absent:
            return inf, 0.0, None
        leader, car = super()._leader(index), self.cars[index]
        body = self._blocked_ahead(car) if self._blocked else None
        if body is None:
            return leader
        self._gap[id(car)] = body[0]
        desired = car.desired_speed(car.station)
        return min(leader, body, key=lambda one: follow_leader(car.speed, desired, car.headway, *one[:2]))

    def _blocked_ahead(self, car: Car) -> Leader | None:
        """Return gap and speed of the first body in the way of a vehicle within the distance that it looks ahead."""
        horizon = car.front + 15.0 + car.speed * (car.headway + 1.0) + car.speed**2 / BRAKING
        for segment in range(car.ahead[0], len(car.ends)):
            begin = car.begins[segment]
            if begin > horizon:
                return None
            spans = [span for span in self._blocked.get(car.lanes[segment], ()) if begin + span.front > car.front]
            if spans:
                first = min(spans, key=lambda span: span.rear)
                return begin + first.rear - car.front, first.speed, None
        return None

    def _waits_behind(self, car: Car, span: OccupiedSpan | None) -> bool:
        if self._gap.get(id(car), inf) < car.stop_station() - car.front:
            return True
        return super()._waits_behind(car, span)
