"""Simulate a LiDAR: one turn a frame; geometry traced once, returns found in every weather."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from mmw.core.frame_rate import seconds
from mmw.core.kinematics import Motion, differentiate
from mmw.core.random_keys import random_key
from mmw.core.remember import remembered
from mmw.core.transfer import to_host
from mmw.kernels.lidar import trace as lidar
from mmw.physics.materials.material import Material
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import Views, view_twists
from mmw.sensors.lidar.config import Lidar, sweep_duration
from mmw.sensors.lidar.points import PointCloud
from mmw.sensors.lidar.returns import LidarHits, shade_on_device
from mmw.sensors.lidar.scan_pattern import lidar_order, lidar_pattern
from mmw.sensors.lidar.scene_flow import scene_flow
from mmw.sensors.ray_batch import BLOCK_DIM, check_count, empty_struct
from mmw.sensors.samples import Array, Output
from mmw.sensors.sensor_input import SensorInput


def simulate(data: SensorInput, config: Lidar) -> dict[str, PointCloud]:
    """Return the sweeps of all views in each weather."""
    return dict(sweeps(data, config))


def sweeps(data: SensorInput, config: Lidar) -> Iterator[tuple[str, PointCloud]]:
    """Trace the sweeps of all views once, and yield them in one weather after the other.

    In `carla` the random numbers are the same in every weather, because weather does nothing there.
    """
    arrays = data.scene.arrays
    hits = trace_lidar_hits(data.scene, data.views, config, data.motion)
    for name, weather in data.weathers.items():
        keys = data.keys(name if config.mode == "physical" else "", config.name)
        patch_key = random_key(data.seed_of_scene, data.scenario, name, "fog")
        points = find_lidar_returns(hits, arrays.materials[name], weather, keys, patch_key, output=data.output)
        yield name, _with_flow(data, points) if config.scene_flow else points


def _with_flow(data: SensorInput, points: PointCloud) -> PointCloud:
    if data.output == "numpy":
        return replace(points, scene_flow=scene_flow(data.scene.arrays, data.views, points))
    values, object_id = to_host([points.values.transpose(), points.object_id])  # one piece of memory each
    flow = scene_flow(data.scene.arrays, data.views, replace(points, values=values.T, object_id=object_id))
    return replace(points, scene_flow=wp.array(flow, dtype=float, device=data.scene.device))


@dataclass(frozen=True)
class _Pattern:
    """Rays of a LiDAR on a device."""

    direction_s: wp.array
    """Direction of each ray in the sensor frame, shape [R]."""
    order: wp.array
    """Numbers of the rays in the order of the threads, shape [R], int32."""


@remembered(size=32)
def _on_device(config: Lidar, device: str) -> _Pattern:
    order = lidar_order(config.channels, config.points_per_channel)
    return _Pattern(
        wp.array(lidar_pattern(config).astype(np.float32), dtype=wp.vec3, device=device),
        wp.array(order, dtype=wp.int32, device=device),
    )


def trace_lidar_hits(scene: DeviceScene, views: Views, config: Lidar, motion: Motion | None = None) -> LidarHits:
    """Return the first surface on every ray of every view.

    Args:
        scene: Town and vehicles, with the views' frames loaded; for a rolling sweep made with its
            `sweep_duration` as `sweep_s`.
        views: Sensor poses, A rows.
        config: Pattern and range.
        motion: `differentiate(scene.arrays.poses, scene.arrays.pose_dt)`, if at hand; only a rolling sweep looks at it.

    Raises:
        InputError: If a view's frame is not loaded in the scene, or 32 bits cannot count the batch's returns.
    """
    device = scene.device
    pattern = _on_device(config, str(device))
    shape = len(views), config.channels * config.points_per_channel
    check_count("LiDAR", *shape, 2 if config.returns == "dual" else 1)
    rays = empty_struct(lidar.LidarRays, shape, device)
    hits = LidarHits(
        config,
        rays,
        views.for_scene(scene),
        _sweep(scene, views, config, motion),
        wp.array(seconds(scene.arrays.numbers(views.frame), scene.arrays.rate_hz), dtype=wp.float32, device=device),
        pattern.direction_s,
        device,
    )
    if len(views):
        kernel, sweep = (lidar.rolling_kernel, [hits.sweep]) if config.rolling else (lidar.lidar_kernel, [])
        inputs = [scene.struct, hits.views, *sweep, hits.direction_s, pattern.order, config.range_m]
        wp.launch(kernel, shape, inputs, [rays], device=device, block_dim=BLOCK_DIM)
    return hits


def _sweep(scene: DeviceScene, views: Views, config: Lidar, motion: Motion | None) -> lidar.Sweep:
    sweep = lidar.Sweep()
    sweep.points_per_channel = config.points_per_channel
    if config.rolling:
        twists = view_twists(scene.arrays, motion or differentiate(scene.arrays.poses, scene.arrays.pose_dt), views)
        sweep.duration_s = sweep_duration(config)
        sweep.velocity, sweep.rate = (
            wp.array(twist.astype(np.float32), dtype=wp.vec3, device=scene.device) for twist in twists
        )
    return sweep


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
    offsets, points = shade_on_device(hits, materials, weather, keys, patch_key)
    found = [points.values, points.object_id, points.marks, points.time_offset]
    values, object_id, marks, time_offset = to_host(found) if output == "numpy" else found
    ring, label = marks[0], marks[1]
    return PointCloud(
        offsets, values.transpose(), ring, object_id, label,
        time_offset if hits.config.rolling else _zeros(points.object_id, wp.float32, output),
        marks[2] if hits.config.returns == "dual" else _zeros(points.object_id, wp.uint8, output),
    )  # fmt: skip


def _zeros(like: wp.array, dtype: type, output: Output) -> Array:
    """Return zeros for each return of a column."""
    if output == "numpy":
        return np.zeros(like.shape, dtype=wp.dtype_to_numpy(dtype))
    return wp.zeros(like.shape, dtype=dtype, device=like.device)
