"""Find a safe place on the route of a vehicle that was taken out, so that its driver can go on from there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mmw.traffic.idm.driver import BRAKING, STANDSTILL_GAP
from mmw.traffic.idm.engine import IdmEngine
from mmw.traffic.idm.junctions import boxes_overlap
from mmw.traffic.idm.vehicle import ROOM, STOP_SHORT, Car
from mmw.traffic.live.obstacles import BlockedSpan
from mmw.traffic.route import EXTENSION, PATH_STEP

SEARCH_M = 100.0
"""Places up to this far along the route from where a vehicle left it are tried [m]; design value."""

SEARCH_STEP = 1.0
"""Distance between the places that are tried [m]; design value."""

BODY_S = 2.0
"""Bodies off the lanes need the way that they go in this time [s], as they brake for nobody; design value."""

SIDE_GAP = 0.3
"""Least distance aside between the boxes of a vehicle that comes back and of others [m]; design value."""


@dataclass(frozen=True)
class Returning:
    """A vehicle of the engine that is to stand on its route again."""

    index: int
    wanted: float
    """Station of its front axle where it left the route [m]."""
    first: float
    """Station where its route began [m]."""
    lag_s: float
    """Time by which the engine is ahead of the row in which it will be seen [s]."""


def find_place(
    engine: IdmEngine, absent: set[int], blocked: Mapping[str, Sequence[BlockedSpan]], one: Returning
) -> float | None:
    """Return the station nearest to the wanted one at which a vehicle can stand; None if there is none.

    There it is on one lane, in front of the stop line, in no junction, not beside another vehicle, and no nearer than
    the gap of a queue to those ahead. Who comes from behind can brake in comfort after a time gap, and who may enter
    the lane from a junction keeps its room.

    Args:
        engine: The other vehicles.
        absent: Vehicles of the engine that are not on the lanes.
        blocked: Lane -> stretches that bodies off the lanes block.
        one: The vehicle.
    """
    car = engine.cars[one.index]
    others = {
        index: other
        for index, other in enumerate(engine.cars)
        if index != one.index and index not in absent and other.left_at is None
    }
    low = one.first if car.plan.change is None else max(one.first, car.plan.change.end + car.shape.behind)
    high = car.ends[-1] - STOP_SHORT - car.shape.front
    steps = np.arange(0.0, SEARCH_M + SEARCH_STEP, SEARCH_STEP)
    for station in (one.wanted + np.stack([steps, -steps], axis=1)).reshape(-1).tolist():
        if low <= station <= high and _is_safe(engine, others, blocked, car, station, one.lag_s):
            return station
    return None


def _is_safe(
    engine: IdmEngine,
    others: Mapping[int, Car],
    blocked: Mapping[str, Sequence[BlockedSpan]],
    car: Car,
    station: float,
    lag_s: float,
) -> bool:
    """Return whether a vehicle can stand with its front axle at a station of its path."""
    front, rear = station + car.shape.front, station - car.shape.behind
    segment = int(np.searchsorted(car.ends, front, side="right"))
    if segment >= len(car.ends) or rear < (car.begins[segment] if segment else -np.inf):
        return False
    lane = engine.graph.lanes[car.line.lanes[segment]]
    if lane.junction or front > car.ends[segment] - lane.stop:
        return False
    begin = car.begins[segment]
    ahead, behind = front - begin, rear - begin  # on the lane
    for span in blocked.get(lane.name, ()):
        if span.rear < ahead + STANDSTILL_GAP and span.front + BODY_S * span.speed > behind - STANDSTILL_GAP:
            return False
    return all(
        _keeps_clear(other, lane.name, behind, ahead, lag_s) and _is_aside(car, station, other)
        for other in others.values()
    )


def _keeps_clear(other: Car, lane: str, rear: float, front: float, lag_s: float) -> bool:
    """Return whether another vehicle stays clear of a stretch of a lane that is blocked from now on."""
    braking = other.speed * other.headway + other.speed**2 / (2 * BRAKING)
    shown = other.speed * lag_s  # it is seen so far behind the place that the engine has
    for segment in range(min(other.occupied[0], other.ahead[0]), len(other.ends)):
        begin = other.begins[segment]
        if begin - other.front > braking + STANDSTILL_GAP:
            break
        if other.line.lanes[segment] != lane:
            continue
        is_ahead = other.rear - begin - shown >= front + STANDSTILL_GAP
        is_behind = rear - (other.front - begin) >= STANDSTILL_GAP + braking
        if not (is_ahead or is_behind):
            return False
    return not any(
        passage.exit_lane == lane and passage.exit_start > other.rear and rear < other.shape.length + 2 * ROOM
        for passage in other.passages[: other.granted]
    )


def _is_aside(car: Car, station: float, other: Car) -> bool:
    """Return whether a vehicle at a station does not touch another one, with some distance."""
    boxes = []
    for one, at, gap in ((car, station, SIDE_GAP), (other, other.station, 0.0)):
        columns = one.plan.stance.columns
        x, y, heading, height = columns[min(round((at + EXTENSION) / PATH_STEP), len(columns) - 1), :4].tolist()
        middle = 0.5 * (one.shape.front - one.shape.rear)
        center = np.array([x + middle * np.cos(heading), y + middle * np.sin(heading)])
        boxes.append((center, np.array(heading), (0.5 * one.shape.length + gap, one.shape.half_width + gap), height))
    (a, b) = boxes
    return abs(a[3] - b[3]) > car.shape.height or not bool(boxes_overlap(*a[:3], *b[:3]))
