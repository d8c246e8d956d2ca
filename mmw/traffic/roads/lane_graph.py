"""Define the lane graph: center lines that vehicles follow, and their successors."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mmw.core.errors import InputError
from mmw.traffic.polyline import arc_length


@dataclass(frozen=True)
class Lane:
    """One driving lane, or one connection through a junction, in driving direction."""

    name: str
    points: np.ndarray
    """Center line on the road surface in the town frame [m], shape [N, 3], float64, at most 2 m apart."""
    width: float
    """Lane width [m]."""
    speed: float
    """Speed limit [m/s]."""
    junction: str = ""
    """Name of the junction that this lane crosses; empty on a road."""
    priority: int = 0
    """In a junction, the higher number goes first (a ring before its arms, a main road before a side road)."""
    successors: tuple[str, ...] = ()
    """Names of the lanes that begin where this one ends."""
    left: str = ""
    """Name of the lane beside it, to the left and in the same direction, that vehicles may change to; empty if none."""
    right: str = ""
    """The same to the right."""
    signal: str = ""
    """In a junction with traffic lights, the phase in which it is green, such as `a`; empty without lights."""
    stop: float = 1.2
    """Vehicles that have to wait stop with the bumper this far before the end of the lane [m]: behind the stop line."""

    @cached_property
    def station(self) -> np.ndarray:
        """Arc length of every point from the start [m], shape [N]."""
        return arc_length(self.points)

    @cached_property
    def plan_station(self) -> np.ndarray:
        """Arc length of every point seen from above [m], shape [N]."""
        return arc_length(self.points[:, :2])

    @cached_property
    def plan_length(self) -> float:
        """Length of the lane seen from above [m]."""
        return float(np.linalg.norm(np.diff(self.points[:, :2], axis=0), axis=1).sum())

    @property
    def length(self) -> float:
        """Arc length of the lane [m]."""
        return float(self.station[-1])

    @property
    def headings(self) -> np.ndarray:
        """Heading in plan of every segment, counter-clockwise from east [rad], shape [N - 1]."""
        step = np.diff(self.points[:, :2], axis=0)
        return np.arctan2(step[:, 1], step[:, 0])


@dataclass(frozen=True)
class LaneGraph:
    """All lanes of a town by name."""

    lanes: dict[str, Lane] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for lane in self.lanes.values():
            for name in lane.successors:
                if name not in self.lanes:
                    raise InputError(f"lane {lane.name!r} leads to {name!r}, which does not exist; rebuild the town")
            for side in (lane.left, lane.right):
                if side and side not in self.lanes:
                    raise InputError(f"lane {lane.name!r} lies beside {side!r}, which does not exist; rebuild the town")

    @cached_property
    def predecessors(self) -> dict[str, tuple[str, ...]]:
        """Names of the lanes that lead to each lane, in the order of the graph."""
        found: dict[str, list[str]] = {name: [] for name in self.lanes}
        for lane in self.lanes.values():
            for name in lane.successors:
                found[name].append(lane.name)
        return {name: tuple(before) for name, before in found.items()}

    def kinks(self) -> dict[tuple[str, str], float]:
        """Return the change of heading where a lane meets its successor [rad], by the two names."""
        turns = {}
        for lane in self.lanes.values():
            for name in lane.successors:
                turn = self.lanes[name].headings[0] - lane.headings[-1]
                turns[lane.name, name] = abs(float((turn + np.pi) % (2 * np.pi) - np.pi))
        return turns
