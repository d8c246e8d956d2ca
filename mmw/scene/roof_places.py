"""Find the places of base stations; of those on roofs, the height."""

from pathlib import Path

import numpy as np

from mmw.config import BaseStationConfig, Config, ScenarioConfig
from mmw.core.errors import InputError
from mmw.core.transforms import pose_from_mount
from mmw.scene.device_scene import DeviceScene
from mmw.scene.ray_casting import cast_rays
from mmw.scene.reader import read_stage

ABOVE_M = 1.0
"""Rays start this far above everything. Design value."""


def station_poses(config: Config, scenario: ScenarioConfig, source: Path) -> list[tuple[str, np.ndarray]]:
    """Return names and poses of a scenario's base stations, the foot of each on its roof where it goes by roofs.

    Args:
        config: The configuration.
        scenario: One of its scenarios.
        source: Its town asset or stage.

    Raises:
        InputError: If there is no building below a station on a roof, or the town cannot be read.
    """
    on_roofs = [station for station in scenario.base_stations if station.height_from == "roof"]
    heights = _roof_heights(config, scenario, source, on_roofs) if on_roofs else {}
    poses = []
    for station in scenario.base_stations:
        x, y, z = station.position_m
        foot = (x, y, z + heights.get(station.name, 0.0))
        poses.append((station.name, pose_from_mount(foot, station.yaw_deg)))
    return poses


def _roof_heights(
    config: Config, scenario: ScenarioConfig, source: Path, stations: list[BaseStationConfig]
) -> dict[str, float]:
    """Return the height of the highest surface at each station [m]."""
    start = config.frames_of(scenario).start if scenario.stage is not None else 0
    variants = {weather: config.variants[weather] for weather in config.weathers[:1]}
    options = {"roles": scenario.actor_roles, "material_map": config.materials_of(scenario)}
    arrays = read_stage(source, range(start, start + 1), variants, rate_hz=config.frame_rate_of(scenario), **options)
    scene = DeviceScene(arrays, "cpu", max_batch_frames=1)
    scene.load_batch([arrays.frames[0]])
    top = float(arrays.points[:, 2].max(initial=0.0)) + ABOVE_M
    origins = np.array([(*station.position_m[:2], top) for station in stations])
    hits = cast_rays(scene, origins, np.tile([0.0, 0.0, -1.0], (len(origins), 1)))
    heights = {}
    for station, distance, object_id in zip(stations, hits.distance, hits.object_id, strict=True):
        what = arrays.objects[object_id] if object_id >= 0 else None
        if what is None or what.label != "building":
            found = "nothing" if what is None else f"{what.prim_path} ({what.label})"
            raise InputError(
                f"scenario {scenario.name!r}: base station {station.name!r}: position_m = {list(station.position_m)} "
                f"with height_from: roof needs a building below it; at ({station.position_m[0]:g}, "
                f"{station.position_m[1]:g}) the highest is {found}; move it, or use height_from: world"
            )
        heights[station.name] = top - float(distance)
    return heights
