"""Find the stretches of lanes that a body blocks, wherever it stands or moves."""

from dataclasses import dataclass

import numpy as np

from mmw.core.remember import remembered
from mmw.traffic.polyline import sample_polyline
from mmw.traffic.roads.lane_graph import LaneGraph

SPACING = 0.5
"""Distance between the samples of lanes that are compared with a body [m]."""

HALF_LANE_BODY = 1.15
"""Half the width of the vehicles on a lane and some distance [m]: a body nearer to the middle of the lane blocks it."""

SAME_LEVEL = 2.5
"""A body blocks lanes whose height differs by less than this [m], not those of a bridge over it."""


@dataclass(frozen=True)
class Body:
    """A body that is on no route, seen from above."""

    position: tuple[float, float, float]
    """Middle of its box, on the ground [m]."""
    heading: float
    """[rad]."""
    velocity: tuple[float, float]
    """World frame [m/s]."""
    half: tuple[float, float]
    """Half its length and half its width [m]."""


@dataclass(frozen=True)
class BlockedSpan:
    """A stretch of a lane that a body blocks; stations from the start of the lane, seen from above [m]."""

    rear: float
    front: float
    speed: float
    """Of the body along the lane, >= 0 [m/s]."""


class LaneSamples:
    """Samples of the middles of all lanes of a town."""

    def __init__(self, graph: LaneGraph) -> None:
        """Sample the lanes every `SPACING`."""
        self.names = list(graph.lanes)
        points, station, lane, along = [np.zeros((0, 3))], [np.zeros(0)], [np.zeros(0, np.int64)], [np.zeros((0, 2))]
        for index, one in enumerate(graph.lanes.values()):
            count = max(2, int(np.ceil(one.plan_length / SPACING)) + 1)
            at = np.linspace(0.0, one.plan_length, count)
            own = sample_polyline(one.points, one.plan_station, at)
            step = np.gradient(own[:, :2], axis=0)
            points.append(own)
            station.append(at)
            lane.append(np.full(count, index))
            along.append(step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9))
        self._points, self._station = np.concatenate(points), np.concatenate(station)
        self._lane, self._along = np.concatenate(lane), np.concatenate(along)

    def blocked(self, body: Body) -> dict[str, BlockedSpan]:
        """Return the stretch that a body blocks of every lane that it is on or beside, by the lane's name."""
        offset = self._points - np.asarray(body.position)
        reach = float(np.hypot(*body.half)) + HALF_LANE_BODY
        near = np.flatnonzero(
            (np.abs(offset[:, 0]) < reach) & (np.abs(offset[:, 1]) < reach) & (np.abs(offset[:, 2]) < SAME_LEVEL)
        )
        c, s = np.cos(body.heading), np.sin(body.heading)
        forward = offset[near, 0] * c + offset[near, 1] * s
        left = offset[near, 1] * c - offset[near, 0] * s
        away = np.hypot(np.maximum(np.abs(forward) - body.half[0], 0.0), np.maximum(np.abs(left) - body.half[1], 0.0))
        near = near[away < HALF_LANE_BODY]
        found = {}
        for index in np.unique(self._lane[near]):
            own = near[self._lane[near] == index]
            speed = float((self._along[own] @ np.asarray(body.velocity)).mean())
            station = self._station[own]
            found[self.names[index]] = BlockedSpan(float(station.min()), float(station.max()), max(0.0, speed))
        return found


@remembered(size=4)
def lane_samples(graph: LaneGraph) -> LaneSamples:
    """Return the samples of a town's lanes, which all its scenarios share."""
    return LaneSamples(graph)
