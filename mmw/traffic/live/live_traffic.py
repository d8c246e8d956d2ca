"""Step the traffic of a scenario row by row, with controls, and keep all poses since the start."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mmw.config.traffic_engine import ENGINES, engine_spec
from mmw.core.errors import InputError
from mmw.core.registry import load_reference
from mmw.traffic.cyclists import simulate_cyclists
from mmw.traffic.demand import TrafficDemand, VehicleTrack
from mmw.traffic.engine import check_demand
from mmw.traffic.live.control import Control, unit_pose
from mmw.traffic.live.free_body import FreeBody
from mmw.traffic.live.live_vehicles import SETTLE_ROWS, LiveVehicles
from mmw.traffic.live.obstacles import Body
from mmw.traffic.live.presence import Presence
from mmw.traffic.pedestrians import simulate_pedestrians
from mmw.traffic.spawn import name_vehicle, vehicle_order
from mmw.traffic.vehicle_pose import Shape


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

    def __init__(
        self, demand: TrafficDemand, others: Sequence[VehicleTrack] = (), started: "Started | None" = None
    ) -> None:
        """Place all actors, and drive them up to row 0.

        Args:
            demand: The scenario; poses are known for at most `frame_count` rows.
            others: Actors with tracks of their own, such as drones.
            started: What another process has started of this demand, whose vehicles are at row 0; None starts it here.

        Raises:
            InputError: If the engine cannot be stepped, or the demand cannot be met.
            MissingPackageError: If a library of the engine cannot be loaded.
        """
        own = start_traffic(demand) if started is None else started
        self._demand = demand
        vehicles = own.vehicles
        self._vehicles, self.notes = vehicles, vehicles.notes
        self._ranks = vehicle_order(vehicles.cav_ranks, len(vehicles.shapes))
        who = [name_vehicle(position, len(vehicles.cav_ranks)) for position in range(len(self._ranks))]
        self._fixed = [*own.people, *others]
        empty = np.zeros((0, 7))
        self._roster = [
            *(
                VehicleTrack(*own, vehicles.shapes[rank].name, vehicles.paints[rank], empty)
                for own, rank in zip(who, self._ranks, strict=True)
            ),
            *self._fixed,
        ]
        self.names = [track.name for track in self._roster]
        self._column = {name: column for column, name in enumerate(self.names)}
        self._poses = np.full((demand.frame_count, len(self.names), 7), np.nan)
        for column, track in enumerate(self._fixed, len(self._ranks)):
            self._poses[:, column] = track.poses[: demand.frame_count]
        self.rows = 0
        self._presence = Presence(self._column)
        self._free: dict[str, FreeBody] = {}
        self._resumed: dict[str, np.ndarray] = {}
        """Vehicles that came back to their routes, and where they stood then."""
        if started is None:
            for row in range(-SETTLE_ROWS, 0):
                vehicles.drive(row, self.seen)

    @property
    def poses(self) -> np.ndarray:
        """Body-to-world poses of all actors in the rows that are known, shape [rows, V, 7]; NaN where absent."""
        return self._poses[: self.rows]

    @property
    def tracks(self) -> list[VehicleTrack]:
        """Actors with their poses in the rows that are known."""
        return [replace(track, poses=self.poses[:, column]) for column, track in enumerate(self._roster)]

    @property
    def fleet(self) -> tuple[tuple[str, str], ...]:
        """Model and paint of every vehicle, as `TrafficDemand.fleet` takes them."""
        return tuple((track.model, track.paint) for track in self._roster[: len(self._ranks)])

    @property
    def lane_changes(self) -> list[tuple[float, str, str, str]]:
        """Changes of lanes so far: time since frame 0 [s], vehicle, lane before, lane after."""
        names = {rank: self.names[position] for position, rank in enumerate(self._ranks)}
        return [(time, names[rank], lane, other) for time, rank, lane, other in self._vehicles.lane_changes]

    def command(self, controls: Mapping[str, Control | None]) -> None:
        """Take controls; all are checked first, so that an error changes nothing.

        Raises:
            InputError: If there is no such actor, or it cannot be controlled like this.
        """
        self.check(controls)
        self.obey(controls)

    def obey(self, controls: Mapping[str, Control | None]) -> None:
        """Take controls that have been checked."""
        for name, control in controls.items():
            own = Control() if control is None else control
            column = self._column[name]
            if name not in self._free and (own.pose is not None or own.steering_rad is not None):
                self._set_free(name, column)
            if name in self._free:
                self._free[name].control = own
            elif column < len(self._ranks):
                self._vehicles.command(self._ranks[column], own)

    def check(self, controls: Mapping[str, Control | None]) -> None:
        """Check that controls can be obeyed; errors as of `command`."""
        for name, control in controls.items():
            self._check(name, control)

    def _check(self, name: str, control: Control | None) -> None:
        self._presence.check_name("control of", name)
        if name in self._presence.absent:
            raise InputError(f"control of {name!r}: is absent; add it first")
        if control is not None and not isinstance(control, Control):
            raise InputError(f"control of {name!r} = {control!r}: mmw.Control or None is needed")
        if control is None or control.is_empty:
            if name in self._free and self._free[name].is_steered:
                raise InputError(f"control of {name!r}: is steered and has no route to go back to; steer it, or reset")
            return
        if control.lane_change and not self._demand.traffic.lane_changes:
            raise InputError(f"control of {name!r}: lane_change needs traffic.lane_changes: true")
        if self._column[name] >= len(self._ranks) and control.pose is None:
            raise InputError(f"control of {name!r}: is no vehicle on a lane; only its pose can be given")
        if name in self._free and control.pose is None and control.steering_rad is None:
            raise InputError(
                f"control of {name!r}: has left its route by a pose, by steering or by remove; give steering_rad or "
                "pose, remove and add it, or reset"
            )

    def _set_free(self, name: str, column: int) -> None:
        now, before = self._poses[self.rows - 1, column], self._poses[max(self.rows - 2, 0), column]
        if name in self._resumed:  # in the last row or in none yet: it stands
            now, before = (np.where(np.isfinite(row), row, self._resumed[name]) for row in (now, before))
        self._take_off(name, column)
        self._free[name] = FreeBody.take_over(self._shape(column), before, now)

    def _shape(self, column: int) -> Shape:
        is_vehicle = column < len(self._ranks)
        return self._vehicles.shapes[self._ranks[column]] if is_vehicle else _small_shape(self._roster[column])

    def _take_off(self, name: str, column: int) -> None:
        """Take an actor off its route or track, or away from where it was placed."""
        self._resumed.pop(name, None)
        if self._free.pop(name, None) is None and column < len(self._ranks):
            self._vehicles.remove(self._ranks[column], self.rows)
        self._poses[self.rows :, column] = np.nan

    def remove(self, name: str) -> None:
        """Take an actor out of the rows that are made from now on; others see it no longer.

        Raises:
            InputError: If there is no such actor, or it is absent.
        """
        self._presence.remove(name, self.rows)
        self._take_off(name, self._column[name])

    def add(self, name: str, pose: Sequence[float] | None = None) -> None:
        """Put an absent actor back from the next row on.

        Args:
            name: The actor.
            pose: Body to world, x, y, z and a quaternion or a yaw; it stays there until a control moves it. None puts a
                vehicle on its route, with its driver.

        Raises:
            InputError: If there is no such actor, it is there, was removed in this very row, the pose is none, or there
                is no safe place on the route. Nothing has changed then.
        """
        place = None if pose is None else unit_pose(pose, f"add {name!r}")
        self._presence.check_add(name, self.rows)
        if place is None:
            self._resume(name)
            return
        self._presence.add(name, self.rows)
        body = FreeBody.take_over(self._shape(self._column[name]), np.array(place), np.array(place))
        body.control, body.level = Control(pose=place), None
        self._free[name] = body

    def _resume(self, name: str) -> None:
        column = self._column[name]
        if column >= len(self._ranks):
            raise InputError(f"add {name!r}: is no vehicle on a lane; give its pose")
        bodies = [*self.seen(0.0), *self._others()]
        try:
            pose = self._vehicles.resume(self._ranks[column], self.rows, bodies)
        except InputError as error:
            raise InputError(f"add {name!r}: {error}") from None
        self._presence.add(name, self.rows)
        self._resumed[name] = pose

    def _others(self) -> list[Body]:
        """Return the people and drones on tracks in the next row, as vehicles see bodies."""
        found, row = [], min(self.rows, len(self._poses) - 1)
        for column, track in enumerate(self._fixed, len(self._ranks)):
            before, now = self._poses[max(row - 1, 0), column], self._poses[row, column]
            if track.name not in self._free and np.isfinite(now).all():
                before = np.where(np.isfinite(before), before, now)
                found.append(FreeBody.take_over(_small_shape(track), before, now).seen(0.0))
        return found

    def advance(self, rows: int) -> None:
        """Make the poses of rows up to a number.

        Raises:
            InputError: If the demand has fewer.
        """
        if rows > len(self._poses):
            raise InputError(f"{rows} rows; the demand has {len(self._poses)}; give it a longer frame_count")
        while self.rows < rows:
            row = self._poses[self.rows]
            self._vehicles.drive(self.rows, self.seen).take(self._ranks, axis=0, out=row[: len(self._ranks)])
            if self._presence.absent:
                row[[self._column[name] for name in self._presence.absent]] = np.nan
            for name, body in self._free.items():
                ground = self._demand.ground if self._column[name] < len(self._ranks) else None
                stands = self._presence.stands(name, self.rows)
                row[self._column[name]] = body.pose if stands else body.advance(ground)
            for name, pose in self._resumed.items():
                if self._presence.stands(name, self.rows):
                    row[self._column[name]] = pose
            self.rows += 1

    def close(self) -> None:
        """Free what the engine holds; poses that are known stay."""
        self._vehicles.close()

    @property
    def seen(self) -> "SeenBodies":
        """Bodies that are on no route, as the vehicles see them in the next row."""
        return SeenBodies(tuple(self._free.values()))


@dataclass(frozen=True)
class SeenBodies:
    """Bodies that are on no route; a `Seen` that can be sent to another process."""

    bodies: tuple[FreeBody, ...] = ()

    def __call__(self, time_s: float) -> list[Body]:
        return [body.seen(time_s) for body in self.bodies]


@dataclass(frozen=True)
class Started:
    """Vehicles at their starts, and people on tracks that are known."""

    vehicles: LiveVehicles
    people: Sequence[VehicleTrack]
    """Pedestrians and cyclists."""


def start_traffic(demand: TrafficDemand) -> Started:
    """Return the vehicles of a demand before row `-SETTLE_ROWS`, and its people; errors as of `LiveTraffic`."""
    check_live(demand.traffic.engine)
    check_demand(demand)
    vehicles: LiveVehicles = load_reference(engine_spec(demand.traffic.engine).live)(demand)
    return Started(vehicles, [*simulate_pedestrians(demand), *simulate_cyclists(demand)])


def check_live(engine: str) -> None:
    """Check that the traffic of an engine can be stepped.

    Raises:
        InputError: If it cannot, or there is no such engine. The message starts with the key below `traffic`.
    """
    if not engine_spec(engine).live:
        known = " and ".join(name for name, spec in ENGINES.items() if spec.live)
        raise InputError(f"engine = {engine!r}: mode live steps the engines {known}; change engine")


def _small_shape(track: VehicleTrack) -> Shape:
    """Return the footprint of a person or a drone as vehicles see it: a square of 0.6 m."""
    return Shape(track.model, wheelbase=0.4, track=0.4, height=1.7, half_width=0.3, front=0.1, rear=0.1)
