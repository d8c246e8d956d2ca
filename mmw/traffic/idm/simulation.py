"""Run the IDM engine: from a demand to the 6-DoF poses of all its vehicles."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.traffic.demand import TrafficDemand, TrafficResult, VehicleTrack
from mmw.traffic.idm.driver import STEP
from mmw.traffic.idm.engine import IdmEngine
from mmw.traffic.idm.fleet import Fleet
from mmw.traffic.idm.lane_change import LaneChanges
from mmw.traffic.idm.vehicle import Car
from mmw.traffic.idm.wait_causes import find_causes
from mmw.traffic.signals import make_plans
from mmw.traffic.smoothing import gaussian_smooth
from mmw.traffic.spawn import SETTLE_S, Placed, name_vehicle, place_starts, vehicle_order
from mmw.traffic.vehicle_pose import sample_poses

Engine = TypeVar("Engine", bound=IdmEngine)

STATION_SIGMA = 0.12
"""Gaussian on the station over time, standard deviation [s]."""


def start_idm(demand: TrafficDemand) -> IdmEngine:
    """Return the vehicles of a scenario at their starts; see `start_fleet`."""
    return start_fleet(demand)[0]


def start_fleet(demand: TrafficDemand, engine_type: Callable[..., Engine] = IdmEngine) -> tuple[Engine, Placed[Car]]:
    """Return the vehicles of a scenario at their starts, `SETTLE_S` and the warm-up before frame 0, and who they are.

    Args:
        demand: The scenario.
        engine_type: Engine that moves them, with the arguments of `IdmEngine`.

    Raises:
        InputError: If the town has too few places, no model can drive from any of them without leaving the road, or
            `signals` is true in a town without lights.
    """
    traffic, graph = demand.traffic, demand.town.lanes
    plans = make_plans(graph, demand.seed) if traffic.signals else {}
    if traffic.signals and not plans:
        raise InputError(
            "signals = true: no junction of the town has traffic lights; lanes with a phase (`mmw:lane:signal`) are "
            "needed; name junctions in the town's props.signalled, or set signals: false"
        )
    before = SETTLE_S + traffic.warmup_s
    fleet = Fleet(demand, before + SETTLE_S + demand.frame_count / FRAME_RATE_HZ)
    placed = place_starts(demand, fleet.endless, fleet.add)
    changes = LaneChanges(graph, fleet.adjacent, fleet.change) if traffic.lane_changes else None
    return engine_type(graph, placed.vehicles, changes, plans, -before), placed


def simulate_idm(demand: TrafficDemand) -> TrafficResult:
    """Return the motion of all vehicles of a scenario, changes of lanes and routes; errors as of `start_fleet`."""
    engine, placed = start_fleet(demand)
    cav_ranks = placed.cav_ranks
    lead = round(-engine.start / STEP)
    steps = lead + int(np.ceil((demand.frame_count / FRAME_RATE_HZ + SETTLE_S) / STEP))
    station, speed, waits = record_steps(engine, steps)
    smooth = _resample(station, speed)
    per_step = round(STEP * FRAME_RATE_HZ)
    frames = slice(lead * per_step, lead * per_step + demand.frame_count)
    tracks, names = [], {}
    for position, rank in enumerate(vehicle_order(cav_ranks, len(engine.cars))):
        car = engine.cars[rank]
        names[rank], role = name_vehicle(position, len(cav_ranks))
        poses = sample_poses(car.plan.stance, smooth[:, rank])[frames]
        cause = np.repeat(waits[:, rank], per_step)[frames]
        tracks.append(VehicleTrack(names[rank], role, car.shape.name, car.paint, poses, cause))
    done = [] if engine.changes is None else engine.changes.done
    return TrafficResult(
        tracks,
        [(time + engine.start, names[rank], lane, other) for time, rank, lane, other in done],
        {name: engine.cars[rank].line.lanes for rank, name in names.items()},
        placed.notes,
    )


def record_steps(engine: IdmEngine, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Advance an engine.

    Returns:
        Stations [m], speeds [m/s] and whether a vehicle stands with a cause, at every step, start included, each of
        shape [steps + 1, V].
    """
    station = [[car.station for car in engine.cars]]
    speed = [[car.speed for car in engine.cars]]
    waits = [[False] * len(engine.cars)]
    for _ in range(steps):
        engine.step()
        station.append([car.station for car in engine.cars])
        speed.append([car.speed for car in engine.cars])
        waits.append(find_causes(speed[-1], engine.blockers, engine.at_red))
    return np.array(station), np.array(speed), np.array(waits)


def _resample(station: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Return smooth stations at 100 Hz from engine steps: cubic Hermite, exact for constant jerk, then a Gaussian."""
    count = round(STEP * FRAME_RATE_HZ)
    t = (np.arange(count) / count)[None, :, None]
    s0, s1 = station[:-1, None], station[1:, None]
    v0, v1 = STEP * speed[:-1, None], STEP * speed[1:, None]
    fine = s0 + t * v0 + t**2 * (3 * (s1 - s0) - 2 * v0 - v1) + t**3 * (2 * (s0 - s1) + v0 + v1)
    fine = np.concatenate([fine.reshape(-1, station.shape[1]), station[-1:]])
    return gaussian_smooth(fine, STATION_SIGMA * FRAME_RATE_HZ)
