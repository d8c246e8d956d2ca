"""Choose the traffic engine: IDM, SUMO, or a table of trajectories."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mmw.config import TrafficConfig
from mmw.core.errors import InputError
from mmw.traffic.idm.run import VehicleTrack, run_traffic
from mmw.traffic.pedestrians import walk_people
from mmw.traffic.replay.engine import replay_file
from mmw.traffic.roads.town_asset import Town
from mmw.traffic.sumo.engine import simulate_sumo
from mmw.usd.vehicle_catalog import load_figures

FAR_FROM_LANES = 500.0
"""A spawn centre farther than this from every lane is taken for a mistake [m]."""


def simulate_traffic(
    town: Town, traffic: TrafficConfig, catalog: Mapping[str, Any], *, base: Path, frame_count: int, seed: int
) -> list[VehicleTrack]:
    """Return the motion of all vehicles and pedestrians of a scenario.

    Args:
        town: Lanes and drivable surface; engine `file` needs no lanes.
        traffic: Which engine, and what it needs.
        catalog: Vehicle models by name.
        base: Folder that the path of a trajectory file starts from.
        frame_count: F, frames at 100 Hz.
        seed: Same seed, same motion.

    Returns:
        `cav_1`, `cav_2`..., then `veh_001`, `veh_002`... by distance to the spawn centre, then `ped_001`...; poses are
        NaN in frames in which a recorded vehicle is not there.

    Raises:
        InputError: If the town has no lanes, the spawn centre is far from them, there is no room for the vehicles, SUMO
            is not installed, or the trajectories cannot be used. The message starts with the key below `traffic`.
    """
    tracks = _drive(town, traffic, catalog, base, frame_count, seed)
    if not traffic.pedestrian_count:
        return tracks
    center, count = traffic.spawn_center_m, traffic.pedestrian_count
    return tracks + walk_people(
        town.walks, load_figures(), frame_count=frame_count, count=count, center=center, seed=seed
    )


def _drive(
    town: Town, traffic: TrafficConfig, catalog: Mapping[str, Any], base: Path, frame_count: int, seed: int
) -> list[VehicleTrack]:
    """Return the motion of the vehicles."""
    drivable = (town.points, town.faces)
    if traffic.engine == "file":
        path = base / (traffic.trajectories or "")
        return replay_file(path, drivable, catalog, traffic, frame_count=frame_count, seed=seed)
    _check_center(town, traffic)
    if traffic.engine == "sumo":
        return simulate_sumo(town.lanes, drivable, catalog, traffic, frame_count=frame_count, seed=seed)
    return run_traffic(town.lanes, drivable, catalog, traffic, frame_count=frame_count, seed=seed).tracks


def _check_center(town: Town, traffic: TrafficConfig) -> None:
    if not town.lanes.lanes:
        raise InputError(
            f"engine = {traffic.engine!r}: {town.path} has no lanes below its root; generated traffic needs them; "
            "use a town with lanes, or engine: file"
        )
    points = np.concatenate([lane.points for lane in town.lanes.lanes.values()])
    low, high = points.min(axis=0), points.max(axis=0)
    away = np.linalg.norm(points[:, :2] - traffic.spawn_center_m[:2], axis=1).min()
    if away > FAR_FROM_LANES:
        raise InputError(
            f"spawn_center_m = {list(traffic.spawn_center_m)}: {away:.0f} m from the nearest lane; lanes of "
            f"{town.path.name} reach from ({low[0]:.0f}, {low[1]:.0f}) to ({high[0]:.0f}, {high[1]:.0f}) m; choose a "
            "place"
        )
