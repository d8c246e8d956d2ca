"""LiDAR: one turn a frame, first return of every ray, intensity from material and incidence in clear air."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.config import LidarConfig
from mmw.kernels import lidar, structs
from mmw.materials import Material
from mmw.patterns import lidar_directions, lidar_order
from mmw.scene import Scene
from mmw.views import Views

BLOCK_DIM = 64
"""Threads of a block for kernels that query a BVH, whose stacks lie in shared memory."""

MOST_RAYS = 2**31 - 1
"""Rays of one batch: returns are counted in 32 bits."""


@dataclass(frozen=True)
class LidarHits:
    """What the rays of a batch met; geometry only, so it serves every weather.

    A views, N returns in all. The returns of view a are rows `offsets[a]` to `offsets[a + 1]`, channel by channel from
    the top, in firing order; rays without a return have no row.
    """

    offsets: np.ndarray
    """First return of every view, and N, shape [A + 1], int32."""
    xyz: np.ndarray
    """Positions in the sensor frame, x forward, y left, z up, on a grid of 1/1024 m, shape [3, N], float32."""
    ring: np.ndarray
    """Channel, 0 the highest, shape [N], uint8."""
    object_id: np.ndarray
    """Object that was hit, shape [N], int32."""
    points: lidar.LidarPoints
    """The same and `range`, `ray`, `cos_incidence`, `material_id` on the device, shape [N]."""


@dataclass(frozen=True)
class LidarBatch:
    """Point clouds of a batch in one weather. The returns of view a are rows `offsets[a]` to `offsets[a + 1]`."""

    offsets: np.ndarray
    """First return of every view, and N, shape [A + 1], int32."""
    x: np.ndarray
    """Forward in the sensor frame, on a grid of 1/1024 m, shape [N], float32."""
    y: np.ndarray
    """Left in the sensor frame, on a grid of 1/1024 m, shape [N], float32."""
    z: np.ndarray
    """Up in the sensor frame, on a grid of 1/1024 m, shape [N], float32."""
    intensity: np.ndarray
    """Reflectance at 905 nm x cosine of incidence, 0 to 1 on a grid of 1/256, shape [N], float32."""
    ring: np.ndarray
    """Channel, 0 the highest, shape [N], uint8."""
    object_id: np.ndarray
    """Object that was hit, shape [N], int32."""


def trace_lidar_hits(scene: Scene, views: Views, config: LidarConfig) -> LidarHits:
    """Return the first surface on every ray of every view, as a list of the rays that met one.

    Args:
        scene: Town and vehicles, with the views' frames loaded.
        views: Sensor poses, A rows.
        config: Pattern and range.

    Raises:
        ValueError: If a view's frame is not loaded in the scene, or the batch has more rays than 32 bits can count.
    """
    device = scene.device
    directions = lidar_directions(
        config.channels, config.points_per_channel, config.upper_fov_deg, config.lower_fov_deg
    )
    if len(views) * len(directions) > MOST_RAYS:
        raise ValueError(
            f"LiDAR batch of {len(views)} views x {len(directions)} rays; one launch holds {MOST_RAYS} rays; "
            "lower compute.batch_frames"
        )
    on_device = views.for_scene(scene)
    if len(views) == 0:
        return _hits(np.zeros(1, dtype=np.int32), _allocate_points(0, device))
    direction_s = wp.array(directions.astype(np.float32), dtype=wp.vec3, device=device)
    order = wp.array(lidar_order(config.channels, config.points_per_channel), dtype=wp.int32, device=device)
    rays = _trace(scene, on_device, direction_s, order, config.range_m)
    hits_up_to = wp.empty_like(rays.is_hit)
    wp.utils.array_scan(rays.is_hit.flatten(), hits_up_to.flatten(), inclusive=True)
    ends = hits_up_to[:, len(directions) - 1].contiguous().numpy()
    offsets = np.concatenate([np.zeros(1, dtype=np.int32), ends])
    points = _allocate_points(int(offsets[-1]), device)
    wp.launch(
        lidar.gather_kernel,
        dim=rays.is_hit.shape,
        inputs=[rays, hits_up_to, direction_s, config.points_per_channel],
        outputs=[points],
        device=device,
    )
    return _hits(offsets, points)


def _trace(scene: Scene, views: structs.Views, direction_s: wp.array, order: wp.array, t_max: float) -> lidar.LidarRays:
    shape = (views.slot.shape[0], direction_s.shape[0])
    rays = lidar.LidarRays()
    for name, dtype in (("is_hit", int), ("range", float), ("cos_incidence", float), ("object_id", int)):
        setattr(rays, name, wp.empty(shape, dtype=dtype, device=scene.device))
    rays.material_id = wp.empty(shape, dtype=int, device=scene.device)
    wp.launch(
        lidar.lidar_kernel,
        dim=shape,
        inputs=[scene.struct, views, direction_s, order, t_max],
        outputs=[rays],
        device=scene.device,
        block_dim=BLOCK_DIM,
    )
    return rays


def _allocate_points(count: int, device: str) -> lidar.LidarPoints:
    points = lidar.LidarPoints()
    points.xyz = wp.empty((3, count), dtype=float, device=device)
    for name, dtype in (
        ("range", float),
        ("cos_incidence", float),
        ("ray", int),
        ("ring", wp.uint8),
        ("object_id", int),
        ("material_id", int),
    ):
        setattr(points, name, wp.empty(count, dtype=dtype, device=device))
    return points


def _hits(offsets: np.ndarray, points: lidar.LidarPoints) -> LidarHits:
    return LidarHits(offsets, points.xyz.numpy(), points.ring.numpy(), points.object_id.numpy(), points)


def shade_lidar(hits: LidarHits, materials: Sequence[Material]) -> LidarBatch:
    """Return the point clouds of traced hits in one weather.

    Intensity is the diffuse reflectance of the surface at 905 nm times the cosine of incidence: what a LiDAR reports
    that compensates for range, in clear air, looking at a Lambert surface. The coordinates are those of `hits`, shared
    and not copied.

    Args:
        hits: What the rays met.
        materials: Materials by id, as they are in the weather (`SceneArrays.materials[weather]`).

    Raises:
        ValueError: If there are no materials.

    Source: LiDAR equation of a Lambert target that fills the beam, P ~ rho cos(theta) / R^2, times R^2; for example
    W. Wagner, "Radiometric calibration of small-footprint full-waveform airborne laser scanner measurements", 2010.
    """
    if not materials:
        raise ValueError("shade_lidar: no materials; every id of the scene needs one; pass arrays.materials[weather]")
    points = hits.points
    device = points.material_id.device
    reflectance = np.array([material.lidar_reflectance for material in materials], dtype=np.float32)
    intensity = wp.empty(points.material_id.shape[0], dtype=float, device=device)
    wp.launch(
        lidar.shade_kernel,
        dim=intensity.shape,
        inputs=[points.material_id, points.cos_incidence, wp.array(reflectance, dtype=float, device=device)],
        outputs=[intensity],
        device=device,
    )
    x, y, z = hits.xyz
    return LidarBatch(hits.offsets, x, y, z, intensity.numpy(), hits.ring, hits.object_id)


def trace_lidar(scene: Scene, views: Views, config: LidarConfig, materials: Sequence[Material]) -> LidarBatch:
    """Return the point clouds of every view in one weather: `trace_lidar_hits`, then `shade_lidar`."""
    return shade_lidar(trace_lidar_hits(scene, views, config), materials)
