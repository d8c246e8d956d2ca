"""Drive the vehicles of several episodes of a scenario, in this process or in another one, up to the next decision."""

from collections import defaultdict, deque
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from mmw.traffic.demand import TrafficDemand, VehicleTrack
from mmw.traffic.live.control import Control
from mmw.traffic.live.idm_vehicles import IdmVehicles, rows_after
from mmw.traffic.live.live_traffic import SeenBodies, Started, start_traffic
from mmw.traffic.live.live_vehicles import SETTLE_ROWS, Seen
from mmw.traffic.live.obstacles import Body
from mmw.traffic.vehicle_pose import Shape

NOBODY = SeenBodies()
"""Seen where all vehicles are on their routes."""


@dataclass(frozen=True)
class Start:
    """Ask for an episode from its start to a row."""

    key: int
    """Names the episode in later calls."""
    seed: int
    fleet: tuple[tuple[str, str], ...] | None
    """As of `TrafficDemand.with_seed`."""
    rows: int
    """Rows that are needed at the start."""


@dataclass(frozen=True)
class Drive:
    """Ask for the next row of an episode, and for those after it that need no further decision."""

    key: int
    row: int
    controls: Sequence[tuple[int, Control]] = ()
    """Ranks and controls since the last decision, in their order."""
    removed: Sequence[tuple[int, int]] = ()
    """Ranks of the vehicles that were taken off the lanes since, and the rows before which they were."""
    seen: SeenBodies = NOBODY


@dataclass(frozen=True)
class Resume:
    """Ask for a vehicle to come back to its route, after controls and removals as of `Drive`."""

    key: int
    row: int
    rank: int
    bodies: Sequence[Body]
    """As of `LiveVehicles.resume`."""
    controls: Sequence[tuple[int, Control]] = ()
    removed: Sequence[tuple[int, int]] = ()


Call = Start | Drive | Resume


@dataclass(frozen=True)
class Driven:
    """Rows of an episode."""

    rows: np.ndarray
    """Poses of all vehicles by rank, shape [n, V, 7]."""
    lane_changes: list[tuple[float, int, str, str]]
    """Changes of lanes since the call before, as of `LiveVehicles`."""


@dataclass(frozen=True)
class Begun:
    """An episode at its start."""

    driven: Driven
    shapes: list[Shape]
    paints: list[str]
    cav_ranks: tuple[int, ...]
    notes: list[str]
    people: list[VehicleTrack]
    """Pedestrians and cyclists."""


@dataclass(frozen=True)
class Resumed:
    """A vehicle that has come back."""

    pose: np.ndarray
    """Body to world, at rest, shape [7]."""


Answer = Begun | Driven | Resumed | Exception


class VehicleServer:
    """Vehicles of episodes that differ by seed."""

    def __init__(self, demand: TrafficDemand) -> None:
        """Hold no episode yet; all have the town, the models and the people's count of a demand."""
        self._demand = demand
        self._vehicles: dict[int, IdmVehicles] = {}
        self._told: dict[int, int] = {}
        """Episode -> its changes of lanes that have been told (count)."""

    def answer(self, forgotten: Collection[int], calls: Sequence[Call]) -> list[Answer]:
        """Let episodes go, and make calls; one that fails has its error as the answer, and others go on."""
        for key in forgotten:
            self._vehicles.pop(key, None)
            self._told.pop(key, None)
        starts = self._start([call for call in calls if isinstance(call, Start)])
        rows = self._advance([call for call in calls if isinstance(call, Drive)])
        found: dict[int, Answer] = {**starts, **{key: self._driven(key, own) for key, own in rows.items()}}
        found |= {call.key: self._resume(call) for call in calls if isinstance(call, Resume)}
        return [found[call.key] for call in calls]

    def _start(self, calls: Sequence[Start]) -> dict[int, Begun | Exception]:
        """Return episodes at their starts, which are driven together."""
        found: dict[int, Begun | Exception] = {}
        begun: dict[int, tuple[Start, Started]] = {}
        rows: dict[int, list[np.ndarray]] = {}
        for call in calls:
            try:
                started = start_traffic(self._demand.with_seed(call.seed, call.fleet))
            except Exception as error:  # whoever asked raises it, with the world's name
                found[call.key] = error
                continue
            assert isinstance(started.vehicles, IdmVehicles)
            begun[call.key], rows[call.key] = (call, started), []
            self._vehicles[call.key], self._told[call.key] = started.vehicles, 0
        while moving := [
            Drive(key, len(own) - SETTLE_ROWS)
            for key, own in rows.items()
            if key not in found and len(own) < SETTLE_ROWS + begun[key][0].rows
        ]:
            for key, poses in self._advance(moving).items():
                if isinstance(poses, Exception):
                    found[key] = poses
                else:
                    rows[key] += list(poses)
        for key, (_, started) in begun.items():
            if key in found:
                del self._vehicles[key], self._told[key]
                continue
            driven = self._driven(key, np.array(rows[key][SETTLE_ROWS:]))
            own = started.vehicles
            found[key] = Begun(driven, [*own.shapes], [*own.paints], tuple(own.cav_ranks), own.notes, [*started.people])
        return found

    def _advance(self, calls: Sequence[Drive]) -> dict[int, np.ndarray | Exception]:
        """Return the poses of episodes in a row and in those after it that need no further decision."""
        found: dict[int, np.ndarray | Exception] = {}
        alike: dict[tuple[int, ...], list[int]] = defaultdict(list)
        for call in calls:
            vehicles = self._vehicles[call.key]
            try:
                _obey(vehicles, call)
                vehicles.decide(call.row, call.seen)
            except Exception as error:  # as above
                found[call.key] = error
            else:
                alike[call.row, *vehicles.phase(call.row)].append(call.key)
        for (row, *_), keys in alike.items():
            found |= self._rows(keys, row)
        return found

    def _resume(self, call: Resume) -> Resumed | Exception:
        """Put a vehicle back on its route."""
        vehicles = self._vehicles[call.key]
        try:
            _obey(vehicles, call)
            return Resumed(vehicles.resume(call.rank, call.row, call.bodies))
        except Exception as error:  # as above
            return error

    def _rows(self, keys: Sequence[int], row: int) -> dict[int, np.ndarray | Exception]:
        """Return the poses of episodes, evaluated together; if that fails, each alone, to find the one at fault."""
        try:
            return dict(zip(keys, rows_after([self._vehicles[key] for key in keys], row), strict=True))
        except Exception as error:  # as above
            if len(keys) == 1:
                return {keys[0]: error}
            alone = {key: self._rows([key], row)[key] for key in keys}
            # A fault of the joint evaluation is no episode's own, and counts for all.
            is_own = any(isinstance(found, Exception) for found in alone.values())
            return alone if is_own else dict.fromkeys(keys, error)

    def _driven(self, key: int, poses: np.ndarray | Exception) -> Driven | Exception:
        if isinstance(poses, Exception):
            return poses
        changes = self._vehicles[key].lane_changes
        told, self._told[key] = self._told[key], len(changes)
        return Driven(poses, changes[told:])


def _obey(vehicles: IdmVehicles, call: Drive | Resume) -> None:
    """Take controls, and vehicles off the lanes."""
    for rank, control in call.controls:
        vehicles.command(rank, control)
    for rank, row in call.removed:
        vehicles.remove(rank, row)


class ServedVehicles:
    """`LiveVehicles` that a server drives: rows are asked for, taken, and then handed out one by one."""

    def __init__(self, key: int, begun: Begun, resume: Callable[[Resume], np.ndarray]) -> None:
        """Take an episode at its start.

        Args:
            key: Names it in calls of the server.
            begun: What the server has made.
            resume: Makes such a call and returns the pose; errors as of `resume`.
        """
        self.key = key
        self._make_resume = resume
        self.shapes, self.paints = begun.shapes, begun.paints
        self.cav_ranks, self.notes = begun.cav_ranks, begun.notes
        self.lane_changes: list[tuple[float, int, str, str]] = []
        self.is_closed = False
        self.is_lost = False
        """Whether the server has lost it, or may be ahead of what was taken."""
        self._rows: deque[np.ndarray] = deque()
        self._controls: list[tuple[int, Control]] = []
        self._removed: list[tuple[int, int]] = []
        self.take(begun.driven)

    @property
    def must_ask(self) -> bool:
        """Whether the next row needs a decision of the drivers."""
        return not self._rows

    def command(self, rank: int, control: Control) -> None:
        """Take a control of a vehicle on its route from the next step on; the last one before a decision counts."""
        last = max((place for place, (other, _) in enumerate(self._controls) if other == rank), default=None)
        if last is None or self._controls[last][1].is_empty or control.is_empty:
            self._controls.append((rank, control))  # which goes to the end of the engine's list, or off it
        else:
            self._controls[last] = rank, control

    def remove(self, rank: int, row: int) -> None:
        """Take a vehicle off the lanes before a row, the next one."""
        self._removed.append((rank, row))

    def resume(self, rank: int, row: int, bodies: Sequence[Body]) -> np.ndarray:
        """Put a vehicle back on its route, as `IdmVehicles.resume` does; the server answers at once.

        Raises:
            InputError: If there is no safe place; nothing has changed then.
        """
        call = Resume(self.key, row, rank, bodies, self._controls, self._removed)
        self._controls, self._removed = [], []
        return self._make_resume(call)

    def ask(self, row: int, seen: SeenBodies) -> Drive:
        """Return the call for the next row."""
        call = Drive(self.key, row, self._controls, self._removed, seen)
        self._controls, self._removed = [], []
        return call

    def take(self, driven: Driven) -> None:
        """Take the answer to a call."""
        self._rows.extend(driven.rows)
        self.lane_changes += driven.lane_changes

    def drive(self, row: int, seen: Seen) -> np.ndarray:
        """Return the poses of all vehicles in the row after the last one, which has been taken, shape [V, 7]."""
        return self._rows.popleft()

    def close(self) -> None:
        """Let the server forget the episode; rows that were taken stay."""
        self.is_closed = True


@dataclass(frozen=True)
class ServedTraffic(Started):
    """Traffic that a server has started."""

    vehicles: ServedVehicles
