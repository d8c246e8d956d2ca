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
        first = self._lead + row - REACH
        steps = -((-(first + 2 * REACH)) // ROWS_PER_STEP)
        while len(self._station) <= steps:
            ahead = ((len(self._station) - 1) * ROWS_PER_STEP - self._lead - row) * FRAME_DT
            self._engine.place_bodies(seen(ahead))
            self._engine.step()
            self._station.append(self._stations())
            self._speed.append(self._speeds())
        low = first // ROWS_PER_STEP
        station = smooth_station(
            hermite_rows(
                np.array(self._station[low : steps + 1]),
                np.array(self._speed[low : steps + 1]),
                first - low * ROWS_PER_STEP,
                2 * REACH + 1,
            )
        )
        return self._bodies.poses(self._columns_at(station))

    def _columns_at(self, station: np.ndarray) -> np.ndarray:
        """Return the columns of the vehicles' stances at stations, shape [V, 6]; all in one evaluation."""
        position = (station + EXTENSION) / PATH_STEP
        whole = np.floor(position).astype(np.int64)
        slabs = [
            car.plan.stance.columns[at - 3 : at - 3 + SLAB] for car, at in zip(self._engine.cars, whole, strict=True)
        ]
        return spline_at(np.concatenate(slabs), SLAB * np.arange(len(slabs)) + 3 + (position - whole))
