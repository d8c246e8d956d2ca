"""From a town's lanes to the 6-DoF poses of all its vehicles."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mmw.constants import FRAME_RATE_HZ
from mmw.town.lanes import Lane, LaneGraph
from mmw.traffic.idm import STEP, Car, Engine, find_passages
from mmw.traffic.pose import MAX_STEER, Shape, Stance, Track, follow_line, make_shape, sample_poses, stand_on_ground
from mmw.traffic.route import choose_lanes, join_lanes, living_lanes, plan_length
from mmw.traffic.smooth import gaussian_smooth
from mmw.traffic.spawn import Places, SpawnPoint, draw_models, nearest_points, spawn_points
from mmw.traffic.speed import speed_limit
from mmw.traffic.wheels import Ground

SETTLE_S = 1.5
"""Simulated before the warm-up and after the last frame, as support of the filters in time [s]."""

STATION_SIGMA = 0.12
"""Gaussian on the station over time, standard deviation [s]."""

DRIVER_FACTOR = (0.85, 1.0)
"""Range of the drivers' share of the speed limit."""

DRIVER_HEADWAY = (1.0, 1.5)
"""Range of the drivers' time gap [s]."""

RUN_OUT = 80.0
"""Routes go on this far beyond what the fastest vehicle can cover, so that nobody brakes for their end [m]."""


@dataclass(frozen=True)
class VehicleTrack:
    """One vehicle of a scenario and where it is at every frame."""

    name: str
    role: str
    """`cav` or `vehicle`."""
    model: str
    paint: str
    poses: np.ndarray
    """Body to world (x, y, z, qx, qy, qz, qw) at 100 Hz, shape [F, 7], float64; the body's origin is the ground point
    midway between the axles."""


def simulate(
    graph: LaneGraph,
    drivable: tuple[np.ndarray, np.ndarray],
    catalog: Mapping[str, Any],
    *,
    frame_count: int,
    vehicle_count: int,
    spawn_center: Sequence[float],
    cav_ranks: Sequence[int],
    warmup_s: float,
    seed: int,
    device: str = "cpu",
) -> list[VehicleTrack]:
    """Return the motion of all vehicles of a scenario.

    Args:
        graph: The town's lanes.
        drivable: Vertices [m], shape [N, 3], and triangles, shape [M, 3], of what wheels may stand on.
        catalog: Vehicle models by name, each with `name, paints, wheelbase, track, length, width, height, center`.
        frame_count: F, frames at 100 Hz.
        vehicle_count: V, vehicles in all; they take the spawn points nearest to `spawn_center`.
        spawn_center: Middle of the traffic, world frame [m].
        cav_ranks: Zero-based ranks by distance to `spawn_center` of the vehicles that are CAVs.
        warmup_s: Simulated before frame 0 [s].
        seed: Same seed, same motion.
        device: Warp device of the wheel drops.

    Returns:
        `cav_1`, `cav_2`... in the order of `cav_ranks`, then `veh_001`, `veh_002`... by distance.

    Raises:
        ValueError: If a rank does not exist, the town has too few places, or no model can drive from a place without
            leaving the road.
    """
    if len(set(cav_ranks)) != len(cav_ranks) or any(not 0 <= rank < vehicle_count for rank in cav_ranks):
        raise ValueError(
            f"cav_ranks = {list(cav_ranks)}: ranks must differ and lie in 0..{vehicle_count - 1}; correct them"
        )
    duration = 2 * SETTLE_S + warmup_s + frame_count / FRAME_RATE_HZ
    fleet = _Fleet(graph, Ground(*drivable, device=device), [make_shape(catalog[n]) for n in sorted(catalog)], duration)
    points = nearest_points(spawn_points(graph, fleet.alive), spawn_center, vehicle_count)
    cars, paints = [], []
    for rank, point in enumerate(points):
        generator = _generator(seed, rank, 0)
        cars.append(fleet.add(point, rank in cav_ranks, generator, (seed, rank, 1)))
        choices = tuple(catalog[cars[-1].shape.name].paints)
        paints.append(choices[int(generator.integers(len(choices)))])
    lead = round((SETTLE_S + warmup_s) / STEP)
    steps = lead + int(np.ceil((frame_count / FRAME_RATE_HZ + SETTLE_S) / STEP))
    station, speed = Engine(graph, cars).run(steps)
    smooth = _resample(station, speed)
    first = lead * round(STEP * FRAME_RATE_HZ)
    order = [*cav_ranks, *(rank for rank in range(vehicle_count) if rank not in set(cav_ranks))]
    tracks = []
    for position, rank in enumerate(order):
        is_cav = position < len(cav_ranks)
        name = f"cav_{position + 1}" if is_cav else f"veh_{position - len(cav_ranks) + 1:03d}"
        poses = sample_poses(cars[rank].stance, smooth[:, rank])[first : first + frame_count]
        role = "cav" if is_cav else "vehicle"
        tracks.append(VehicleTrack(name, role, cars[rank].shape.name, paints[rank], poses))
    return tracks


def _generator(*key: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(key)))


def _resample(station: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Return smooth stations at 100 Hz from engine steps: cubic Hermite, exact for constant jerk, then a Gaussian."""
    count = round(STEP * FRAME_RATE_HZ)
    t = (np.arange(count) / count)[None, :, None]
    s0, s1 = station[:-1, None], station[1:, None]
    v0, v1 = STEP * speed[:-1, None], STEP * speed[1:, None]
    fine = s0 + t * v0 + t**2 * (3 * (s1 - s0) - 2 * v0 - v1) + t**3 * (2 * (s0 - s1) + v0 + v1)
    fine = np.concatenate([fine.reshape(-1, station.shape[1]), station[-1:]])
    return gaussian_smooth(fine, STATION_SIGMA * FRAME_RATE_HZ)


class _Fleet:
    """Puts vehicles on the road, each with a route that its body can drive."""

    def __init__(self, graph: LaneGraph, ground: Ground, shapes: list[Shape], duration: float) -> None:
        self.graph = graph
        self.ground = ground
        self.shapes = shapes
        self.duration = duration
        alive = living_lanes(graph)
        self.has_circuit = bool(alive)
        self.alive = alive or frozenset(graph.lanes)
        self.places = Places(graph)
        self.closed: set[tuple[str, str]] = set()
        """(model, lane) pairs that the model cannot drive without leaving the road."""

    def add(self, point: SpawnPoint, is_cav: bool, generator: np.random.Generator, key: tuple[int, ...]) -> Car:
        """Place a vehicle; `generator` draws the driver and the model, `key` seeds the route."""
        factor, headway = generator.uniform(*DRIVER_FACTOR), generator.uniform(*DRIVER_HEADWAY)
        reason = "no model has room between its neighbours"
        for shape in draw_models(self.shapes, is_cav, generator):
            if not self.places.fits(point, shape):
                continue
            stance, why = self._find_route(point, shape, key)
            if stance is not None:
                self.places.take(point, shape)
                line = stance.track.line
                limit = speed_limit(stance, self.graph, factor).tolist()
                start = point.station + 0.5 * shape.wheelbase
                return Car(stance, limit, start, headway, find_passages(line, self.graph, shape))
            reason = why
        x, y, z = point.position
        raise ValueError(
            f"spawn point on lane {point.lane!r} at ({x:.1f}, {y:.1f}, {z:.1f}) m: {reason}; every vehicle needs a way "
            "that keeps its wheels on the road; widen the road there, or add a shorter vehicle model"
        )

    def _find_route(self, point: SpawnPoint, shape: Shape, key: tuple[int, ...]) -> tuple[Stance | None, str]:
        """Return a stance along a route that the model can drive, or None and what stood in the way.

        A route is driven from end to end before it is accepted. The connection that fails is closed for the model.
        """
        fastest = max(lane.speed for lane in self.graph.lanes.values())
        need = fastest * self.duration + RUN_OUT
        why = "no way on"

        def is_open(name: str) -> bool:
            return name in self.alive and (shape.name, name) not in self.closed

        while is_open(point.lane):
            names = choose_lanes(self.graph, point.lane, need, _generator(*key), is_open)
            lanes = [self.graph.lanes[name] for name in names]
            if sum(plan_length(lane) for lane in lanes[1:]) < need and self.has_circuit:
                self.closed.add((shape.name, names[-1]))
                continue
            track = follow_line(join_lanes(lanes), shape)
            start = point.station + 0.5 * shape.wheelbase
            steep = np.flatnonzero((np.abs(track.steer) > MAX_STEER) & (track.line.station >= start))
            if len(steep):
                lost, what = float(track.line.station[steep[0]]), "the bend is too tight"
            else:
                stance, lost, what = stand_on_ground(track, self.ground, start)
                if stance is not None:
                    return stance, ""
            self.closed.add((shape.name, names[_culprit(lanes, track, lost)]))
            row = int(np.searchsorted(track.line.station, lost))
            why = f"{what} for model {shape.name!r} near ({track.front[row, 0]:.1f}, {track.front[row, 1]:.1f}) m"
        return None, why


def _culprit(lanes: list[Lane], track: Track, lost: float) -> int:
    """Return the index of the lane to blame for what happens at a station: the junction just before, or the lane."""
    ends = track.line.ends
    index = min(int(np.searchsorted(ends, lost, side="right")), len(ends) - 1)
    reach = lost - track.shape.behind - 6.0
    for back in range(index, -1, -1):
        if lanes[back].junction:
            return back
        if back and ends[back - 1] < reach:
            break
    return index
