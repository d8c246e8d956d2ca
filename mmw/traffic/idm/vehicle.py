"""A vehicle: its station on its line, the lanes under it, and the junctions ahead."""

from dataclasses import dataclass
from math import inf
from typing import NamedTuple

from mmw.traffic.idm.junctions import Passage
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.traffic.route import EXTENSION, PATH_STEP, Line
from mmw.traffic.vehicle_pose import Shape, Stance

STOP_SHORT = 1.2
"""Vehicles stop with the bumper this far before the end of their route [m]."""

STOP_BRAKING = 1.8
"""Planned deceleration towards a stop line [m/s^2]."""

ROOM = 2.5
"""A vehicle enters a junction only if the lane behind it has its length and this much more [m]."""


@dataclass(frozen=True)
class Change:
    """A change from one lane of the path to the next one of its list, which lies beside it."""

    segment: int
    """Index of the lane that is left; the next one in the list is the lane beside it."""
    clear: float
    """Station of an axle from which on that part of the body is off the lane that is left [m]."""
    end: float
    """Station where the line has reached the middle of the new lane [m]."""


@dataclass
class Plan:
    """The path of a vehicle from its start to the end of its route."""

    stance: Stance
    limit: list[float]
    """Desired speed at every sample of the path [m/s]."""
    begins: list[float]
    """Station where each lane of the path begins [m]; extrapolated for a lane that is entered from the side."""
    passages: list[Passage]
    change: Change | None = None
    """The last change of lanes on the path."""
    leaves: bool = False
    """Whether the vehicle leaves the network at the end of the path; else it stops there."""


@dataclass
class Car:
    """A vehicle in the engine."""

    plan: Plan
    station: float
    """Front axle [m]; `stand_at` changes it."""
    headway: float
    """IDM: time gap [s]."""
    factor: float = 1.0
    """The driver's share of the speed limit."""
    paint: str = ""
    speed: float = 0.0
    acceleration: float = 0.0
    granted: int = 0
    """Passages that the vehicle may enter, counted from the first."""
    segment: int = 0
    """Index of the lane under the front bumper."""
    rear_segment: int = 0
    """Index of the lane under the rear bumper."""
    stopped_time: float = 0.0
    """Time since it last moved [s]."""
    stop_braking: float = STOP_BRAKING
    """Planned deceleration towards the next stop line [m/s^2]."""
    changes: int = 0
    """Changes of lanes that have been begun (count)."""
    settled: float = -inf
    """Time of the last change of lanes, begun or tried [s]."""
    is_cav: bool = False
    entered_at: int = 0
    """Engine step at which it entered."""
    left_at: int | None = None
    """Engine step at which it had left; None while it is on the road."""

    def __post_init__(self) -> None:
        self.shape: Shape = self.plan.stance.track.shape
        self._ahead, self._behind = self.shape.front, self.shape.behind
        self.stand_at(self.station)
        self.follow(self.plan)

    def stand_at(self, station: float) -> None:
        """Put the front axle at a station [m]."""
        self.station = station
        self.front = station + self._ahead
        """Station of the front bumper [m]."""
        self.rear = station - self._behind
        """Station of the rear bumper [m]."""

    def follow(self, plan: Plan) -> None:
        """Change to a plan that is the same behind the vehicle."""
        self.plan = plan
        self.line: Line = plan.stance.track.line
        self.begins = plan.begins
        self.lanes = self.line.lanes
        self.ends: list[float] = self.line.ends.tolist()
        self.passages = plan.passages
        self.change = plan.change

    def place(self) -> None:
        """Find the lanes under both bumpers."""
        ends = self.ends
        while self.front >= ends[self.segment] and self.segment + 1 < len(ends):
            self.segment += 1
        while self.rear_segment < self.segment and self.rear >= ends[self.rear_segment]:
            self.rear_segment += 1
        if self.change is not None and self.rear >= self.change.end:
            self.change = None

    def place_in_plan(self) -> tuple[float, float]:
        """Return x and y of the middle between the axles [m]."""
        row = min(int((self.station + EXTENSION) / PATH_STEP), len(self.plan.stance.columns) - 1)
        x, y = self.plan.stance.columns[row, :2].tolist()
        return x, y

    @property
    def ahead(self) -> tuple[int, int]:
        """First and last index of the lanes that the front of the vehicle is on; two during a change of lanes."""
        return self._lanes_from(self.station, self.segment)

    @property
    def occupied(self) -> tuple[int, int]:
        """First and last index of the lanes that the vehicle is on, front to rear."""
        return self._lanes_from(self.rear, self.rear_segment)

    def _lanes_from(self, station: float, segment: int) -> tuple[int, int]:
        """Return the first and last index of the lanes from a station on a lane to the front bumper."""
        if self.change is None:
            return segment, self.segment
        first = self.change.segment if station < self.change.clear else segment
        return min(first, segment), max(self.change.segment + 1, self.segment)

    def index_of(self, lane: str, first: int = 0) -> int:
        """Return the index of a lane that lies on the path, at `first` or later, and not before the vehicle's rear."""
        return self.lanes.index(lane, max(first, min(self.occupied[0], self.ahead[0])))

    def stop_station(self) -> float:
        """Return the station where the front bumper has to stop [m]; inf if it need not."""
        if self.granted < len(self.passages):
            return self.passages[self.granted].stop
        return inf if self.plan.leaves else self.ends[-1] - STOP_SHORT

    def desired_speed(self, station: float) -> float:
        """Return the speed that the road allows at a station of the front axle [m/s]."""
        limit = self.plan.limit
        at = int((station + EXTENSION) / PATH_STEP)
        return limit[at] if at < len(limit) else limit[-1]


class OccupiedSpan(NamedTuple):
    """A vehicle on a lane; stations from the start of the lane [m]."""

    rear: float
    front: float
    vehicle: int
    segment: int
    """Index of the lane on the vehicle's path."""


def usable_length(lane: Lane, begin: float, end: float) -> float:
    """Return the length of a lane up to `STOP_SHORT` beyond the bumper of a vehicle that waits at its end [m]."""
    return end - begin - lane.stop + STOP_SHORT


def find_passages(line: Line, graph: LaneGraph, shape: Shape) -> list[Passage]:
    """Return the junctions on a path; those without room for the vehicle between them form one passage."""
    ends = line.ends.tolist()
    begins = [0.0, *ends[:-1]]
    passages: list[Passage] = []
    index = 0
    while index < len(line.lanes):
        if not graph.lanes[line.lanes[index]].junction:
            index += 1
            continue
        first = index
        connections = []
        while index < len(line.lanes):
            lane = graph.lanes[line.lanes[index]]
            if lane.junction:
                connections.append((lane.name, begins[index], ends[index]))
            elif usable_length(lane, begins[index], ends[index]) >= shape.length + ROOM:
                break
            index += 1
        has_exit = index < len(line.lanes)
        passages.append(
            Passage(
                connections=tuple(connections),
                start=begins[first],
                stop=begins[first] - (graph.lanes[line.lanes[first - 1]].stop if first else STOP_SHORT),
                first_segment=first,
                exit_lane=line.lanes[index] if has_exit else "",
                exit_start=begins[index] if has_exit else ends[-1],
                priority=graph.lanes[line.lanes[first]].priority,
            )
        )
    return passages
