"""Step the traffic of a scenario row by row, with controls, and keep all poses since the start."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mmw.core.constants import FRAME_DT
from mmw.core.errors import InputError
from mmw.traffic.cyclists import simulate_cyclists
from mmw.traffic.demand import TrafficDemand, VehicleTrack
from mmw.traffic.idm.driver import STEP
from mmw.traffic.idm.simulation import start_fleet
from mmw.traffic.live.causal import REACH, ROWS_PER_STEP, LeanFilter, hermite_rows, smooth_station
from mmw.traffic.live.control import Control
from mmw.traffic.live.free_body import FreeBody
from mmw.traffic.live.live_engine import LiveEngine
from mmw.traffic.pedestrians import simulate_pedestrians
from mmw.traffic.route import EXTENSION, PATH_STEP
from mmw.traffic.smoothing import spline_at
from mmw.traffic.spawn import name_vehicle, vehicle_order
from mmw.traffic.vehicle_pose import Shape, lean_per_acceleration, tilted_poses

SETTLE_ROWS = 60
"""Rows before row 0 that the filters of the lean need to settle; the engine starts `SETTLE_S` and more before."""

SLAB = 8
"""Samples of a path around a vehicle that its pose is interpolated from."""


class LiveTraffic:
    """Vehicles that obey controls and react to each other, row by row at 100 Hz.

    Without controls they drive as in a recording of the same demand; poses differ by the filters, see
    `mmw.traffic.live.causal`. Pedestrians, cyclists and drones keep to tracks that are known from the start, unless
    a pose is given.

    Attributes:
        notes: Differences from the demand that people should know.
        names: Names of all actors; columns of `poses` are in this order.
        rows: Rows of poses that are known.
    """

    def __init__(self, demand: TrafficDemand, others: Sequence[VehicleTrack] = ()) -> None:
        """Place all actors, and drive them up to row 0.

        Args:
            demand: The scenario; poses are known for at most `frame_count` rows.
            others: Actors with tracks of their own, such as drones.

        Raises:
            InputError: If the engine is another one than `idm`, or the demand cannot be met.
        """
        if demand.traffic.engine != "idm":
            raise InputError(f"engine = {demand.traffic.engine!r}: live traffic is that of idm; change engine")
        self._demand = demand
        self._engine, placed = start_fleet(demand, LiveEngine, may_leave=False)
        self.notes = placed.notes
        cars, ranks = self._engine.cars, vehicle_order(placed.cav_ranks, len(self._engine.cars))
        self._ranks = ranks
        who = [name_vehicle(position, len(placed.cav_ranks)) for position in range(len(ranks))]
        self._fixed = [*simulate_pedestrians(demand), *simulate_cyclists(demand), *others]
        empty = np.zeros((0, 7))
        self._roster = [
            *(VehicleTrack(*own, cars[k].shape.name, cars[k].paint, empty) for own, k in zip(who, ranks, strict=True)),
            *self._fixed,
        ]
        self.names = [track.name for track in self._roster]
        self._column = {name: column for column, name in enumerate(self.names)}
        self._poses = np.full((demand.frame_count, len(self.names), 7), np.nan)
        for column, track in enumerate(self._fixed, len(ranks)):
            self._poses[:, column] = track.poses[: demand.frame_count]
        self.rows = 0
        self._free: dict[str, FreeBody] = {}
        lifts = [lean_per_acceleration(car.shape) for car in cars]
        self._lift = np.array(lifts, dtype=np.float64).reshape(-1, 2)
        self._lean = LeanFilter(len(cars))
        self._lead = round(-self._engine.start / STEP) * ROWS_PER_STEP
        self._station, self._speed = [self._stations()], [self._speeds()]
        self._before: list[np.ndarray] = []
        for row in range(-SETTLE_ROWS, 0):
            self._drive(row)

    @property
    def poses(self) -> np.ndarray:
        """Body-to-world poses of all actors in the rows that are known, shape [rows, V, 7]; NaN where absent."""
        return self._poses[: self.rows]

    @property
    def tracks(self) -> list[VehicleTrack]:
        """Actors with their poses in the rows that are known."""
        return [replace(track, poses=self.poses[:, column]) for column, track in enumerate(self._roster)]

    @property
    def lane_changes(self) -> list[tuple[float, str, str, str]]:
        """Changes of lanes so far: time since frame 0 [s], vehicle, lane before, lane after."""
        names = {rank: self.names[position] for position, rank in enumerate(self._ranks)}
        done = [] if self._engine.changes is None else self._engine.changes.done
        return [(time + self._engine.start, names[rank], lane, other) for time, rank, lane, other in done]

    def command(self, controls: Mapping[str, Control | None]) -> None:
        """Take controls; all are checked first, so that an error changes nothing.

        Raises:
            InputError: If there is no such actor, or it cannot be controlled like this.
        """
        for name, control in controls.items():
            self._check(name, control)
        for name, control in controls.items():
            own = Control() if control is None else control
            column = self._column[name]
            if name not in self._free and (own.pose is not None or own.steering_rad is not None):
                self._set_free(name, column)
            if name in self._free:
                self._free[name].control = own
            elif column < len(self._ranks):
                self._engine.command(self._ranks[column], own)

    def _check(self, name: str, control: Control | None) -> None:
        if name not in self._column:
            known = ", ".join(self.names[:8]) + (f" and {len(self.names) - 8} more" if len(self.names) > 8 else "")
            raise InputError(f"control of {name!r}: there is no such actor; there are {known}; name one of them")
        if control is not None and not isinstance(control, Control):
            raise InputError(f"control of {name!r} = {control!r}: mmw.Control or None is needed")
        if control is None or control.is_empty:
            if name in self._free and self._free[name].is_steered:
                raise InputError(f"control of {name!r}: is steered and has no route to go back to; steer it, or reset")
            return
        if self._column[name] >= len(self._ranks) and control.pose is None:
            raise InputError(f"control of {name!r}: is no vehicle on a lane; only its pose can be given")
        if name in self._free and control.pose is None and control.steering_rad is None:
            raise InputError(
                f"control of {name!r}: has left its route by a pose or by steering; give steering_rad or pose, or reset"
            )

    def _set_free(self, name: str, column: int) -> None:
        now, before = self._poses[self.rows - 1, column], self._poses[max(self.rows - 2, 0), column]
        is_vehicle = column < len(self._ranks)
        shape = self._engine.cars[self._ranks[column]].shape if is_vehicle else _small_shape(self._roster[column])
        self._free[name] = FreeBody.take_over(shape, before, now)
        self._poses[self.rows :, column] = np.nan
        if is_vehicle:
            self._engine.remove(self._ranks[column])

    def advance(self, rows: int) -> None:
        """Make the poses of rows up to a number.

        Raises:
            InputError: If the demand has fewer.
        """
        if rows > len(self._poses):
            raise InputError(f"{rows} rows; the demand has {len(self._poses)}; give it a longer frame_count")
        while self.rows < rows:
            self._poses[self.rows, self._columns_of_cars] = self._drive(self.rows)
            for name, body in self._free.items():
                is_vehicle = self._column[name] < len(self._ranks)
                self._poses[self.rows, self._column[name]] = body.advance(self._demand.ground if is_vehicle else None)
            self.rows += 1

    @property
    def _columns_of_cars(self) -> np.ndarray:
        """Column of `poses` of every vehicle by rank."""
        columns = np.empty(len(self._ranks), dtype=np.int64)
        columns[self._ranks] = np.arange(len(self._ranks))
        return columns

    def _stations(self) -> np.ndarray:
        return np.array([car.station for car in self._engine.cars])

    def _speeds(self) -> np.ndarray:
        return np.array([car.speed for car in self._engine.cars])

    def _drive(self, row: int) -> np.ndarray:
        """Return the poses of the vehicles on their routes in the row after the last, by rank, shape [V, 7]."""
        first = self._lead + row - REACH
        steps = -((-(first + 2 * REACH)) // ROWS_PER_STEP)
        while len(self._station) <= steps:
            ahead = ((len(self._station) - 1) * ROWS_PER_STEP - self._lead - row) * FRAME_DT
            self._engine.place_bodies([body.seen(ahead) for body in self._free.values()])
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
        x, y, heading, height, slope_x, slope_y = self._columns_at(station).T
        place = np.stack([x, y], axis=1)
        self._before = [*self._before[-2:], place]
        if len(self._before) == 3:
            lean = self._lean.take((self._before[2] - 2 * self._before[1] + self._before[0]) / FRAME_DT**2)
            c, s = np.cos(heading), np.sin(heading)
            slope_x = slope_x + self._lift[:, 0] * (lean[:, 0] * c + lean[:, 1] * s)
            slope_y = slope_y + self._lift[:, 1] * (lean[:, 1] * c - lean[:, 0] * s)
        return tilted_poses(x, y, height, heading, slope_x, slope_y)

    def _columns_at(self, station: np.ndarray) -> np.ndarray:
        """Return the columns of the vehicles' stances at stations, shape [V, 6]; all in one evaluation."""
        position = (station + EXTENSION) / PATH_STEP
        whole = np.floor(position).astype(np.int64)
        slabs = [
            car.plan.stance.columns[at - 3 : at - 3 + SLAB] for car, at in zip(self._engine.cars, whole, strict=True)
        ]
        return spline_at(np.concatenate(slabs), SLAB * np.arange(len(slabs)) + 3 + (position - whole))


def _small_shape(track: VehicleTrack) -> Shape:
    """Return the footprint of a person or a drone as vehicles see it: a square of 0.6 m."""
    return Shape(track.model, wheelbase=0.4, track=0.4, height=1.7, half_width=0.3, front=0.1, rear=0.1)
