"""Decide which vehicles may cross a junction, from swept boxes and reservations, without starvation."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from mmw.core.remember import remembered
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.route import PATH_STEP, join_lanes
from mmw.traffic.vehicle_pose import Shape, directions, follow_line

SIDE_MARGIN = 0.25
"""Added to each side of a swept box [m]: two vehicles pass at least twice this apart."""

END_MARGIN = 0.4
"""Added to each end of a swept box [m]."""

SWEEP_STEP = 5
"""Swept boxes are this many path samples apart."""

PATIENCE = 4.0
"""Extra waiting time after which a vehicle goes before any priority [s]."""

HOLD_AFTER = 4.0
"""A vehicle that has waited this long blocks later ones that conflict with it [s]."""

BLOCK_AFTER = 15.0
"""Waiting time after which a vehicle enters without room behind the junction, which resolves deadlocks [s]."""


def boxes_overlap(
    center_a: np.ndarray,
    heading_a: np.ndarray,
    half_a: tuple[float, float],
    center_b: np.ndarray,
    heading_b: np.ndarray,
    half_b: tuple[float, float],
) -> np.ndarray:
    """Return which oriented rectangles overlap, seen from above.

    Args:
        center_a: Middles of the first rectangles [m], shape [..., 2].
        heading_a: Their headings [rad], shape [...].
        half_a: Their half length and half width [m].
        center_b: Middles of the second rectangles, broadcast against the first.
        heading_b: Their headings.
        half_b: Their half length and half width.

    Returns:
        True where the rectangles overlap, broadcast shape.

    Source: separating axes of two boxes, Gottschalk, Lin, Manocha, OBBTree, SIGGRAPH 1996, section 5.
    """
    dx, dy = np.moveaxis(center_b - center_a, -1, 0)
    turn = heading_b - heading_a
    c, s = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    ca, sa, cb, sb = np.cos(heading_a), np.sin(heading_a), np.cos(heading_b), np.sin(heading_b)
    return (
        (np.abs(dx * ca + dy * sa) <= half_a[0] + half_b[0] * c + half_b[1] * s)
        & (np.abs(dy * ca - dx * sa) <= half_a[1] + half_b[0] * s + half_b[1] * c)
        & (np.abs(dx * cb + dy * sb) <= half_b[0] + half_a[0] * c + half_a[1] * s)
        & (np.abs(dy * cb - dx * sb) <= half_b[1] + half_a[0] * s + half_a[1] * c)
    )


@dataclass(frozen=True)
class Sweep:
    """The boxes of a shape over one connection, from the front bumper's entry to the rear one's exit."""

    station: np.ndarray
    """Front axle's distance from the start of the connection [m], shape [K]."""
    center: np.ndarray
    """Middles of the boxes [m], shape [K, 2]."""
    heading: np.ndarray
    """Headings [rad], shape [K]."""
    height: np.ndarray
    """Height of the road [m], shape [K]."""
    half: tuple[float, float]
    """Half length and half width with margins [m]."""


class ConflictTable:
    """Conflicts between the connections of a junction, computed on first use."""

    def __init__(self, graph: LaneGraph) -> None:
        self.graph = graph
        self.junctions = {name: lane.junction for name, lane in graph.lanes.items()}
        """Lane -> its junction; connections of different ones have no conflict."""
        self._sweeps: dict[tuple[str, Shape], Sweep] = {}
        self._last: dict[tuple[str, Shape, str, Shape], float] = {}

    def prepare(self, vehicles: Iterable[tuple[Shape, Sequence["Passage"]]]) -> None:
        """Compute the swept boxes of shapes on passages, which takes some 0.5 ms each the first time."""
        needed = {
            (name, id(shape)): shape
            for shape, passages in vehicles
            for passage in passages
            for name, _, _ in passage.connections
        }
        for (name, _), shape in needed.items():
            self._sweep(name, shape)

    def last_conflict(self, name: str, shape: Shape, other: str, other_shape: Shape) -> float:
        """Return how far a vehicle has to go on one connection until it no longer conflicts with another connection.

        Args:
            name: Connection of the vehicle that moves.
            shape: Its shape.
            other: Connection that has to become free.
            other_shape: Shape that is to use it.

        Returns:
            Front axle's distance from the start of connection `name` [m]; -inf if the two never meet.
        """
        if name == other or self.junctions[name] != self.junctions[other]:
            return -np.inf
        key = (name, shape, other, other_shape)
        if key not in self._last:
            a, b = self._sweep(name, shape), self._sweep(other, other_shape)
            apart = np.linalg.norm(a.center[:, None] - b.center[None], axis=-1)
            rows, columns = np.nonzero(apart <= np.hypot(*a.half) + np.hypot(*b.half))
            hit = boxes_overlap(a.center[rows], a.heading[rows], a.half, b.center[columns], b.heading[columns], b.half)
            hit &= np.abs(a.height[rows] - b.height[columns]) < max(shape.height, other_shape.height)
            self._last[key] = float(a.station[rows[hit].max()]) + PATH_STEP * SWEEP_STEP if hit.any() else -np.inf
        return self._last[key]

    def _sweep(self, name: str, shape: Shape) -> Sweep:
        key = (name, shape)
        if key not in self._sweeps:
            lane = self.graph.lanes[name]
            chain = [lane, *(self.graph.lanes[s] for s in lane.successors[:1])]
            if before := self.graph.predecessors[name]:
                chain.insert(0, self.graph.lanes[min(before)])
            line = join_lanes(chain)
            track = follow_line(line, shape)
            index = len(chain) - 1 - len(lane.successors[:1])
            start = line.ends[index - 1] if index else 0.0
            inside = (line.station >= start - shape.front) & (line.station <= line.ends[index] + shape.behind)
            rows = np.flatnonzero(inside)[::SWEEP_STEP]
            heading = track.heading[rows]
            middle = track.center[rows] + 0.5 * (shape.front - shape.rear) * directions(heading)
            half = (0.5 * shape.length + END_MARGIN, shape.half_width + SIDE_MARGIN)
            self._sweeps[key] = Sweep(line.station[rows] - start, middle, heading, line.points[rows, 2], half)
        return self._sweeps[key]


@remembered(size=4)
def conflict_table(graph: LaneGraph) -> ConflictTable:
    """Return the conflicts of a town, which all its scenarios share."""
    return ConflictTable(graph)


@dataclass
class Passage:
    """A junction (or several without room between them) on a vehicle's path."""

    connections: tuple[tuple[str, float, float], ...]
    """Name, first and last station of every connection [m]."""
    start: float
    """Station where the first connection begins [m]."""
    stop: float
    """Station where the front bumper waits for it [m]."""
    first_segment: int
    """Index of the first connection in the path's lanes."""
    exit_lane: str
    """Lane that has to have room; empty at the end of the path."""
    exit_start: float
    """Station where that lane begins [m]."""
    priority: int
    """Priority of the first connection."""
    requested_at: float = field(default=np.nan)
    """Time of the first request [s]; NaN before."""


@dataclass(frozen=True)
class Request:
    """The request of a vehicle for its next passage."""

    vehicle: int
    shape: Shape
    passage: Passage
    has_room: bool
    """Whether the lane behind the junction has room now."""
    will_have_room: bool = True
    """Whether it has room once moving vehicles have left it."""
    occupants: tuple[int, ...] = ()
    """Vehicles that are on that lane or on their path to it."""
    has_green: bool = False
    """Whether a traffic light shows green; then neither priority nor waiting changes the order."""
    gives_way: bool = False
    """Whether it turns left on green, and so always waits for oncoming traffic."""


@dataclass(frozen=True)
class Reservation:
    """A connection that a vehicle has been granted and not left yet."""

    vehicle: int
    shape: Shape
    name: str
    start: float
    end: float


def grant_requests(
    table: ConflictTable,
    requests: list[Request],
    reservations: list[Reservation],
    station: list[float],
    time: float,
    blockers: dict[int, list[int]],
) -> list[int]:
    """Decide which vehicles may enter, and append their reservations.

    Vehicles that waited through more periods of `PATIENCE` seconds go first, then higher priority, then the earlier
    request. On green, left turns come last, and the others in the order of their requests.
    A vehicle that has waited `HOLD_AFTER` seconds in vain blocks later ones that need the same room or are in conflict,
    unless its exit is blocked by a standing vehicle, which may itself wait for one of them.

    Args:
        table: Conflicts.
        requests: Vehicles at a stop line or near it.
        reservations: Connections in use; granted ones are appended.
        station: Front axle's station of every vehicle [m].
        time: Now [s].
        blockers: Vehicle -> those that it waits for; those that prevent a refused request are added.

    Returns:
        Vehicles that were granted their passage, in order. Vehicles without room are skipped until `BLOCK_AFTER`.
    """

    def rank(request: Request) -> tuple:
        passage = request.passage
        if request.has_green:
            return 0, request.gives_way, passage.requested_at, request.vehicle
        waited = time - passage.requested_at
        return -int(waited / PATIENCE), -passage.priority, passage.requested_at, request.vehicle

    granted: list[int] = []
    reserved: list[tuple[str, Shape, int]] = []
    reserved_exits: dict[str, int] = {}
    for request in sorted(requests, key=rank):
        names = [name for name, _, _ in request.passage.connections]
        exit_lane = request.passage.exit_lane
        waited = time - request.passage.requested_at
        before: list[int] = []
        if waited < BLOCK_AFTER:
            before += [reserved_exits[exit_lane]] if exit_lane in reserved_exits else []
            before += [] if request.has_room else request.occupants
        crowded = bool(before) or not (request.has_room or waited >= BLOCK_AFTER)
        here = {table.junctions[name] for name in names}
        for other in reservations:
            if other.vehicle == request.vehicle or table.junctions[other.name] not in here:
                continue
            gone = station[other.vehicle] - other.start
            for name in names:
                if gone <= table.last_conflict(other.name, other.shape, name, request.shape):
                    before.append(other.vehicle)
                    break
        before += [
            vehicle
            for other, shape, vehicle in reserved
            if table.junctions[other] in here
            and any(table.last_conflict(name, request.shape, other, shape) > -np.inf for name in names)
        ]
        if not before and not crowded:
            own = request.vehicle, request.shape
            reservations += [Reservation(*own, *connection) for connection in request.passage.connections]
            granted.append(request.vehicle)
            continue
        blockers.setdefault(request.vehicle, []).extend(before)
        if waited >= HOLD_AFTER and not request.gives_way:
            if exit_lane:
                reserved_exits.setdefault(exit_lane, request.vehicle)
            if request.will_have_room:
                reserved += [(name, request.shape, request.vehicle) for name in names]
    return granted
