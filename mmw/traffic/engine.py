"""Run the configured traffic engine, and add pedestrians and cyclists."""

from dataclasses import replace
from typing import Protocol

import numpy as np

from mmw.config.traffic_engine import ENGINES, check_package, engine_spec
from mmw.core.errors import InputError
from mmw.core.registry import load_reference
from mmw.core.remember import remembered
from mmw.traffic.cyclists import simulate_cyclists
from mmw.traffic.demand import TrafficDemand, TrafficResult
from mmw.traffic.pedestrians import simulate_pedestrians
from mmw.traffic.roads.lane_graph import LaneGraph

FAR_FROM_LANES = 500.0
"""A spawn center farther than this from every lane is a mistake [m]."""


class TrafficEngine(Protocol):
    """A function that moves the vehicles of a scenario; a `TrafficEngineSpec` names it."""

    def __call__(self, demand: TrafficDemand, /) -> TrafficResult:
        """Return the tracks of all vehicles.

        Raises:
            InputError: If the demand cannot be met. The message starts with the key below `traffic`.
        """
        ...


def simulate_traffic(demand: TrafficDemand) -> TrafficResult:
    """Return the motion of all vehicles, pedestrians and cyclists of a scenario.

    Returns:
        The result of the engine; behind its vehicles the tracks of pedestrians, `ped_001`, `vru_1`..., and of cyclists,
        `cyc_001`...

    Raises:
        InputError: If the engine is unknown, its package is not installed, the town has no lanes and the engine needs
            them, the spawn center is far from them, or the engine cannot meet the demand. The message starts with the
            key below `traffic`.
    """
    check_demand(demand)
    engine: TrafficEngine = load_reference(engine_spec(demand.traffic.engine).simulate)
    result = engine(demand)
    return replace(result, tracks=[*result.tracks, *simulate_pedestrians(demand), *simulate_cyclists(demand)])


def check_demand(demand: TrafficDemand) -> None:
    """Check what every run of an engine needs.

    Raises:
        InputError: If the engine is unknown, its package is not installed, the town has no lanes and the engine needs
            them, or the spawn center is far from them. The message starts with the key below `traffic`.
    """
    spec = engine_spec(demand.traffic.engine)
    check_package(demand.traffic.engine)
    if spec.needs_lanes:
        _check_center(demand)


@remembered(size=4)
def _lane_points(graph: LaneGraph) -> np.ndarray:
    return np.concatenate([lane.points for lane in graph.lanes.values()])


def _check_center(demand: TrafficDemand) -> None:
    town, center = demand.town, demand.traffic.spawn_center_m
    if not town.lanes.lanes:
        others = " or ".join(name for name, spec in ENGINES.items() if not spec.needs_lanes)
        raise InputError(
            f"engine = {demand.traffic.engine!r}: {town.path} has no lanes below its root; generated traffic needs "
            f"them; use a town with lanes, or engine: {others}"
        )
    points = _lane_points(town.lanes)
    low, high = points.min(axis=0), points.max(axis=0)
    away = np.linalg.norm(points[:, :2] - center[:2], axis=1).min()
    if away > FAR_FROM_LANES:
        raise InputError(
            f"spawn_center_m = {list(center)}: {away:.0f} m from the nearest lane; lanes of {town.path.name} reach "
            f"from ({low[0]:.0f}, {low[1]:.0f}) to ({high[0]:.0f}, {high[1]:.0f}) m; choose a place"
        )
