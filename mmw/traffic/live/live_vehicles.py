"""Say what a traffic engine does for a live simulation: move its vehicles row by row, and obey controls."""

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from mmw.traffic.live.control import Control
from mmw.traffic.live.obstacles import Body
from mmw.traffic.vehicle_pose import Shape

Seen = Callable[[float], Sequence[Body]]
"""Returns the bodies that are on no route, a time ahead of the row that is being made [s]."""


class LiveVehicles(Protocol):
    """Vehicles on the lanes of a town, driven by an engine; `live` of a `TrafficEngineSpec` makes them from a demand.

    Vehicles are counted by rank, that is by their distance to the spawn center. `LiveTraffic` names them, and moves
    those that somebody steers or places.
    """

    shapes: Sequence[Shape]
    """Dimensions of every vehicle."""
    paints: Sequence[str]
    """Paint of every vehicle."""
    cav_ranks: Sequence[int]
    """Ranks of the CAVs, `cav_1` first."""
    notes: list[str]
    """Differences from the demand that people should know."""

    @property
    def lane_changes(self) -> list[tuple[float, int, str, str]]:
        """Changes of lanes so far: time since row 0 [s], rank, lane before, lane after."""
        ...

    def command(self, rank: int, control: Control) -> None:
        """Take a control of a vehicle on its route from the next step on; an empty one gives it back to its driver."""
        ...

    def remove(self, rank: int, row: int) -> None:
        """Take a vehicle off the lanes before a row, the next one; poses of it do not count until it comes back."""
        ...

    def resume(self, rank: int, row: int, bodies: Sequence[Body]) -> np.ndarray:
        """Put a vehicle that was removed back on its route, with its driver; return its pose, shape [7].

        It stands there in `STILL_ROWS` rows at least, see `mmw.traffic.live.presence`; its poses count after these.

        Args:
            rank: The vehicle.
            row: The next row, in which it is seen first.
            bodies: All that is off the lanes, as vehicles see it.

        Raises:
            InputError: If there is no safe place, or the engine cannot do this; nothing has changed then. The message
                goes on after the name of the call.
        """
        ...

    def drive(self, row: int, seen: Seen) -> np.ndarray:
        """Return the poses of all vehicles in the row after the last one, shape [V, 7].

        Args:
            row: Its number at 100 Hz; the first call has a negative one, so that filters settle.
            seen: Bodies that vehicles must not drive into. Poses of vehicles that were removed do not count.
        """
        ...

    def close(self) -> None:
        """Free what the engine holds outside of Python's memory; poses cannot be made any more."""
        ...


SETTLE_ROWS = 60
"""Rows before row 0 that the filters of the lean need to settle; engines start `SETTLE_S` and more before."""
