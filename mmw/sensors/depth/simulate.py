"""Depth camera: planar depth images in 16-bit centimeters, and the object in every pixel, from one launch.

Depth does not depend on the weather: CARLA's does not either, and a model of a time-of-flight camera in rain or fog is
not part of this sensor. One image serves every weather.
"""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from dataclasses import dataclass

import numpy as np

from mmw.core.camera_models import Intrinsics
from mmw.kernels.camera import depth as kernels
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import Views
from mmw.sensors.depth.config import DepthCamera
from mmw.sensors.lidar.scan_pattern import pinhole
from mmw.sensors.render.visibility_buffer import depth_images, trace_samples

CENTIMETRES = 0.01
"""Meters of one step of the image."""


@dataclass(frozen=True)
class DepthBatch:
    """Depth images of a batch; row 0 is the top, column 0 the left."""

    depth: np.ndarray
    """Depth along the optical axis (not along the ray) [cm], 0 where nothing is in range, shape [A, H, W], uint16."""
    depth_m: np.ndarray | None = None
    """The same before rounding [m], inf where nothing is in range, shape [A, H, W], float32; only on request."""
    object_id: np.ndarray | None = None
    """Object in each pixel, -1 where nothing is in range, shape [A, H, W], int32; only on request."""


def intrinsics_of(config: DepthCamera) -> Intrinsics:
    """Return the intrinsics of a depth camera."""
    return pinhole(config.width_px, config.height_px, config.fov_deg)


def trace_depth_images(
    scene: DeviceScene, views: Views, config: DepthCamera, *, with_metres: bool, with_objects: bool
) -> kernels.DepthImages:
    """Return images of every view, on the scene's device.

    One ray goes through the center of every pixel, (u + 0.5, v + 0.5) with the optical axis at (W / 2, H / 2). Depth
    is measured along the optical axis, so a wall square to it has one depth everywhere. Depths beyond `range_m` are 0;
    depths below 5 mm read 1 cm, since 0 means no return. Centimeters beyond 655.35 m, which only `format: float32`
    reaches, are 0 too.

    Args:
        scene: Town and vehicles, with the views' frames loaded.
        views: Camera poses (x along the optical axis, y left, z up), A rows.
        config: Image size, field of view and range.
        with_metres: Fill `depth_m`, which is empty otherwise.
        with_objects: Fill `object_id`, which is empty otherwise.

    Raises:
        ValueError: If a view's frame is not loaded in the scene.
    """
    buffer = trace_samples(scene, views, intrinsics_of(config), config.range_m, with_surfaces=False)
    return depth_images(buffer, with_metres=with_metres, with_objects=with_objects)


def trace_depth(scene: DeviceScene, views: Views, config: DepthCamera, *, with_details: bool = False) -> DepthBatch:
    """Return a depth image of every view; see `trace_depth_images`.

    Args:
        scene: Town and vehicles, with the views' frames loaded.
        views: Camera poses (x along the optical axis, y left, z up), A rows.
        config: Image size, field of view and range.
        with_details: Return unrounded depth and object ids too.

    Raises:
        ValueError: If a view's frame is not loaded in the scene.
    """
    images = trace_depth_images(scene, views, config, with_metres=with_details, with_objects=with_details)
    if not with_details:
        return DepthBatch(images.depth.numpy())
    return DepthBatch(images.depth.numpy(), images.depth_m.numpy(), images.object_id.numpy())


def depth_to_metres(depth: np.ndarray) -> np.ndarray:
    """Return depth in meters of 16-bit centimeters, inf for no return, same shape, float32."""
    return np.where(depth == 0, np.inf, depth * CENTIMETRES).astype(np.float32)
