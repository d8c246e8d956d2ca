"""Drive the vehicles of a live simulation with the IDM engine."""

from collections import defaultdict
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from mmw.core.constants import FRAME_DT
from mmw.core.errors import InputError
from mmw.traffic.demand import TrafficDemand
from mmw.traffic.idm.driver import STEP
from mmw.traffic.idm.simulation import start_fleet
from mmw.traffic.idm.vehicle import Car
from mmw.traffic.live.causal import REACH, ROWS_PER_STEP, LeaningBodies, hermite_rows, smooth_station
from mmw.traffic.live.control import Control
from mmw.traffic.live.live_engine import LiveEngine
from mmw.traffic.live.live_vehicles import Seen
from mmw.traffic.live.obstacles import BlockedSpan, Body
from mmw.traffic.live.presence import STILL_ROWS
from mmw.traffic.live.return_places import SEARCH_M, Returning, find_place
from mmw.traffic.route import EXTENSION, PATH_STEP
from mmw.traffic.smoothing import SPLINE_REACH, spline_weights

HOLD_STEPS = -(-STILL_ROWS // ROWS_PER_STEP)
"""Steps in which a vehicle that comes back stands, so that its first `STILL_ROWS` rows are equal: the engine's present
step is as far ahead of them as a row depends on."""

SLAB = 8
"""Samples of a path around a vehicle that a pose was interpolated from once; positions are still rounded with it."""


class IdmVehicles:
    """`LiveVehicles` of the IDM engine: without controls they drive as in a recording of the same demand."""

    def __init__(self, demand: TrafficDemand) -> None:
        """Place all vehicles.

        Raises:
            InputError: If the demand cannot be met.
        """
        self._engine, placed = start_fleet(demand, LiveEngine, may_leave=False)
        self._prepare(self._engine.cars, 1)
        self._turn = 0
        """Vehicle whose junctions ahead are prepared next."""
        self.notes, self.cav_ranks = placed.notes, placed.cav_ranks
        self.shapes = [car.shape for car in self._engine.cars]
        self.paints = [car.paint for car in self._engine.cars]
        self._bodies = LeaningBodies(self.shapes)
        self._lead = round(-self._engine.start / STEP) * ROWS_PER_STEP
        self._station, self._speed = [self._stations()], [self._speeds()]
        self._start, self._left = self._stations(), self._stations()
        """Stations where routes began, and where vehicles left them [m]."""
        self._ready: list[np.ndarray] = []

    @property
    def lane_changes(self) -> list[tuple[float, int, str, str]]:
        """Changes of lanes so far: time since row 0 [s], rank, lane before, lane after."""
        done = [] if self._engine.changes is None else self._engine.changes.done
        return [(time + self._engine.start, rank, lane, other) for time, rank, lane, other in done]

    def command(self, rank: int, control: Control) -> None:
        """Take a control of a vehicle on its route from the next step on; an empty one gives it back to its driver."""
        self._engine.command(rank, control)

    def remove(self, rank: int, row: int) -> None:
        """Take a vehicle off the lanes before a row."""
        start, _ = self.phase(row - 1)
        rows = hermite_rows(*self._motion(row - 1), start, 2 * REACH + 1)
        self._left[rank] = smooth_station(rows)[rank]
        self._engine.remove(rank)

    def resume(self, rank: int, row: int, bodies: Sequence[Body]) -> np.ndarray:
        """Put a vehicle back at the nearest safe place of its route, at rest; return its pose, shape [7].

        Raises:
            InputError: If there is none; nothing has changed then.
        """
        engine, blocked = self._engine, defaultdict[str, list[BlockedSpan]](list)
        for body in bodies:
            for lane, span in engine.samples.blocked(body).items():
                blocked[lane].append(span)
        lag_s = ((len(self._station) - 1) * ROWS_PER_STEP - self._lead - row) * FRAME_DT
        one = Returning(rank, float(self._left[rank]), float(self._start[rank]), lag_s)
        station = find_place(engine, engine.absent, blocked, one)
        if station is None:
            raise InputError(
                f"there is no safe place within {SEARCH_M:g} m along its route; step on and try again, or give a pose"
            )
        engine.resume(rank, station, HOLD_STEPS)
        for stations, speeds in zip(self._station, self._speed, strict=True):
            stations[rank], speeds[rank] = station, 0.0
        columns = _columns_at([self], [slice(0, len(self.shapes))], self._stations()[None])
        return self._bodies.rest(rank, columns[0, rank])

    def close(self) -> None:
        """Change nothing: all is in Python's memory."""

    def _stations(self) -> np.ndarray:
        return np.array([car.station for car in self._engine.cars])

    def _speeds(self) -> np.ndarray:
        return np.array([car.speed for car in self._engine.cars])

    def drive(self, row: int, seen: Seen) -> np.ndarray:
        """Return the poses of all vehicles in the row after the last one, shape [V, 7]."""
        if not self._ready:
            self.decide(row, seen)
            self._ready = list(rows_after([self], row)[0])
        else:
            self._turn = (self._turn + 1) % len(self._engine.cars)
            self._prepare(self._engine.cars[self._turn : self._turn + 1], 2)
        return self._ready.pop(0)

    def _prepare(self, cars: Sequence[Car], count: int) -> None:
        """Compute what right of way at some next junctions of vehicles needs, before a decision that needs it.

        A decision would take twice as long otherwise; rows between decisions have time.
        """
        self._engine.table.prepare((car.shape, car.passages[car.granted : car.granted + count]) for car in cars)

    def decide(self, row: int, seen: Seen) -> None:
        """Let the drivers decide as far as a row needs it."""
        while len(self._station) <= self._step_needed(row):
            ahead = ((len(self._station) - 1) * ROWS_PER_STEP - self._lead - row) * FRAME_DT
            self._engine.place_bodies(seen(ahead))
            self._engine.step()
            self._station.append(self._stations())
            self._speed.append(self._speeds())

    def _step_needed(self, row: int) -> int:
        """Return the step of the engine that the last of the stations about a row lies before, or is."""
        return -((-(self._lead + row + REACH)) // ROWS_PER_STEP)

    def phase(self, row: int) -> tuple[int, int]:
        """Return first row after a step among those about a row, and how many rows need no further step.

        Vehicles of one phase can be evaluated together.
        """
        first = self._lead + row - REACH
        return first % ROWS_PER_STEP, self._step_needed(row) * ROWS_PER_STEP - (first + 2 * REACH) + 1

    def _motion(self, row: int) -> tuple[np.ndarray, np.ndarray]:
        """Return stations and speeds at the steps about a row, shape [N, V] each."""
        low, high = (self._lead + row - REACH) // ROWS_PER_STEP, self._step_needed(row) + 1
        return np.array(self._station[low:high]), np.array(self._speed[low:high])


def rows_after(vehicles: Sequence[IdmVehicles], row: int) -> list[np.ndarray]:
    """Return the poses in a row and in those after it that need no further step of the engine, shape [n, V, 7] each.

    Up to `ROWS_PER_STEP` rows of all vehicles of a phase are evaluated at once: a fraction of the calls of NumPy. No
    control can change them. Poses are the same bits whatever is evaluated together.
    """
    (start, count), *others = dict.fromkeys(one.phase(row) for one in vehicles)
    assert not others
    motions = [one._motion(row) for one in vehicles]
    station, speed = (np.concatenate(side, axis=1) for side in zip(*motions, strict=True))
    rows = hermite_rows(station, speed, start, 2 * REACH + count)
    ends = np.cumsum([0, *(len(one.shapes) for one in vehicles)]).tolist()
    parts = [slice(*pair) for pair in pairwise(ends)]
    smooth = np.empty((count, ends[-1]))
    for part in parts:  # one by one: the last bits of a product of matrices depend on their size
        for k in range(count):
            smooth[k, part] = smooth_station(rows[k : k + 2 * REACH + 1, part])
    bodies = [one._bodies for one in vehicles]
    whole = LeaningBodies.joined(bodies)
    poses = whole.poses(_columns_at(vehicles, parts, smooth))
    whole.give(bodies)
    return [poses[:, part] for part in parts]


def _columns_at(vehicles: Sequence[IdmVehicles], parts: Sequence[slice], station: np.ndarray) -> np.ndarray:
    """Return the columns of vehicles' stances at stations [n, V], shape [n, V, 6]; all in one evaluation."""
    position = (station + EXTENSION) / PATH_STEP
    whole = np.floor(position).astype(np.int64)
    fraction = position - whole
    for part in parts:  # counted through slabs of samples, as when each pose had its own: the last bits are those
        slab = SLAB * np.arange(fraction[:, part].size).reshape(len(station), -1) + 3
        at = slab + fraction[:, part]
        below = np.floor(at)
        fraction[:, part] = at - below
        whole[:, part] += below.astype(np.int64) - slab
    first, last = whole.min(axis=0).tolist(), whole.max(axis=0).tolist()
    stances = [car.plan.stance.columns for one in vehicles for car in one._engine.cars]
    slabs = []
    for columns, low, high in zip(stances, first, last, strict=True):
        if low < SPLINE_REACH - 1 or high > len(columns) - SPLINE_REACH - 1:
            raise InputError(
                f"path of {len(columns)} samples: a vehicle is at samples {low} to {high}, too near an end"
            )
        slabs.append(columns[low - SPLINE_REACH + 1 : high + SPLINE_REACH + 1])
    starts = np.cumsum([0, *map(len, slabs[:-1])])
    row = starts + SPLINE_REACH - 1 + whole - whole.min(axis=0)
    samples, out = np.concatenate(slabs), np.zeros((*station.shape, 6))
    steps = range(1 - SPLINE_REACH, SPLINE_REACH + 1)
    for step, weight in zip(steps, spline_weights(fraction.reshape(-1)), strict=True):
        out += weight.reshape(*station.shape, 1) * samples[row + step]
    return out
