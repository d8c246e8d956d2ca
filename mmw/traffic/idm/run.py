"""From a town's lanes to the 6-DoF poses of all its vehicles."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mmw.config import TrafficConfig
from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.traffic.ground_height import Ground
from mmw.traffic.idm.driver import STEP
from mmw.traffic.idm.engine import Engine
from mmw.traffic.idm.fleet import Fleet
from mmw.traffic.idm.lane_change import LaneChanges
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.signals import make_plans
from mmw.traffic.smoothing import gaussian_smooth
from mmw.traffic.spawn import connected_ranks, nearest_points, seeded, spawn_points
from mmw.traffic.vehicle_pose import make_shape, sample_poses

SETTLE_S = 1.5
"""Simulated before the warm-up and after the last frame, as support of the filters in time [s]."""

STATION_SIGMA = 0.12
"""Gaussian on the station over time, standard deviation [s]."""


@dataclass(frozen=True)
class VehicleTrack:
    """One vehicle of a scenario and where it is at every frame."""

    name: str
    role: str
    """`cav`, `vehicle` or `pedestrian`."""
    model: str
    paint: str
    poses: np.ndarray
    """Body to world (x, y, z, qx, qy, qz, qw) at 100 Hz, shape [F, 7], float64; the body's origin is the ground point
    midway between the axles."""
    waits: np.ndarray | None = None
    """Whether it stands with a cause (`mmw.traffic.idm.wait_causes`), shape [F]; None where the engine does not say
    so."""


@dataclass(frozen=True)
class TrafficResult:
    """The motion of a scenario's vehicles, and what lies behind it."""

    tracks: list[VehicleTrack]
    changes: list[tuple[float, str, str, str]]
    """Changes of lanes: time of the decision since frame 0 [s], vehicle, lane before, lane after."""
    routes: dict[str, tuple[str, ...]]
    """Vehicle -> lanes of its path, those beyond the last frame included."""


def run_traffic(
    graph: LaneGraph,
    drivable: tuple[np.ndarray, np.ndarray],
    catalog: Mapping[str, Any],
    traffic: TrafficConfig,
    *,
    frame_count: int,
    seed: int,
    device: str = "cpu",
) -> TrafficResult:
    """Return the motion of all vehicles of a scenario, and what they decided.

    Args:
        graph: The town's lanes.
        drivable: Vertices [m], shape [N, 3], and triangles, shape [M, 3], of what wheels may stand on.
        catalog: Vehicle models by name, each with `name, paints, wheelbase, track, length, width, height, center`.
        traffic: How many vehicles, where, which are CAVs, warm-up, changes of lanes, traffic lights.
        frame_count: F, frames at 100 Hz.
        seed: Same seed, same motion.
        device: Warp device of the wheel drops.

    Returns:
        Tracks `cav_1`, `cav_2`... in the order of `connected_ranks`, then `veh_001`, `veh_002`... by distance;
        changes of lanes and routes.

    Raises:
        InputError: If the town has too few places, no model can drive from a place without leaving the road, or lights
            are asked for where there are none.
    """
    cav_ranks, vehicle_count = connected_ranks(traffic, seed), traffic.vehicle_count
    plans = make_plans(graph, seed) if traffic.signals else {}
    if traffic.signals and not plans:
        raise InputError(
            "signals = true: no junction of the town has traffic lights; lanes with a phase (`mmw:lane:signal`) are "
            "needed; name junctions in the town's props.signalled, or set signals: false"
        )
    before = SETTLE_S + traffic.warmup_s
    duration = before + SETTLE_S + frame_count / FRAME_RATE_HZ
    shapes = [make_shape(catalog[name]) for name in sorted(catalog)]
    fleet = Fleet(graph, Ground(*drivable, device=device), shapes, duration, seed)
    points = nearest_points(spawn_points(graph, fleet.alive), traffic.spawn_center_m, vehicle_count)
    cars, paints = [], []
    for rank, point in enumerate(points):
        generator = seeded(seed, rank, 0)
        cars.append(fleet.add(point, rank, rank in cav_ranks, generator))
        choices = tuple(catalog[cars[-1].shape.name].paints)
        paints.append(choices[int(generator.integers(len(choices)))])
    lead = round(before / STEP)
    steps = lead + int(np.ceil((frame_count / FRAME_RATE_HZ + SETTLE_S) / STEP))
    changes = LaneChanges(graph, fleet.beside, fleet.change) if traffic.lane_changes else None
    station, speed, waits = Engine(graph, cars, changes, plans, -before).run(steps)
    smooth = _resample(station, speed)
    per_step = round(STEP * FRAME_RATE_HZ)
    frames = slice(lead * per_step, lead * per_step + frame_count)
    order = [*cav_ranks, *(rank for rank in range(vehicle_count) if rank not in set(cav_ranks))]
    tracks, names = [], {}
    for position, rank in enumerate(order):
        is_cav = position < len(cav_ranks)
        name = f"cav_{position + 1}" if is_cav else f"veh_{position - len(cav_ranks) + 1:03d}"
        poses = sample_poses(cars[rank].plan.stance, smooth[:, rank])[frames]
        role = "cav" if is_cav else "vehicle"
        cause = np.repeat(waits[:, rank], per_step)[frames]
        tracks.append(VehicleTrack(name, role, cars[rank].shape.name, paints[rank], poses, cause))
        names[rank] = name
    done = [] if changes is None else changes.done
    return TrafficResult(
        tracks,
        [(time - before, names[rank], lane, other) for time, rank, lane, other in done],
        {names[rank]: cars[rank].line.lanes for rank in order},
    )


def _resample(station: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Return smooth stations at 100 Hz from engine steps: cubic Hermite, exact for constant jerk, then a Gaussian."""
    count = round(STEP * FRAME_RATE_HZ)
    t = (np.arange(count) / count)[None, :, None]
    s0, s1 = station[:-1, None], station[1:, None]
    v0, v1 = STEP * speed[:-1, None], STEP * speed[1:, None]
    fine = s0 + t * v0 + t**2 * (3 * (s1 - s0) - 2 * v0 - v1) + t**3 * (2 * (s0 - s1) + v0 + v1)
    fine = np.concatenate([fine.reshape(-1, station.shape[1]), station[-1:]])
    return gaussian_smooth(fine, STATION_SIGMA * FRAME_RATE_HZ)
