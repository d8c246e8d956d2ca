"""Simulate a LiDAR: one turn a frame; geometry traced once, returns found in every weather."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.core.constants import FRAME_DT
from mmw.core.kinematics import Motion, differentiate
from mmw.core.transfer import to_host
from mmw.kernels.lidar import trace as lidar
from mmw.physics.materials.material import Material
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import Views, view_twists
from mmw.sensors.lidar.config import Lidar
from mmw.sensors.lidar.returns import LidarHits, shade_on_device
from mmw.sensors.lidar.scan_pattern import lidar_order, lidar_pattern
from mmw.sensors.ray_batch import BLOCK_DIM, check_count, empty_struct


@dataclass(frozen=True)
class PointCloud:
    """Point clouds of a batch in one weather.

    A views, N returns in all. The returns of view a are rows `offsets[a]` to `offsets[a + 1]`, channel by channel from
    the top, in firing order, of one ray the strongest before the last; rays without a return have no row.
    """

    offsets: np.ndarray
    """First return of every view, and N, shape [A + 1], int32."""
    x: np.ndarray
    """Forward in the sensor frame, on a grid of 1/1024 m, shape [N], float32."""
    y: np.ndarray
    """Left in the sensor frame, on a grid of 1/1024 m, shape [N], float32."""
    z: np.ndarray
    """Up in the sensor frame, on a grid of 1/1024 m, shape [N], float32."""
    intensity: np.ndarray
    """0 to 1 on a grid of 1/256, shape [N], float32: received power x range^2, in `carla` exp(-rate d)."""
    ring: np.ndarray
    """Channel, 0 the highest, shape [N], uint8."""
    object_id: np.ndarray
    """Object that was hit, -1 for rain and fog, shape [N], int32."""
    label: np.ndarray
    """0 surface, 1 rain, 2 fog, shape [N], uint8."""
    time_offset: np.ndarray
    """Time of firing after the frame's instant [s], -0.01 to 0, shape [N], float32; 0 for a still picture."""
    return_number: np.ndarray
    """0 the strongest or only return of its ray, 1 the last one of two, shape [N], uint8."""


def trace_lidar_hits(scene: DeviceScene, views: Views, config: Lidar, motion: Motion | None = None) -> LidarHits:
    """Return the first surface on every ray of every view.

    Args:
        scene: Town and vehicles, with the views' frames loaded; for a rolling sweep made with `sweep_s=FRAME_DT`.
        views: Sensor poses, A rows.
        config: Pattern and range.
        motion: `differentiate(scene.arrays.poses)`, if at hand; only a rolling sweep looks at it.

    Raises:
        InputError: If a view's frame is not loaded in the scene, or 32 bits cannot count the batch's returns.
    """
    device = scene.device
    directions = lidar_pattern(config)
    shape = len(views), len(directions)
    check_count("LiDAR", *shape, 2 if config.returns == "dual" else 1)
    rays = empty_struct(lidar.LidarRays, shape, device)
    hits = LidarHits(
        config,
        rays,
        views.for_scene(scene),
        _sweep(scene, views, config, motion),
        wp.array(views.frame * FRAME_DT, dtype=wp.float32, device=device),
        wp.array(directions.astype(np.float32), dtype=wp.vec3, device=device),
        device,
    )
    if len(views):
        order = wp.array(lidar_order(config.channels, config.points_per_channel), dtype=wp.int32, device=device)
        kernel, sweep = (lidar.rolling_kernel, [hits.sweep]) if config.rolling else (lidar.lidar_kernel, [])
        inputs = [scene.struct, hits.views, *sweep, hits.direction_s, order, config.range_m]
        wp.launch(kernel, shape, inputs, [rays], device=device, block_dim=BLOCK_DIM)
    return hits


def _sweep(scene: DeviceScene, views: Views, config: Lidar, motion: Motion | None) -> lidar.Sweep:
    sweep = lidar.Sweep()
    sweep.points_per_channel = config.points_per_channel
    if config.rolling:
        twists = view_twists(scene.arrays, motion or differentiate(scene.arrays.poses), views)
        sweep.duration_s = FRAME_DT
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
) -> PointCloud:
    """Return the point clouds of traced hits in one weather.

    Args:
        hits: Hits of the rays.
        materials: Materials by id, as they are in the weather (`SceneData.materials[weather]`).
        weather: Physical values of the weather; `carla` looks at neither.
        keys: Key of each view's random numbers (`mmw.scene.views.view_keys`), shape [A, 2], uint32.
        patch_key: Key of the patches of fog, one for all sensors and frames of a scenario (`random_key`).

    Raises:
        InputError: If there are no materials, or not one key a view.
    """
    offsets, points = shade_on_device(hits, materials, weather, keys, patch_key)
    count = int(offsets[-1])
    values, object_id, marks, time_offset = to_host([points.values, points.object_id, points.marks, points.time_offset])
    x, y, z, intensity = values
    ring, label, *number = marks
    return PointCloud(
        offsets, x, y, z, intensity, ring, object_id, label,
        time_offset if hits.config.rolling else np.zeros(count, dtype=np.float32),
        number[0] if number else np.zeros(count, dtype=np.uint8),
    )  # fmt: skip
