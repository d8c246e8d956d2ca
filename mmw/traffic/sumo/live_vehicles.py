"""Drive the vehicles of a live simulation with SUMO, in step with it."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from mmw.core.constants import FRAME_DT
from mmw.core.errors import InputError
from mmw.traffic.demand import TrafficDemand
from mmw.traffic.idm.driver import ACCELERATION, HARDEST_BRAKING, JERK, PREVIEW, STEP
from mmw.traffic.live.causal import ROWS_PER_STEP, LeaningBodies
from mmw.traffic.live.control import Control
from mmw.traffic.live.live_engine import TARGET_BRAKING
from mmw.traffic.live.live_vehicles import SETTLE_ROWS, Seen
from mmw.traffic.live.obstacles import BlockedSpan, Body, lane_samples
from mmw.traffic.polyline import sample_polyline
from mmw.traffic.sumo.bodies import REACH, PulledBodies, step_weights
from mmw.traffic.sumo.fleet import OBSTACLE, SumoFleet, paint_of, start_sumo
from mmw.traffic.sumo.motion_limits import MotionLimits
from mmw.traffic.sumo.process import State

SUMO_DRIVES = 31
"""Speed mode: SUMO's own, with regard to gaps, limits and right of way."""

CONTROL_DRIVES = 96
"""Speed mode: without any regard, limits of speed included."""

SUMO_CHANGES = 1621
"""Lane change mode: SUMO's own."""

CONTROL_CHANGES = 513
"""Lane change mode: as the route needs it, else only when asked, with regard to the gaps of others.

Source of all four: https://sumo.dlr.de/docs/TraCI/Change_Vehicle_State.html."""

Call = tuple[Any, ...]
"""Method of `libsumo.vehicle` and its arguments."""


class SumoVehicles:
    """`LiveVehicles` of SUMO, which runs in a process of its own; any number of them can be there at once.

    Controls become SUMO's commands: `setSpeed` for accelerations and target speeds, `changeLane` for lanes. Bodies off
    the lanes are vehicles in SUMO on every lane that they block, placed with `moveToXY`.
    """

    def __init__(self, demand: TrafficDemand) -> None:
        """Place all vehicles.

        Raises:
            InputError: If the demand cannot be met, or SUMO fails.
            MissingPackageError: If `libsumo` cannot be loaded.
        """
        fleet: SumoFleet = start_sumo(demand)
        self._fleet, self._graph = fleet, demand.town.lanes
        self.cav_ranks, self.notes = fleet.cav_ranks, fleet.notes
        self.shapes = [vehicle.shape for vehicle in fleet.vehicles]
        self.paints = [paint_of(demand, rank, shape.name) for rank, shape in enumerate(self.shapes)]
        self.lane_changes: list[tuple[float, int, str, str]] = []
        self._lane_ids = {ours: lane for lane, ours in fleet.network.internal.items()}
        self._lane_number = {name: number for number, name in enumerate(self._graph.lanes)}
        self._samples = lane_samples(self._graph)
        self._controls: dict[int, Control] = {}
        self._absent: set[int] = set()
        self._calls: list[Call] = []
        self._obstacles: set[str] = set()
        self._changes_lanes = demand.traffic.lane_changes
        count = len(self.shapes)
        self._bumper = np.zeros((count, 2))
        self._speed = np.zeros((2, count))
        """Of the last two steps [m/s]."""
        self._lane = [""] * count
        """Lane of every vehicle in SUMO."""
        self._bodies, self._leaning = PulledBodies(self.shapes, demand.ground), LeaningBodies(self.shapes)
        self._lead = round(fleet.first / STEP) * ROWS_PER_STEP
        self._weights = step_weights()
        self._limits = MotionLimits(count)
        self._next = -SETTLE_ROWS - 2
        """Row that `_smooth` makes next."""
        self._columns: list[np.ndarray] = []
        self._dropped = 0
        self._start()

    def _start(self) -> None:
        states = self._fleet.process.step()
        if len(states) < len(self.shapes):
            missing = min({*range(len(self.shapes))} - {state[0] for state in states})
            raise InputError(f"engine = 'sumo': vehicle {missing} was not inserted by SUMO; give fewer vehicles")
        self._take(states)
        self._speed[0] = self._speed[1]
        _, _, _, height, angle, _, _ = zip(*sorted(states), strict=True)
        heading = 0.5 * np.pi - np.radians(angle)
        self._columns.append(self._bodies.place(self._bumper, np.array(height), heading))

    def command(self, rank: int, control: Control) -> None:
        """Take a control of a vehicle on its route from the next step on; an empty one gives it back to its driver."""
        name, drives = str(rank), control.acceleration_m_s2 is not None
        if control.is_empty:
            self._controls.pop(rank, None)
        else:
            self._controls[rank] = control
            self._limits.lift(rank)
        if control.target_speed_m_s is None and not drives:
            self._calls.append(("setSpeed", name, -1.0))
        self._calls.append(("setSpeedMode", name, CONTROL_DRIVES if drives else SUMO_DRIVES))
        if self._changes_lanes:
            self._calls.append(("setLaneChangeMode", name, SUMO_CHANGES if control.is_empty else CONTROL_CHANGES))

    def remove(self, rank: int, row: int) -> None:
        """Take a vehicle off the lanes, for good."""
        self._controls.pop(rank, None)
        self._absent.add(rank)
        self._calls.append(("remove", str(rank)))

    def resume(self, rank: int, row: int, bodies: Sequence[Body]) -> np.ndarray:
        """Refuse: SUMO forgets the route of a vehicle that is removed.

        Raises:
            InputError: In any case.
        """
        raise InputError(
            "traffic.engine = 'sumo': a vehicle that was removed has no route to go back to; give a pose, or use "
            "engine: idm"
        )

    def close(self) -> None:
        """End SUMO."""
        self._fleet.process.close()

    def drive(self, row: int, seen: Seen) -> np.ndarray:
        """Return the poses of all vehicles in the row after the last one, shape [V, 7].

        Raises:
            InputError: If SUMO fails.
        """
        columns = None
        while columns is None:
            columns = self._limits.take(self._smooth(row, seen))
        return self._leaning.poses(columns[None])[0]

    def _smooth(self, now: int, seen: Seen) -> np.ndarray:
        """Return the smoothed columns of the next row, shape [V, 6], when the row `now` is made."""
        row, self._next = self._lead + self._next, self._next + 1
        first, weights = (row - REACH) // ROWS_PER_STEP, self._weights[row % ROWS_PER_STEP]
        while self._dropped + len(self._columns) < first + len(weights):
            steps = self._dropped + len(self._columns)
            self._step(seen(((steps - 1) * ROWS_PER_STEP - self._lead - now) * FRAME_DT))
        del self._columns[: first - self._dropped]
        self._dropped = first
        some = np.array(self._columns[: len(weights)])
        middle = some[len(weights) // 2]
        return middle + np.tensordot(weights, some - middle, axes=1)

    def _step(self, bodies: Sequence[Body]) -> None:
        calls = [*self._calls, *self._obstacle_calls(bodies)]
        for rank, control in self._controls.items():
            calls += self._control_calls(rank, control)
        self._calls = []
        before = list(self._lane)
        self._take(self._fleet.process.step(calls))
        self._columns.append(self._bodies.pull(self._bumper))
        self._note_changes(before)

    def _take(self, states: Sequence[State]) -> None:
        """Take the states after a step; a vehicle that is not in the network stays where it was."""
        self._speed = np.stack([self._speed[1], np.zeros(len(self.shapes))])
        for rank, x, y, _, _, speed, lane in states:
            self._bumper[rank] = x, y
            self._speed[1, rank], self._lane[rank] = speed, lane

    def _control_calls(self, rank: int, control: Control) -> list[Call]:
        """Return the calls that a control needs before every step."""
        name, calls = str(rank), []
        before, speed = self._speed[:, rank].tolist()
        wanted = control.acceleration_m_s2
        highest = self._fleet.top_speed
        if control.target_speed_m_s is not None:
            highest = control.target_speed_m_s
            wanted = max(min((highest - speed) / PREVIEW, ACCELERATION), -TARGET_BRAKING)
        if wanted is not None:
            last = min(max((speed - before) / STEP, -HARDEST_BRAKING), HARDEST_BRAKING)
            wanted = min(max(wanted, last - JERK * STEP), last + JERK * STEP)
            after = max(speed + wanted * STEP, 0.0)
            calls.append(("setSpeed", name, min(after, highest) if after > speed else after))
        ours = self._fleet.network.internal.get(self._lane[rank], "")
        if control.lane_change and ours in self._fleet.network.place:
            lane = self._graph.lanes[ours]
            aside = self._fleet.network.place.get(lane.left if control.lane_change == "left" else lane.right)
            if aside is not None and aside.edge == self._fleet.network.place[ours].edge:
                calls.append(("changeLane", name, aside.index, STEP))
        return calls

    def _note_changes(self, before: Sequence[str]) -> None:
        """Note vehicles whose middle has passed to a lane beside theirs; a control asks for one change."""
        place, lanes = self._fleet.network.place, self._fleet.network.internal
        for rank, (lane, after) in enumerate(zip(before, self._lane, strict=True)):
            old, new = lanes.get(lane, ""), lanes.get(after, "")
            if old == new or old not in place or new not in place or place[old].edge != place[new].edge:
                continue
            time = (self._dropped + len(self._columns) - 1) * STEP - self._fleet.first
            self.lane_changes.append((time, rank, old, new))
            control = self._controls.get(rank)
            side = self._graph.lanes[old].left if control and control.lane_change == "left" else None
            side = self._graph.lanes[old].right if control and control.lane_change == "right" else side
            if control is not None and new == side:
                self._controls[rank] = Control(control.acceleration_m_s2, control.target_speed_m_s)

    def _obstacle_calls(self, bodies: Sequence[Body]) -> list[Call]:
        """Return the calls that put bodies on the lanes that they block."""
        calls, present = [], set()
        for number, body in enumerate(bodies):
            for lane, span in self._samples.blocked(body).items():
                name = f"{OBSTACLE}_{number}_{self._lane_number[lane]}"
                present.add(name)
                if name not in self._obstacles:
                    calls += [("add", name, OBSTACLE, OBSTACLE), ("setSpeedMode", name, CONTROL_DRIVES)]
                    calls.append(("setLaneChangeMode", name, 0))
                calls += self._place_obstacle(name, lane, span)
        calls += [("remove", name) for name in sorted(self._obstacles - present)]
        self._obstacles = present
        return calls

    def _place_obstacle(self, name: str, lane: str, span: BlockedSpan) -> list[Call]:
        one = self._graph.lanes[lane]
        x, y, _ = sample_polyline(one.points, one.plan_station, np.array([span.front]))[0].tolist()
        ahead = sample_polyline(one.points, one.plan_station, np.array([span.front - 0.5, span.front + 0.5]))
        angle = float(np.degrees(np.arctan2(*(ahead[1] - ahead[0])[:2])))
        edge, index = self._lane_ids[lane].rsplit("_", 1)
        return [
            ("setLength", name, max(span.front - span.rear, 0.5)),
            ("moveToXY", name, edge, int(index), x, y, angle % 360.0, 2),
            ("setSpeed", name, span.speed),
        ]
