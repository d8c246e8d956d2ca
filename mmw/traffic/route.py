"""Route a vehicle: a sequence of lanes, joined to one line."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mmw.traffic.polyline import arc_length, sample_polyline
from mmw.traffic.roads.lane_graph import Lane, LaneGraph

PATH_STEP = 0.1
"""Spacing of path samples [m]."""

EXTENSION = 14.0
"""Straight run before the first and after the last lane [m]: support for filters and for the axle behind."""


@dataclass(frozen=True)
class Line:
    """Joined center lines, sampled every `PATH_STEP` of plan length; station 0 is the start of the first lane."""

    lanes: tuple[str, ...]
    """Names in driving order."""
    ends: np.ndarray
    """Station where each lane ends [m], shape [lanes]."""
    station: np.ndarray
    """Station of every sample [m], shape [N]; from -EXTENSION to the end plus EXTENSION."""
    points: np.ndarray
    """Samples in the world frame [m], shape [N, 3], as the lanes give them."""


def endless_lanes(graph: LaneGraph) -> frozenset[str]:
    """Return the lanes from which a vehicle can drive on endlessly, so that it never has to stop at a dead end."""
    endless = set(graph.lanes)
    while True:
        dead = [name for name in endless if not any(s in endless for s in graph.lanes[name].successors)]
        if not dead:
            return frozenset(endless)
        endless.difference_update(dead)


def choose_lanes(
    graph: LaneGraph,
    first: str,
    length: float,
    generator: np.random.Generator,
    is_open: Callable[[str], bool],
    accepts: Callable[[Sequence[str]], bool] = bool,
) -> list[str]:
    """Return a random chain of lanes that covers a plan length [m] after the first, each successor as likely as others.

    Every successor draws a number and the lowest open one wins. So closing a lane changes only the chains that would
    have used it, and a longer chain begins like a shorter one. A lane without an open successor ends the chain.
    `accepts` tells of a chain up to an open lane whether it may go on there; all may by default.
    """
    chain = [first]
    covered = 0.0
    while covered < length:
        successors = graph.lanes[chain[-1]].successors
        draws = zip(generator.random(len(successors)), successors, strict=True)
        open_draws = [draw for draw in draws if is_open(draw[1]) and accepts([*chain, draw[1]])]
        if not open_draws:
            break
        chain.append(min(open_draws)[1])
        covered += graph.lanes[chain[-1]].plan_length
    return chain


def join_lanes(lanes: Sequence[Lane]) -> Line:
    """Return the center lines of successive lanes as one line with equally spaced samples."""
    points = np.concatenate([np.asarray(lane.points, np.float64) for lane in lanes])
    counts = np.cumsum([len(lane.points) for lane in lanes])
    along = arc_length(points[:, :2])
    ends = along[counts - 1]
    points, along = _without_repeats(points, along)
    first = points[0] - EXTENSION * _direction(points[0], points[1])
    last = points[-1] + EXTENSION * _direction(points[-2], points[-1])
    points = np.concatenate([[first], points, [last]])
    along = np.concatenate([[-EXTENSION], along, [along[-1] + EXTENSION]])
    count = int(np.floor((along[-1] - along[0]) / PATH_STEP)) + 1
    station = along[0] + PATH_STEP * np.arange(count)
    return Line(tuple(lane.name for lane in lanes), ends, station, sample_polyline(points, along, station))


def branch_line(line: Line, row: int, points: np.ndarray, names: Sequence[str], last: Sequence[int]) -> Line:
    """Return a line that equals another up to a sample, and goes on through other points.

    Args:
        line: The line up to `row`.
        row: Last common sample.
        points: Further points [m], shape [N, 3]; the first one is that sample.
        names: Lanes from the first one that ends after `row`.
        last: Index in `points` where each of these lanes ends.
    """
    along = line.station[row] + arc_length(points[:, :2])
    kept = int(np.searchsorted(line.ends, line.station[row], side="right"))
    ends = np.concatenate([line.ends[:kept], along[np.asarray(last)]])
    points, along = _without_repeats(points, along)
    points = np.concatenate([points, [points[-1] + EXTENSION * _direction(points[-2], points[-1])]])
    along = np.append(along, along[-1] + EXTENSION)
    count = int(np.floor((along[-1] - line.station[0]) / PATH_STEP)) + 1
    station = line.station[0] + PATH_STEP * np.arange(count)
    onward = sample_polyline(points, along, station[row + 1 :])
    return Line((*line.lanes[:kept], *names), ends, station, np.concatenate([line.points[: row + 1], onward]))


def _without_repeats(points: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points and stations without points that repeat the one before, seen from above."""
    kept = np.concatenate([[True], np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1) > 1e-6])
    return points[kept], along[kept]


def _direction(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    step = end - start
    return step / np.hypot(step[0], step[1])
