"""Drive the vehicles of a live simulation with the IDM engine."""

import numpy as np

from mmw.core.constants import FRAME_DT
from mmw.traffic.demand import TrafficDemand
from mmw.traffic.idm.driver import STEP
from mmw.traffic.idm.simulation import start_fleet
from mmw.traffic.live.causal import REACH, ROWS_PER_STEP, LeaningBodies, hermite_rows, smooth_station
from mmw.traffic.live.control import Control
from mmw.traffic.live.live_engine import LiveEngine
from mmw.traffic.live.live_vehicles import Seen
from mmw.traffic.route import EXTENSION, PATH_STEP
from mmw.traffic.smoothing import spline_at

SLAB = 8
"""Samples of a path around a vehicle that its pose is interpolated from."""


class IdmVehicles:
    """`LiveVehicles` of the IDM engine: without controls they drive as in a recording of the same demand."""

    def __init__(self, demand: TrafficDemand) -> None:
        """Place all vehicles.

        Raises:
            InputError: If the demand cannot be met.
        """
        self._engine, placed = start_fleet(demand, LiveEngine, may_leave=False)
        self.notes, self.cav_ranks = placed.notes, placed.cav_ranks
        self.shapes = [car.shape for car in self._engine.cars]
        self.paints = [car.paint for car in self._engine.cars]
        self._bodies = LeaningBodies(self.shapes)
        self._lead = round(-self._engine.start / STEP) * ROWS_PER_STEP
        self._station, self._speed = [self._stations()], [self._speeds()]
        self._ready: list[np.ndarray] = []

    @property
    def lane_changes(self) -> list[tuple[float, int, str, str]]:
        """Changes of lanes so far: time since row 0 [s], rank, lane before, lane after."""
        done = [] if self._engine.changes is None else self._engine.changes.done
        return [(time + self._engine.start, rank, lane, other) for time, rank, lane, other in done]

    def command(self, rank: int, control: Control) -> None:
        """Take a control of a vehicle on its route from the next step on; an empty one gives it back to its driver."""
        self._engine.command(rank, control)

    def remove(self, rank: int) -> None:
        """Take a vehicle off the lanes, for good."""
        self._engine.remove(rank)

    def close(self) -> None:
        """Change nothing: all is in Python's memory."""

    def _stations(self) -> np.ndarray:
        return np.array([car.station for car in self._engine.cars])

    def _speeds(self) -> np.ndarray:
        return np.array([car.speed for car in self._engine.cars])

    def drive(self, row: int, seen: Seen) -> np.ndarray:
        """Return the poses of all vehicles in the row after the last one, shape [V, 7]."""
        if not self._ready:
            self._ready = list(self._drive_on(row, seen))
        return self._ready.pop(0)

    def _drive_on(self, row: int, seen: Seen) -> np.ndarray:
        """Return the poses in a row and in those after it that need no further step of the engine, shape [n, V, 7].

        Up to `ROWS_PER_STEP` rows are evaluated at once: a tenth of the calls of NumPy. No control can change them.
        """
        first = self._lead + row - REACH
        steps = -((-(first + 2 * REACH)) // ROWS_PER_STEP)
        while len(self._station) <= steps:
            ahead = ((len(self._station) - 1) * ROWS_PER_STEP - self._lead - row) * FRAME_DT
            self._engine.place_bodies(seen(ahead))
            self._engine.step()
            self._station.append(self._stations())
            self._speed.append(self._speeds())
        low = first // ROWS_PER_STEP
        count = steps * ROWS_PER_STEP - (first + 2 * REACH) + 1
        rows = hermite_rows(
            np.array(self._station[low : steps + 1]),
            np.array(self._speed[low : steps + 1]),
            first - low * ROWS_PER_STEP,
            2 * REACH + count,
        )
        station = np.stack([smooth_station(rows[k : k + 2 * REACH + 1]) for k in range(count)])
        return self._bodies.poses(self._columns_at(station))

    def _columns_at(self, station: np.ndarray) -> np.ndarray:
        """Return the columns of the vehicles' stances at stations [n, V], shape [n, V, 6]; all in one evaluation."""
        position = (station + EXTENSION) / PATH_STEP
        whole = np.floor(position).astype(np.int64)
        stances = [car.plan.stance.columns for car in self._engine.cars]
        slabs = [
            columns[at - 3 : at - 3 + SLAB]
            for places in whole.tolist()
            for columns, at in zip(stances, places, strict=True)
        ]
        at = SLAB * np.arange(len(slabs)) + 3 + (position - whole).reshape(-1)
        return spline_at(np.concatenate(slabs).reshape(len(slabs) * SLAB, -1), at).reshape(*station.shape, -1)
