"""Vehicles for SUMO: models and routes that their bodies can drive, and how fast bends let them go."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mmw.core.errors import InputError
from mmw.traffic.ground_height import Ground
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.traffic.route import PATH_STEP, choose_lanes, join_lanes, living_lanes, plan_length, plan_stations
from mmw.traffic.smoothing import gaussian_smooth
from mmw.traffic.spawn import Places, SpawnPoint, draw_models, seeded
from mmw.traffic.speed_profile import (
    CURVE_BRAKING,
    LATERAL_ACCELERATION,
    LOWEST_SPEED,
    PATH_JERK,
    VERTICAL_ACCELERATION,
    VERTICAL_JERK,
)
from mmw.traffic.vehicle_pose import GROUND_SIGMA, MAX_STEER, PATH_SIGMA, Shape, follow_line, stand_on_ground

LEAD_IN = 25.0
"""A way across a junction is tried out from this far before it to this far behind it [m]."""

REACH = 12.0
"""Neighbouring lanes count for the bend of a lane up to this far [m]."""


@dataclass(frozen=True)
class SumoVehicle:
    """A vehicle before SUMO runs."""

    shape: Shape
    point: SpawnPoint
    lanes: tuple[str, ...]
    """Lanes in driving order, those across junctions included."""


class Drivers:
    """Draws vehicles that can drive where they are sent."""

    def __init__(self, graph: LaneGraph, ground: Ground, shapes: Sequence[Shape], length: float) -> None:
        """Start with an empty town.

        Args:
            graph: The lanes.
            ground: The drivable surface.
            shapes: Models.
            length: Plan length that every route covers at least [m].
        """
        self.graph, self.ground, self.shapes, self.length = graph, ground, shapes, length
        self.alive = living_lanes(graph) or frozenset(graph.lanes)
        self.places = Places(graph)
        self._fits: dict[tuple[str, str], bool] = {}

    def add(self, point: SpawnPoint, is_cav: bool, generator: np.random.Generator, key: Sequence[int]) -> SumoVehicle:
        """Return a vehicle at a spawn point.

        Args:
            point: Where it starts.
            is_cav: Whether it carries sensors; then low models come before high ones.
            generator: Draws the model.
            key: Seeds the route.

        Raises:
            InputError: If no model has room there, or a way on that it can drive.
        """
        for shape in draw_models(self.shapes, is_cav, generator):
            if self.places.fits(point, shape):
                is_open = partial(self._is_open, shape)
                lanes = choose_lanes(self.graph, point.lane, self.length, seeded(*key), is_open)
                if sum(plan_length(self.graph.lanes[name]) for name in lanes[1:]) >= self.length:
                    self.places.take(point, shape)
                    return SumoVehicle(shape, point, tuple(lanes))
        x, y, z = point.position
        raise InputError(
            f"spawn point on lane {point.lane!r} at ({x:.1f}, {y:.1f}, {z:.1f}) m: no model has room and a way on that "
            "keeps its wheels on the road; widen the road there, or add a shorter vehicle model"
        )

    def _is_open(self, shape: Shape, name: str) -> bool:
        """Return whether a body can drive a lane and leave it again with its wheels on the road."""
        if name not in self.alive:
            return False
        lane = self.graph.lanes[name]
        if not lane.junction:
            return any(self._fits_on(after, shape) for after in lane.successors)
        exits = [way for after in lane.successors for way in self.graph.lanes[after].successors]
        return self._fits_on(name, shape) and any(self._fits_on(way, shape) for way in exits)

    def _fits_on(self, name: str, shape: Shape) -> bool:
        """Return whether a body's wheels stay on the road on a lane, which is tried out where it crosses a junction."""
        key = (name, shape.name)
        if key not in self._fits:
            lane = self.graph.lanes[name]
            self._fits[key] = not lane.junction or self._can_drive(lane, shape)
        return self._fits[key]

    def _can_drive(self, lane: Lane, shape: Shape) -> bool:
        before = self.graph.predecessors[lane.name]
        lanes = [_piece(self.graph.lanes[before[0]], -(LEAD_IN + shape.length)), lane] if before else [lane]
        behind = plan_length(lanes[0]) if before else 0.0
        end = behind + plan_length(lane)
        covered, onward = 0.0, lane
        while onward.successors and covered < LEAD_IN:
            onward = self.graph.lanes[onward.successors[0]]
            lanes.append(_piece(onward, LEAD_IN - covered))
            covered += plan_length(lanes[-1])
        track = follow_line(join_lanes(lanes), shape)
        inside = (track.line.station > behind - 1.0) & (track.line.station < end + LEAD_IN)
        if (np.abs(track.steer[inside]) > MAX_STEER).any():
            return False
        stance, _, _ = stand_on_ground(track, self.ground, min(behind, LEAD_IN))
        return stance is not None


def _piece(lane: Lane, length: float) -> Lane:
    """Return the first points of a lane up to a length [m], or the last ones if it is negative; at least two."""
    along = plan_stations(lane)
    if length < 0.0:
        return replace(lane, points=lane.points[min(int(np.searchsorted(along, along[-1] + length)), len(along) - 2) :])
    return replace(lane, points=lane.points[: max(int(np.searchsorted(along, length)) + 1, 2)])


def lane_limits(graph: LaneGraph) -> dict[str, np.ndarray]:
    """Return the speed that comfort allows along every lane, every `PATH_STEP` of plan length [m/s].

    The rules are those of `speed_limit` on the centre line: sideways and vertical acceleration and jerk, and braking
    ahead of a slower place on the same lane, or at the start of the only lane behind it. The lane's own limit counts
    too.
    """
    out: dict[str, np.ndarray] = {}
    for name, lane in graph.lanes.items():
        before = _straightest(graph, graph.predecessors[name], lane.headings[0])
        after = _straightest(graph, lane.successors, lane.headings[-1])
        around = [*(_piece(one, -REACH) for one in before), lane, *(_piece(one, REACH) for one in after)]
        line = join_lanes(around)
        start, end = (float(line.ends[0]) if before else 0.0), float(line.ends[len(before)])
        inside = np.flatnonzero((line.station > start - PATH_STEP) & (line.station < end + PATH_STEP))
        flat = gaussian_smooth(line.points, PATH_SIGMA / PATH_STEP)
        height = gaussian_smooth(flat[:, 2], GROUND_SIGMA / PATH_STEP)
        body = np.column_stack([flat[:, :2], height])
        second = np.gradient(np.gradient(body, PATH_STEP, axis=0), PATH_STEP, axis=0)
        third = np.gradient(second, PATH_STEP, axis=0)
        tiny = 1e-9
        speed = np.minimum.reduce(
            [
                np.sqrt(LATERAL_ACCELERATION / (np.hypot(second[:, 0], second[:, 1]) + tiny)),
                np.sqrt(VERTICAL_ACCELERATION / (np.abs(second[:, 2]) + tiny)),
                np.cbrt(PATH_JERK / (np.hypot(third[:, 0], third[:, 1]) + tiny)),
                np.cbrt(VERTICAL_JERK / (np.abs(third[:, 2]) + tiny)),
            ]
        )[inside]
        out[name] = np.clip(speed, LOWEST_SPEED, max(lane.speed, LOWEST_SPEED))
    ramped = {name: _ramp(speed) for name, speed in out.items()}
    for name, lane in graph.lanes.items():
        if len(lane.successors) == 1:
            ahead = ramped[lane.successors[0]][0]
            ramped[name] = _ramp(np.append(out[name], ahead))[:-1]
    return ramped


def _straightest(graph: LaneGraph, names: Sequence[str], heading: float) -> list[Lane]:
    """Return the lane whose headings at both ends are nearest to a heading [rad], as a list; an empty one of none."""
    lanes = [graph.lanes[name] for name in names]

    def bend(lane: Lane) -> float:
        return float(-np.cos(lane.headings[[0, -1]] - heading).sum())

    return sorted(lanes, key=bend)[:1]


def _ramp(speed: np.ndarray) -> np.ndarray:
    """Return speeds from which a driver can brake in comfort to those behind."""
    fall = 2 * CURVE_BRAKING * PATH_STEP * np.arange(len(speed))
    return np.sqrt(np.maximum(np.minimum.accumulate((speed**2 + fall)[::-1])[::-1] - fall, 0.0))


def entry_speeds(
    vehicles: Sequence[SumoVehicle], graph: LaneGraph, limit: Mapping[str, np.ndarray], braking: float
) -> list[float]:
    """Return speeds at the start from which every vehicle can stop at the end of its lane and behind its leader."""
    out = []
    for vehicle in vehicles:
        lane = graph.lanes[vehicle.point.lane]
        nose = vehicle.point.station + 0.5 * vehicle.shape.wheelbase + vehicle.shape.front
        room = plan_length(lane) - nose - 2.0
        for other in vehicles:
            if other.point.lane == lane.name and other.point.station > vehicle.point.station:
                tail = other.point.station - 0.5 * other.shape.wheelbase - other.shape.rear
                room = min(room, tail - nose - 2.0)
        allowed = float(limit[lane.name][min(int(nose / PATH_STEP), len(limit[lane.name]) - 1)])
        out.append(min(allowed, float(np.sqrt(2 * braking * max(room, 0.0)))))
    return out
