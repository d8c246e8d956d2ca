"""Simulate a LiDAR: one turn a frame; geometry traced once, returns found in every weather."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from mmw.core.frame_rate import seconds
from mmw.core.kinematics import Motion, differentiate
from mmw.core.random_keys import random_key
from mmw.core.transfer import to_host
from mmw.physics.materials.material import Material
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import Views, view_twists
from mmw.sensors.lidar.config import Lidar
from mmw.sensors.lidar.points import PointCloud
from mmw.sensors.lidar.returns import LidarHits, shade_on_device
from mmw.sensors.lidar.scene_flow import scene_flow
from mmw.sensors.lidar.sweep_arrays import SweepArrays
from mmw.sensors.ray_batch import check_count
from mmw.sensors.samples import Output
from mmw.sensors.sensor_input import SensorInput
from mmw.sensors.workspace import workspace


def simulate(data: SensorInput, config: Lidar) -> dict[str, PointCloud]:
    """Return the sweeps of all views in each weather."""
    return dict(sweeps(data, config))


def sweeps(data: SensorInput, config: Lidar) -> Iterator[tuple[str, PointCloud]]:
    """Trace the sweeps of all views once, and yield them in one weather after the other.

    In `carla` the random numbers are the same in every weather, because weather does nothing there.
    """
    arrays = data.scene.arrays
    hits = trace_lidar_hits(data.scene, data.views, config, data.motion, data.cache, True)
    for name, weather in data.weathers.items():
        keys = data.keys(name if config.mode == "physical" else "", config.name)
        patch_key = random_key(data.seed_of_scene, data.scenario, name, "fog")
        points = find_lidar_returns(hits, arrays.materials[name], weather, keys, patch_key, output=data.output)
        hits = hits.traced
        yield name, _with_flow(data, points) if config.scene_flow else points


def _with_flow(data: SensorInput, points: PointCloud) -> PointCloud:
    if data.output == "numpy":
        return replace(points, scene_flow=scene_flow(data.scene.arrays, data.views, points))
    values, object_id = to_host([points.values.transpose(), points.object_id])  # one piece of memory each
    flow = scene_flow(data.scene.arrays, data.views, replace(points, values=values.T, object_id=object_id))
    return replace(points, scene_flow=wp.array(flow, dtype=float, device=data.scene.device))


def trace_lidar_hits(
    scene: DeviceScene,
    views: Views,
    config: Lidar,
    motion: Motion | None = None,
    store: dict[Any, Any] | None = None,
    is_put_off: bool = False,
) -> LidarHits:
    """Return the first surface on every ray of every view.

    Args:
        scene: Town and vehicles, with the views' frames loaded; for a rolling sweep made with its
            `sweep_duration` as `sweep_s`.
        views: Sensor poses, A rows.
        config: Pattern and range.
        motion: `differentiate(scene.arrays.poses, scene.arrays.pose_dt)`, if at hand; only a rolling sweep looks at it.
        store: Where the arrays of small batches are kept, `SensorInput.cache`: the next hits of the same LiDAR then
            overwrite these. None for hits that stay.
        is_put_off: Whether the launch waits for that of the first weather's returns (`LidarHits.scene`).

    Raises:
        InputError: If a view's frame is not loaded in the scene, or 32 bits cannot count the batch's returns.
    """
    count, rays = len(views), config.channels * config.points_per_channel
    check_count("LiDAR", count, rays, 2 if config.returns == "dual" else 1)
    store = {} if store is None else store
    arrays = workspace(store, config, count, rays, lambda: SweepArrays(config, count, scene.device))
    if not count:
        return LidarHits(config, arrays)
    *own, time_s, _, velocity, rate = arrays.given.host
    views.write(scene, own)
    time_s[:] = seconds(scene.arrays.numbers(views.frame), scene.arrays.rate_hz)
    if config.rolling:
        motion = motion or differentiate(scene.arrays.poses, scene.arrays.pose_dt)
        velocity[:], rate[:] = view_twists(scene.arrays, motion, views)
    hits = LidarHits(config, arrays, scene)
    if is_put_off:
        return hits
    arrays.given.upload()
    arrays.trace(scene)
    return hits.traced


def find_lidar_returns(
    hits: LidarHits,
    materials: Sequence[Material],
    weather: Weather,
    keys: np.ndarray,
    patch_key: tuple[int, int] = (0, 0),
    *,
    output: Output = "numpy",
) -> PointCloud:
    """Return the point clouds of traced hits in one weather.

    Args:
        hits: Hits of the rays.
        materials: Materials by id, as they are in the weather (`SceneData.materials[weather]`).
        weather: Physical values of the weather; `carla` looks at neither.
        keys: Key of each view's random numbers (`mmw.scene.views.view_keys`), shape [A, 2], uint32.
        patch_key: Key of the patches of fog, one for all sensors and frames of a scenario (`random_key`).
        output: `warp` leaves the points on the device.

    Raises:
        InputError: If there are no materials, or not one key a view.
    """
    offsets, points = shade_on_device(hits, materials, weather, keys, patch_key, output)
    return PointCloud(offsets, **hits.arrays.columns(points, int(offsets[-1]), output))
