"""Drive vehicles with SUMO on the lanes of a town, and place their bodies on the road."""

import json
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mmw.config import TrafficConfig
from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError, MissingPackageError
from mmw.traffic.demand import TrafficDemand, TrafficResult
from mmw.traffic.idm.driver import ACCELERATION, BRAKING, HARDEST_BRAKING, STANDSTILL_GAP, STEP
from mmw.traffic.replay.recorded_vehicles import place_vehicles
from mmw.traffic.replay.trajectory_table import Trajectory
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.route import PATH_STEP
from mmw.traffic.spawn import RUN_OUT, SETTLE_S, place_starts, vehicle_order
from mmw.traffic.sumo import worker as sumo_worker
from mmw.traffic.sumo.network import SumoNetwork, make_network
from mmw.traffic.sumo.routes import RoutePlanner, SumoVehicle, entry_speeds, lane_limits

IMPATIENCE = 0.5
"""Share to which drivers that give way count on the others' braking [-]; with 0 they also wait for vehicles far away
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


def simulate_sumo(demand: TrafficDemand) -> TrafficResult:
    """Return the motion of all vehicles of a scenario, driven by SUMO.

    Raises:
        InputError: If SUMO fails, there is no room for the vehicles, or a vehicle that SUMO moved cannot stand on the
            road.
        MissingPackageError: If `libsumo` cannot be loaded, because a system library is missing.
    """
    traffic, graph = demand.traffic, demand.town.lanes
    duration = 2 * SETTLE_S + traffic.warmup_s + demand.frame_count / FRAME_RATE_HZ
    fastest = max(lane.speed for lane in graph.lanes.values())
    planner = RoutePlanner(demand, fastest * duration + RUN_OUT)
    placed = place_starts(demand, planner.endless, planner.add)
    vehicles, cav_ranks = placed.vehicles, placed.cav_ranks
    limits = lane_limits(graph)
    network = make_network(graph, {name: _lane_speed(graph, name, limits[name]) for name in graph.lanes})
    with tempfile.TemporaryDirectory(prefix="mmw-sumo-") as folder:
        place = Path(folder)
        network.write(place / "town.net.xml")
        _write_routes(
            place / "town.rou.xml", network, vehicles, entry_speeds(vehicles, graph, limits, 0.6 * BRAKING), traffic
        )
        job = {
            "options": _options(place, demand.seed, traffic.lane_changes),
            "vehicles": len(vehicles),
            "steps": int(np.ceil(duration / STEP)),
            "limits": {
                lane: limits[ours][:: round(sumo_worker.HINT_STEP / PATH_STEP)].tolist()
                for lane, ours in network.internal.items()
            },
            "top_speed": fastest,
        }
        states = _run(place, job)
    first = SETTLE_S + traffic.warmup_s
    try:
        moves = [
            _trajectory(str(rank), states[:, rank], first, vehicle.shape.name) for rank, vehicle in enumerate(vehicles)
        ]
        ordered = [moves[rank] for rank in vehicle_order(cav_ranks, len(moves))]
        return TrafficResult(place_vehicles(demand, ordered, len(cav_ranks), comfort=COMFORT), notes=placed.notes)
    except InputError as error:
        raise InputError(f"engine = 'sumo': {error}; another seed may do") from None


def _lane_speed(graph: LaneGraph, name: str, limit: np.ndarray) -> float:
    """Return the one limit of a lane in SUMO: the lowest in a junction, else the highest; the worker sets others."""
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
    speeds: Sequence[float],
    traffic: TrafficConfig,
) -> None:
    """Write vehicles with types of their own: size, driver, and a route of edges."""
    root = ElementTree.Element("routes")
    fixed = {"carFollowModel": "IDM", "minGap": STANDSTILL_GAP, "accel": ACCELERATION, "decel": BRAKING}
    fixed |= {"emergencyDecel": HARDEST_BRAKING, "impatience": IMPATIENCE}
    if not traffic.lane_changes:
        fixed |= {"lcStrategic": -1, "lcSpeedGain": 0, "lcKeepRight": 0, "lcCooperative": 0}
    for rank, vehicle in enumerate(vehicles):
        own = {"length": f"{vehicle.shape.length:.3f}", "width": f"{2 * vehicle.shape.half_width:.3f}"}
        own |= {"tau": f"{vehicle.start.headway:.3f}", "speedFactor": f"{vehicle.start.factor:.4f}"}
        attributes = {key: str(value) for key, value in (own | fixed).items()}
        ElementTree.SubElement(root, "vType", attributes, id=f"type_{rank}")
    for rank, (vehicle, speed) in enumerate(zip(vehicles, speeds, strict=True)):
        spot = network.place[vehicle.start.point.lane]
        edges = [network.place[name].edge for name in vehicle.lanes if name in network.place]
        depart = {"depart": "0", "departLane": str(spot.index), "departPos": f"{vehicle.bumpers[1] * spot.scale:.3f}"}
        depart |= {"departSpeed": f"{speed:.3f}", "insertionChecks": "none"}
        element = ElementTree.SubElement(root, "vehicle", depart, id=str(rank), type=f"type_{rank}")
        ElementTree.SubElement(element, "route", edges=" ".join(edges))
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _run(place: Path, job: dict[str, Any]) -> np.ndarray:
    """Run SUMO in a process of its own and return what `sumo_worker` writes."""
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
    """Return a vehicle's states as samples; time 0 is frame 0."""
    known = np.isfinite(states[:, 0])
    if known.sum() < 2:
        raise InputError(f"vehicle {name!r} was not inserted by SUMO; give fewer vehicles")
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
