"""Vehicles for SUMO: models and routes that their bodies can drive, and how fast bends let them go."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mmw.traffic.demand import TrafficDemand
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.traffic.route import PATH_STEP, choose_lanes, endless_lanes, join_lanes
from mmw.traffic.smoothing import gaussian_smooth
from mmw.traffic.spawn import Places, Start, seeded
from mmw.traffic.speed_profile import CURVE_BRAKING, LOWEST_SPEED, brake_ahead, comfort_speed
from mmw.traffic.vehicle_pose import GROUND_SIGMA, MAX_STEER, PATH_SIGMA, Shape, follow_line, place_on_ground

LEAD_IN = 25.0
"""A lane across a junction is tried out from this far before it to this far behind it [m]."""

REACH = 12.0
"""Neighboring lanes count for the bend of a lane up to this far [m]."""


@dataclass(frozen=True)
class SumoVehicle:
    """A vehicle before SUMO runs."""

    start: Start
    shape: Shape
    lanes: tuple[str, ...]
    """Lanes in driving order, those across junctions included."""

    @property
    def bumpers(self) -> tuple[float, float]:
        """Stations of the rear and the front bumper on the first lane [m]."""
        return self.start.point.bumpers(self.shape)


class RoutePlanner:
    """Draws vehicles that can drive their routes."""

    def __init__(self, demand: TrafficDemand, length: float) -> None:
        """Start with an empty town; every route covers at least a plan length [m]."""
        self.demand, self.graph, self.length = demand, demand.town.lanes, length
        self.endless = endless_lanes(self.graph) or frozenset(self.graph.lanes)
        self.places = Places(self.graph)

    def add(self, start: Start) -> SumoVehicle:
        """Return a vehicle with a model and a route.

        Raises:
            BlockedPointError: If no model has room there, or a route that it can drive.
        """

        def find_route(shape: Shape) -> tuple[list[str] | None, str]:
            generator = seeded(self.demand.seed, start.rank, 1)
            lanes = choose_lanes(self.graph, start.point.lane, self.length, generator, partial(self._is_open, shape))
            is_long = sum(self.graph.lanes[name].plan_length for name in lanes[1:]) >= self.length
            return (lanes if is_long else None), f"model {shape.name!r} has no route on"

        shape, lanes = self.places.add(start, self.demand.shapes, find_route)
        return SumoVehicle(start, shape, tuple(lanes))

    def _is_open(self, shape: Shape, name: str) -> bool:
        """Return whether a body can drive a lane and leave it again with its wheels on the road."""
        if name not in self.endless:
            return False
        lane = self.graph.lanes[name]
        if not lane.junction:
            return any(self._fits_on(after, shape) for after in lane.successors)
        exits = [exit_ for after in lane.successors for exit_ in self.graph.lanes[after].successors]
        return self._fits_on(name, shape) and any(self._fits_on(exit_, shape) for exit_ in exits)

    def _fits_on(self, name: str, shape: Shape) -> bool:
        """Return whether a body's wheels stay on the road on a lane, which is tried out where it crosses a junction."""
        key = (name, shape.name)
        if key not in self.demand.tried:  # the same for every episode of a live simulation
            lane = self.graph.lanes[name]
            self.demand.tried[key] = not lane.junction or self._can_drive(lane, shape)
        return self.demand.tried[key]

    def _can_drive(self, lane: Lane, shape: Shape) -> bool:
        before = self.graph.predecessors[lane.name]
        lanes = [_piece(self.graph.lanes[before[0]], -(LEAD_IN + shape.length)), lane] if before else [lane]
        behind = lanes[0].plan_length if before else 0.0
        end = behind + lane.plan_length
        covered, onward = 0.0, lane
        while onward.successors and covered < LEAD_IN:
            onward = self.graph.lanes[onward.successors[0]]
            lanes.append(_piece(onward, LEAD_IN - covered))
            covered += lanes[-1].plan_length
        track = follow_line(join_lanes(lanes), shape)
        inside = (track.line.station > behind - 1.0) & (track.line.station < end + LEAD_IN)
        if (np.abs(track.steer[inside]) > MAX_STEER).any():
            return False
        stance, _, _ = place_on_ground(track, self.demand.ground, min(behind, LEAD_IN))
        return stance is not None


def _piece(lane: Lane, length: float) -> Lane:
    """Return the first points of a lane up to a length [m], or the last ones if it is negative; at least two."""
    along = lane.plan_station
    if length < 0.0:
        return replace(lane, points=lane.points[min(int(np.searchsorted(along, along[-1] + length)), len(along) - 2) :])
    return replace(lane, points=lane.points[: max(int(np.searchsorted(along, length)) + 1, 2)])


def lane_limits(graph: LaneGraph) -> dict[str, np.ndarray]:
    """Return the speed that comfort allows along every lane, every `PATH_STEP` of plan length [m/s].

    The rules are those of `speed_limit` on the center line: sideways and vertical acceleration and jerk, and braking
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
        speed = comfort_speed(body)[inside]
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
    return brake_ahead(speed, 2 * CURVE_BRAKING * PATH_STEP * np.arange(len(speed)))


def entry_speeds(
    vehicles: Sequence[SumoVehicle], graph: LaneGraph, limit: Mapping[str, np.ndarray], braking: float
) -> list[float]:
    """Return speeds at the start from which every vehicle can stop at the end of its lane and behind its leader."""
    out = []
    for vehicle in vehicles:
        lane, (_, front) = graph.lanes[vehicle.start.point.lane], vehicle.bumpers
        room = lane.plan_length - front - 2.0
        for other in vehicles:
            point = other.start.point
            if point.lane == lane.name and point.station > vehicle.start.point.station:
                room = min(room, other.bumpers[0] - front - 2.0)
        allowed = float(limit[lane.name][min(int(front / PATH_STEP), len(limit[lane.name]) - 1)])
        out.append(min(allowed, float(np.sqrt(2 * braking * max(room, 0.0)))))
    return out
