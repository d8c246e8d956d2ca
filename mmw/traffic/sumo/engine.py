"""Engine `sumo`: the town's lanes as a SUMO network, vehicles that SUMO drives, and their bodies on our road."""

import json
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from mmw.config import TrafficConfig
from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError, MissingPackageError
from mmw.core.extras import install
from mmw.traffic.ground_height import Ground
from mmw.traffic.idm.driver import ACCELERATION, BRAKING, HARDEST_BRAKING, STANDSTILL_GAP, STEP
from mmw.traffic.idm.fleet import DRIVER_FACTOR, DRIVER_HEADWAY, RUN_OUT
from mmw.traffic.idm.run import SETTLE_S, VehicleTrack
from mmw.traffic.replay.engine import place_vehicles
from mmw.traffic.replay.trajectory_table import Trajectory
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.route import PATH_STEP
from mmw.traffic.spawn import connected_ranks, nearest_points, seeded, spawn_points
from mmw.traffic.sumo import worker as sumo_worker
from mmw.traffic.sumo.network import SumoNetwork, make_network
from mmw.traffic.sumo.routes import Drivers, SumoVehicle, entry_speeds, lane_limits
from mmw.traffic.vehicle_pose import make_shape

IMPATIENCE = 0.5
"""Share to which drivers who give way count on the others' braking [-]; with 0 they also wait for vehicles far away
that wait themselves."""

CHANGE_S = 4.0
"""A lane change takes this long [s]."""

COMFORT = 2.4
"""Lines are made rounder for this acceleration [m/s^2]: SUMO begins and ends a change of lanes with a kink."""

OPTIONS: Mapping[str, str] = {
    "step-method.ballistic": "true",
    "time-to-teleport": "-1",
    "collision.action": "none",
    "no-step-log": "true",
    "no-warnings": "true",
    "duration-log.disable": "true",
    "threads": "1",
}
"""SUMO's command line, but for files, seed, step and what lane changes need."""


def simulate_sumo(
    graph: LaneGraph,
    drivable: tuple[np.ndarray, np.ndarray],
    catalog: Mapping[str, Any],
    traffic: TrafficConfig,
    *,
    frame_count: int,
    seed: int,
    device: str = "cpu",
) -> list[VehicleTrack]:
    """Return the motion of all vehicles of a scenario, as `run_traffic` does, driven by SUMO.

    Args:
        graph: The town's lanes.
        drivable: Vertices [m], shape [N, 3], and triangles, shape [M, 3], of what wheels may stand on.
        catalog: Vehicle models by name.
        traffic: How many vehicles, where, which are CAVs, warm-up, changes of lanes.
        frame_count: F, frames at 100 Hz.
        seed: Same seed, same motion.
        device: Warp device of the wheel drops.

    Returns:
        `cav_1`, `cav_2`... in the order of `connected_ranks`, then `veh_001`, `veh_002`... by distance.

    Raises:
        InputError: If SUMO is not installed or fails, there is no room for the vehicles, or a vehicle that SUMO moved
            cannot stand on the road.
    """
    check_sumo()
    cav_ranks, vehicle_count, warmup_s = connected_ranks(traffic, seed), traffic.vehicle_count, traffic.warmup_s
    duration = 2 * SETTLE_S + warmup_s + frame_count / FRAME_RATE_HZ
    fastest = max(lane.speed for lane in graph.lanes.values())
    shapes = [make_shape(catalog[name]) for name in sorted(catalog)]
    drivers = Drivers(graph, Ground(*drivable, device=device), shapes, fastest * duration + RUN_OUT)
    points = nearest_points(spawn_points(graph, drivers.alive), traffic.spawn_center_m, vehicle_count)
    vehicles, headways, factors = [], [], []
    for rank, point in enumerate(points):
        generator = seeded(seed, rank, 0)
        factors.append(generator.uniform(*DRIVER_FACTOR))
        headways.append(generator.uniform(*DRIVER_HEADWAY))
        vehicles.append(drivers.add(point, rank in cav_ranks, generator, (seed, rank, 1)))
    limits = lane_limits(graph)
    network = make_network(graph, {name: _lane_speed(graph, name, limits[name]) for name in graph.lanes})
    names = [str(rank) for rank in range(vehicle_count)]
    with tempfile.TemporaryDirectory(prefix="mmw-sumo-") as folder:
        place = Path(folder)
        network.write(place / "town.net.xml")
        starts = entry_speeds(vehicles, graph, limits, 0.6 * BRAKING)
        _write_routes(place / "town.rou.xml", network, vehicles, starts, factors, headways, traffic.lane_changes)
        job = {
            "options": _options(place, seed, traffic.lane_changes),
            "vehicles": names,
            "steps": int(np.ceil(duration / STEP)),
            "limits": {
                lane: limits[ours][:: round(sumo_worker.HINT_STEP / PATH_STEP)].tolist()
                for lane, ours in network.internal.items()
            },
            "top_speed": fastest,
        }
        states = _run(place, job)
    first = SETTLE_S + warmup_s
    try:
        moves = [_trajectory(name, states[:, int(name)], first, vehicles[int(name)].shape.name) for name in names]
        cavs = [moves[rank] for rank in cav_ranks]
        others = [move for rank, move in enumerate(moves) if rank not in set(cav_ranks)]
        return place_vehicles(
            cavs,
            others,
            drivable,
            catalog,
            frame_count=frame_count,
            seed=seed,
            device=device,
            comfort=COMFORT,
        )
    except InputError as error:
        raise InputError(f"engine = 'sumo': {error}; another seed may do") from None


def check_sumo() -> None:
    """Check that SUMO's library is installed.

    Raises:
        InputError: If it is not.
    """
    if find_spec("libsumo") is None:
        raise InputError(f"engine = 'sumo': the package libsumo is not installed; run: {install('sumo')}")


def _lane_speed(graph: LaneGraph, name: str, limit: np.ndarray) -> float:
    """Return the limit that SUMO knows: of a way across a junction the lowest, of a road the highest along it.

    SUMO's limits are constant along a lane. Where a road bends, the limit of the place is given to it step by step.
    """
    return float(limit.min() if graph.lanes[name].junction else limit.max())


def _options(place: Path, seed: int, lane_changes: bool) -> list[str]:
    options = {
        **OPTIONS,
        "net-file": str(place / "town.net.xml"),
        "route-files": str(place / "town.rou.xml"),
        "seed": str(seed % 2**31),
        "step-length": str(STEP),
    }
    if lane_changes:
        options["lanechange.duration"] = str(CHANGE_S)
    return [text for key, value in options.items() for text in (f"--{key}", value)]


def _write_routes(
    path: Path,
    network: SumoNetwork,
    vehicles: Sequence[SumoVehicle],
    starts: Sequence[float],
    factors: Sequence[float],
    headways: Sequence[float],
    lane_changes: bool,
) -> None:
    """Write vehicles with types of their own: size, driver, and a route of edges."""
    root = ElementTree.Element("routes")
    never = {"lcStrategic": "-1", "lcSpeedGain": "0", "lcKeepRight": "0", "lcCooperative": "0"}
    for rank, vehicle in enumerate(vehicles):
        shape = vehicle.shape
        ElementTree.SubElement(
            root,
            "vType",
            id=f"type_{rank}",
            length=f"{shape.length:.3f}",
            width=f"{2 * shape.half_width:.3f}",
            minGap=str(STANDSTILL_GAP),
            impatience=str(IMPATIENCE),
            carFollowModel="IDM",
            accel=str(ACCELERATION),
            decel=str(BRAKING),
            emergencyDecel=str(HARDEST_BRAKING),
            tau=f"{headways[rank]:.3f}",
            speedFactor=f"{factors[rank]:.4f}",
            **({} if lane_changes else never),
        )
    for rank, (vehicle, start) in enumerate(zip(vehicles, starts, strict=True)):
        spot = network.place[vehicle.point.lane]
        nose = vehicle.point.station + 0.5 * vehicle.shape.wheelbase + vehicle.shape.front
        edges = [network.place[name].edge for name in vehicle.lanes if name in network.place]
        element = ElementTree.SubElement(
            root,
            "vehicle",
            id=str(rank),
            type=f"type_{rank}",
            depart="0",
            departLane=str(spot.index),
            departPos=f"{nose * spot.scale:.3f}",
            departSpeed=f"{start:.3f}",
            insertionChecks="none",
        )
        ElementTree.SubElement(element, "route", edges=" ".join(edges))
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _run(place: Path, job: dict[str, Any]) -> np.ndarray:
    """Run SUMO in a process of its own and return what `sumo_worker` writes.

    Raises:
        InputError: If it fails.
        MissingPackageError: If `libsumo` cannot be loaded, because a system library is missing.
    """
    (place / "job.json").write_text(json.dumps(job))
    # -P: the folder of the script holds modules whose names must not hide others
    command = [sys.executable, "-P", str(Path(sumo_worker.__file__)), str(place)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode != 0 or not (place / "states.npy").is_file():
        lines = [line for line in (result.stderr + result.stdout).splitlines() if line.strip()]
        why = lines[-1] if lines else f"exit code {result.returncode}"
        if result.returncode == sumo_worker.NOT_LOADED:
            raise MissingPackageError(
                f"engine = 'sumo': the package libsumo cannot be loaded: {why}; install that library with the system's "
                "package manager, or use engine: idm"
            )
        raise InputError(f"engine = 'sumo': SUMO failed: {why}; correct the lanes, or use engine: idm")
    return np.load(place / "states.npy")


def _trajectory(name: str, states: np.ndarray, first: float, model: str) -> Trajectory:
    """Return a vehicle's states as samples; time 0 is frame 0.

    Raises:
        InputError: If SUMO did not put the vehicle on the road.
    """
    known = np.isfinite(states[:, 0])
    if known.sum() < 2:
        raise InputError(f"vehicle {name!r} was not inserted by SUMO; ask for fewer vehicles")
    time = STEP * np.arange(len(states)) - first
    x, y, z, angle = states[known].T
    return Trajectory(
        id=name,
        time=time[known],
        points=np.column_stack([x, y]),
        height=z,
        heading=np.unwrap(np.pi / 2 - np.radians(angle)),
        type=model,
        reference="front_bumper",
    )
