"""Let vehicles leave a network where its roads end, and others enter where they begin.

Maps end somewhere. A vehicle that reaches the end of a road there is gone, and another one enters at a place where
a road comes from nowhere, so that as many are on the road as in the beginning. In a town whose every lane leads on,
nobody leaves and nobody enters. Connected vehicles stay: they start where roads last long enough, and keep to routes
that do.
"""

from collections.abc import Callable, Sequence
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from mmw.core.remember import remembered
from mmw.traffic.idm.vehicle import Car
from mmw.traffic.polyline import sample_polyline
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.route import endless_lanes
from mmw.traffic.spawn import BlockedPointError, SpawnPoint, seeded

if TYPE_CHECKING:
    from mmw.traffic.idm.engine import IdmEngine

ENTRY = 9.0
"""Station of the middle between the axles of a vehicle that enters [m]: a body of up to 18 m is on the road, and so is
what the low pass of its height needs behind a wheelbase of up to 11 m."""

MIN_LANE_LENGTH = 25.0
"""A lane that vehicles enter on is at least this long [m]; design value."""

ENTRY_GAP = 8.0
"""A vehicle enters if its lane is free for a body of 18 m and this far before its front bumper [m]; design value."""

ENTRY_CLEARANCE = 7.0
"""The middles of other vehicles are at least this far from one that enters [m], also on lanes of other roads."""

ADMIT_EVERY = 10
"""Engine steps from one look at the entries to the next."""


class OpenNetwork:
    """The lanes at whose ends vehicles leave, those on which they enter, and how long they can stay."""

    def __init__(self, graph: LaneGraph) -> None:
        """Find them: lanes that end beside lanes that go on are no exits but lanes that end, and nobody drives there.

        Where no lane leads to an exit or in a circle, all lanes can be used.
        """
        self.graph = graph
        endless = endless_lanes(graph)
        self.exits = _edge_lanes(graph, {name: lane.successors for name, lane in graph.lanes.items()})
        self.usable = _leading_to(graph, endless | self.exits) or frozenset(graph.lanes)
        starts = _edge_lanes(graph, graph.predecessors)
        is_long = {name for name in starts if graph.lanes[name].plan_length >= MIN_LANE_LENGTH}
        self.entries = sorted(is_long & self.usable) if self.exits else []
        """By name."""
        self.ends_well = bool(endless or self.exits)
        """Whether routes need not end where a vehicle has to stop."""
        self.time = self._times(endless)
        """Usable lane -> time at the speed limits from its start to the last exit that can be reached [s]; inf if
        vehicles can stay."""

    def _times(self, endless: frozenset[str]) -> dict[str, float]:
        time = dict.fromkeys(sorted(self.usable), 0.0) | dict.fromkeys(sorted(endless & self.usable), inf)
        rest, is_settled = sorted(self.usable - endless), False  # no circle among them, so this comes to an end
        while not is_settled:
            is_settled = True
            for name in rest:
                after = max((time[other] for other in self.graph.lanes[name].successors if other in time), default=0.0)
                new = self.crossing_time([name]) + after
                if new > time[name]:
                    time[name], is_settled = new, False
        return time

    def crossing_time(self, chain: Sequence[str]) -> float:
        """Return the time at the speed limits along lanes [s]; vehicles take longer."""
        return sum(self.graph.lanes[name].plan_length / self.graph.lanes[name].speed for name in chain)

    def time_left(self, point: SpawnPoint) -> float:
        """Return the time from a place to the last exit that can be reached from it [s]."""
        return self.time.get(point.lane, 0.0) - point.station / self.graph.lanes[point.lane].speed


@remembered(size=4)
def open_network(graph: LaneGraph) -> OpenNetwork:
    """Return the open ends of a town, which all its scenarios share."""
    return OpenNetwork(graph)


def _edge_lanes(graph: LaneGraph, onward: dict[str, tuple[str, ...]]) -> frozenset[str]:
    """Return lanes of roads that lead nowhere, as do all lanes beside them in the same direction."""
    found = set()
    for name, lane in graph.lanes.items():
        group, queue = {name}, [name]
        while queue:
            here = graph.lanes[queue.pop()]
            fresh = {side for side in (here.left, here.right) if side} - group
            group |= fresh
            queue += fresh
        if not lane.junction and not any(onward[other] for other in group):
            found.add(name)
    return frozenset(found)


def _leading_to(graph: LaneGraph, goals: frozenset[str]) -> frozenset[str]:
    """Return the lanes from which one of some others can be reached, these included."""
    found, queue = set(goals), sorted(goals)
    while queue:
        fresh = set(graph.predecessors[queue.pop()]) - found
        found |= fresh
        queue += sorted(fresh)
    return frozenset(found)


class Arrivals:
    """Lets vehicles enter for those that have left."""

    def __init__(
        self, network: OpenNetwork, count: int, seed: int, enter: Callable[[int, SpawnPoint, float], Car]
    ) -> None:
        """Keep as many vehicles on the road as in the beginning.

        Args:
            network: The open network.
            count: Vehicles on the road.
            seed: Of the scenario.
            enter: Makes a vehicle of a rank at a place, some time after the engine's start [s], or raises
                `BlockedPointError`.
        """
        self.network, self.count, self.seed, self.enter = network, count, seed, enter
        self.points = []
        for name in network.entries:
            lane = network.graph.lanes[name]
            place = sample_polyline(lane.points, lane.plan_station, np.array([ENTRY]))[0]
            self.points.append(SpawnPoint(name, ENTRY, tuple(place.tolist())))

    def admit(self, engine: "IdmEngine") -> None:
        """Let one vehicle enter where there is room, if one has left; a start where none can enter is closed."""
        present = [car for car in engine.cars if car.left_at is None]
        if len(present) >= self.count or not self.points or engine.steps % ADMIT_EVERY:
            return
        rank = len(engine.cars)
        for index in seeded(self.seed, rank, engine.steps, 6).permutation(len(self.points)).tolist():
            point = self.points[index]
            if not self._is_free(engine, point, present):
                continue
            try:
                engine.add(self.enter(rank, point, engine.time))
            except BlockedPointError:
                del self.points[index]
            return

    def _is_free(self, engine: "IdmEngine", point: SpawnPoint, present: Sequence[Car]) -> bool:
        if any(span.rear < 2 * ENTRY + ENTRY_GAP for span in engine.spans.get(point.lane, ())):
            return False
        places = np.array([car.place_in_plan() for car in present]).reshape(-1, 2)
        return not (np.linalg.norm(places - point.position[:2], axis=1) < ENTRY_CLEARANCE).any()
