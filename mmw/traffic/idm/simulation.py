"""Run the IDM engine: from a demand to the 6-DoF poses of all its vehicles."""

from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np

from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.traffic.demand import TrafficDemand, TrafficResult, VehicleTrack
from mmw.traffic.idm.driver import STEP
from mmw.traffic.idm.engine import IdmEngine
from mmw.traffic.idm.fleet import Fleet
from mmw.traffic.idm.lane_change import LaneChanges
from mmw.traffic.idm.open_ends import Arrivals
from mmw.traffic.idm.vehicle import Car
from mmw.traffic.idm.wait_causes import STANDING, find_causes
from mmw.traffic.signals import make_plans
from mmw.traffic.smoothing import gaussian_smooth
from mmw.traffic.spawn import SETTLE_S, Placed, name_vehicle, place_starts, vehicle_order
from mmw.traffic.vehicle_pose import sample_poses

Engine = TypeVar("Engine", bound=IdmEngine)

STATION_SIGMA = 0.12
"""Gaussian on the station over time, standard deviation [s]."""

MIN_PRESENCE = 10
"""A vehicle that is there in fewer frames at 100 Hz is left out, in shorter scenarios one that misses a
frame; design value, a tenth of a second."""

BEYOND = 0.5
"""Poses are sampled up to this far from the ends of a line [m], which goes on beyond the road."""

AT_END = 2.0
"""A vehicle whose bumper is nearer to the end of its route has arrived [m]; design value."""


def start_fleet(
    demand: TrafficDemand, engine_type: Callable[..., Engine] = IdmEngine, *, may_leave: bool = True
) -> tuple[Engine, Placed[Car]]:
    """Return the vehicles of a scenario at their starts, `SETTLE_S` and the warm-up before frame 0, and who they are.

    Args:
        demand: The scenario.
        engine_type: Engine that moves them, with the arguments of `IdmEngine`.
        may_leave: Whether vehicles leave and enter at open ends of the network; else they stop there.

    Raises:
        InputError: If the town has too few places, no model can drive from any of them without leaving the road, or
            `signals` is true in a town without lights.
    """
    if demand.fleet is None and demand.seed != demand.seed_of_scene:
        demand = demand.with_seed(demand.seed, draw_fleet(demand, may_leave=may_leave))
    traffic, graph = demand.traffic, demand.town.lanes
    plans = make_plans(graph, demand.seed) if traffic.signals else {}
    if traffic.signals and not plans:
        raise InputError(
            "signals = true: no junction of the town has traffic lights; lanes with a phase (`mmw:lane:signal`) are "
            "needed; name junctions in the town's props.signalled, or set signals: false"
        )
    before = SETTLE_S + traffic.warmup_s
    fleet, placed = _place(demand, may_leave)
    changes = LaneChanges(graph, fleet.adjacent, fleet.change) if traffic.lane_changes else None
    arrivals = None
    if fleet.network.exits and may_leave:
        arrivals = Arrivals(fleet.network, len(placed.vehicles), demand.seed, fleet.enter)
    return engine_type(graph, placed.vehicles, changes, plans, -before, arrivals), placed


def _place(demand: TrafficDemand, may_leave: bool) -> tuple[Fleet, Placed[Car]]:
    duration = 2 * SETTLE_S + demand.traffic.warmup_s + demand.frame_count / FRAME_RATE_HZ
    fleet = Fleet(demand, duration, may_leave=may_leave)
    suits_cav = fleet.suits_cav if fleet.network.exits else None
    return fleet, place_starts(demand, fleet.usable, fleet.add, suits_cav)


def draw_fleet(demand: TrafficDemand, *, may_leave: bool = True) -> tuple[tuple[str, str], ...]:
    """Return model and paint of `cav_1`, `cav_2`..., `veh_001`... as the seed of the scene draws them.

    Raises:
        InputError: As of `start_fleet`.
    """
    placed = _place(demand.with_seed(demand.seed_of_scene), may_leave)[1]
    order = vehicle_order(placed.cav_ranks, len(placed.vehicles))
    return tuple((placed.vehicles[rank].shape.name, placed.vehicles[rank].paint) for rank in order)


def simulate_idm(demand: TrafficDemand) -> TrafficResult:
    """Return the motion of all vehicles of a scenario, changes of lanes and routes; errors as of `start_fleet`.

    Vehicles that enter or leave at open ends of the network are absent before or after; those that are in no frame are
    left out.
    """
    engine, placed = start_fleet(demand)
    cav_ranks = placed.cav_ranks
    lead = round(-engine.start / STEP)
    steps = lead + int(np.ceil((demand.frame_count / FRAME_RATE_HZ + SETTLE_S) / STEP))
    station, speed, waits = record_steps(engine, steps)
    smooth = _resample(station, speed)
    per_step = round(STEP * FRAME_RATE_HZ)
    first = lead * per_step
    tracks, names = [], {}
    for rank in vehicle_order(cav_ranks, len(engine.cars)):
        car = engine.cars[rank]
        poses = _poses(car, smooth[:, rank], first, demand.frame_count, per_step)
        if poses is None:
            continue
        names[rank], role = name_vehicle(len(tracks), len(cav_ranks))
        cause = np.repeat(waits[:, rank], per_step)[first : first + demand.frame_count]
        tracks.append(VehicleTrack(names[rank], role, car.shape.name, car.paint, poses, cause))
    done = [] if engine.changes is None else engine.changes.done
    return TrafficResult(
        tracks,
        [(time + engine.start, names[rank], lane, other) for time, rank, lane, other in done if rank in names],
        {name: engine.cars[rank].line.lanes for rank, name in names.items()},
        [*placed.notes, *_end_notes(engine, names, speed[: lead + demand.frame_count // per_step])],
    )


def _poses(car: Car, station: np.ndarray, first: int, count: int, per_step: int) -> np.ndarray | None:
    """Return the poses of a vehicle in all frames, NaN where it is absent, shape [count, 7]; None if it never is there.

    Args:
        car: The vehicle.
        station: Its smooth stations at 100 Hz, from the engine's start [m].
        first: Row of frame 0.
        count: Frames.
        per_step: Rows a step of the engine.
    """
    start = max(first, car.entered_at * per_step)
    stop = first + count
    if car.left_at is not None:
        on_road = station[:stop] + car.shape.front <= car.ends[-1]
        stop = min(stop, car.left_at * per_step, int(np.argmin(np.append(on_road, False))))
    if stop - start < min(MIN_PRESENCE, count):
        return None
    line = car.line.station  # before it enters and after it has left, a vehicle may be beyond both ends of its line
    low, high = np.searchsorted(station, [line[0] + BEYOND, line[-1] - BEYOND])
    sampled = np.full((len(station), 7), np.nan)
    sampled[low:high] = sample_poses(car.plan.stance, station[low:high])
    poses = np.full((count, 7), np.nan)
    poses[start - first : stop - first] = sampled[start:stop]
    return poses


def _end_notes(engine: IdmEngine, names: Mapping[int, str], speed: np.ndarray) -> list[str]:
    """Return a note on CAVs that stand at the end of the network in the last frame; `speed` goes up to it."""
    stand = [
        names[rank]
        for rank, car in enumerate(engine.cars)
        if rank in names and car.is_cav and speed[-1, rank] < STANDING and car.ends[-1] - car.front < AT_END
    ]
    ended = [name for name in stand if engine.arrivals is not None]
    if not ended:
        return []
    return [f"{', '.join(ended)}: at an end of the roads, where CAVs wait; give fewer frames, or a larger map"]


def record_steps(engine: IdmEngine, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Advance an engine.

    Returns:
        Stations [m], speeds [m/s] and whether a vehicle stands with a cause, at every step, start included, each of
        shape [steps + 1, V]. Vehicles that enter are taken as coming with the speed of their first step.
    """
    station = [[car.station for car in engine.cars]]
    speed = [[car.speed for car in engine.cars]]
    waits = [[False] * len(engine.cars)]
    for _ in range(steps):
        engine.step()
        station.append([car.station for car in engine.cars])
        speed.append([car.speed for car in engine.cars])
        waits.append(find_causes(speed[-1], engine.blockers, engine.at_red))
    for rank in range(len(station[0]), len(engine.cars)):
        at = engine.cars[rank].entered_at
        for step in range(at):
            station[step].append(station[at][rank] - (at - step) * STEP * speed[at][rank])
            speed[step].append(speed[at][rank])
            waits[step].append(False)
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
