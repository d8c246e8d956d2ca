"""Start SUMO with the vehicles of a scenario on the lanes of its town."""

import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mmw.config import TrafficConfig
from mmw.core.constants import FRAME_RATE_HZ
from mmw.traffic.demand import TrafficDemand
from mmw.traffic.idm.driver import ACCELERATION, BRAKING, HARDEST_BRAKING, STANDSTILL_GAP, STEP
from mmw.traffic.model_choice import draw_paint
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.route import PATH_STEP
from mmw.traffic.spawn import RUN_OUT, SETTLE_S, place_starts, seeded
from mmw.traffic.sumo.network import SumoNetwork, make_network
from mmw.traffic.sumo.process import SumoProcess
from mmw.traffic.sumo.routes import RoutePlanner, SumoVehicle, entry_speeds, lane_limits
from mmw.traffic.sumo.worker import HINT_STEP

IMPATIENCE = 0.5
"""Share to which drivers that give way count on the others' braking [-]; with 0 they also wait for vehicles far away
that wait themselves."""

CHANGE_S = 4.0
"""A lane change takes this long [s]."""

OBSTACLE = "obstacle"
"""Type and route of what stands or moves in the way of SUMO's vehicles and is none of them."""

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


@dataclass(frozen=True)
class SumoFleet:
    """The vehicles of a scenario and the SUMO that drives them; its first step is `first` seconds before frame 0."""

    process: SumoProcess
    network: SumoNetwork
    vehicles: Sequence[SumoVehicle]
    """By rank, which is their id in SUMO."""
    cav_ranks: tuple[int, ...]
    notes: list[str]
    first: float
    """Time from SUMO's first step to frame 0 [s]."""
    duration: float
    """Time that routes are long enough for [s]."""
    top_speed: float
    """Highest speed limit of the town [m/s]."""


def start_sumo(demand: TrafficDemand) -> SumoFleet:
    """Return the vehicles of a scenario at their starts; `step` of the process drives them.

    Raises:
        InputError: If there is no room for the vehicles.
    """
    traffic, graph = demand.traffic, demand.town.lanes
    duration = 2 * SETTLE_S + traffic.warmup_s + demand.frame_count / FRAME_RATE_HZ
    fastest = max(lane.speed for lane in graph.lanes.values())
    planner = RoutePlanner(demand, fastest * duration + RUN_OUT)
    placed = place_starts(demand, planner.endless, planner.add)
    limits = lane_limits(graph)
    network = make_network(graph, {name: _lane_speed(graph, name, limits[name]) for name in graph.lanes})
    holder = tempfile.TemporaryDirectory(prefix="mmw-sumo-")
    place = Path(holder.name)
    network.write(place / "town.net.xml")
    speeds = entry_speeds(placed.vehicles, graph, limits, 0.6 * BRAKING)
    _write_routes(place / "town.rou.xml", network, placed.vehicles, speeds, traffic)
    job = {
        "options": _options(place, demand.seed, traffic.lane_changes),
        "limits": {
            lane: limits[ours][:: round(HINT_STEP / PATH_STEP)].tolist() for lane, ours in network.internal.items()
        },
        "top_speed": fastest,
    }
    process = SumoProcess(holder, job)
    first = SETTLE_S + traffic.warmup_s
    return SumoFleet(process, network, placed.vehicles, placed.cav_ranks, placed.notes, first, duration, fastest)


def paint_of(demand: TrafficDemand, rank: int, model: str) -> str:
    """Return the paint of a vehicle, the same in recorded and live traffic."""
    return draw_paint(demand.catalog[model], seeded(demand.seed, *str(rank).encode()))


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
    """Write vehicles with types of their own: size, driver, and a route of edges; and type and route of obstacles."""
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
    ElementTree.SubElement(root, "vType", {"minGap": "0"}, id=OBSTACLE)
    ElementTree.SubElement(root, "route", edges=next(iter(network.place.values())).edge, id=OBSTACLE)
    for rank, (vehicle, speed) in enumerate(zip(vehicles, speeds, strict=True)):
        spot = network.place[vehicle.start.point.lane]
        edges = [network.place[name].edge for name in vehicle.lanes if name in network.place]
        depart = {"depart": "0", "departLane": str(spot.index), "departPos": f"{vehicle.bumpers[1] * spot.scale:.3f}"}
        depart |= {"departSpeed": f"{speed:.3f}", "insertionChecks": "none"}
        element = ElementTree.SubElement(root, "vehicle", depart, id=str(rank), type=f"type_{rank}")
        ElementTree.SubElement(element, "route", edges=" ".join(edges))
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
