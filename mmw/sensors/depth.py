"""Depth camera: planar depth images in 16-bit centimetres."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.config import DepthConfig
from mmw.kernels import depth as kernels
from mmw.patterns import pinhole
from mmw.scene import Scene
from mmw.views import Views

TILE = 8
"""Pixels on a side of a block's square."""

CENTIMETRES = 0.01
"""Metres of one step of the image."""


@dataclass(frozen=True)
class DepthBatch:
    """Depth images of a batch; row 0 is the top, column 0 the left."""

    depth: np.ndarray
    """Depth along the optical axis (not along the ray) [cm], 0 where nothing is in range, shape [A, H, W], uint16."""
    depth_m: np.ndarray | None = None
    """The same before rounding [m], inf where nothing is in range, shape [A, H, W], float32; only on request."""
    object_id: np.ndarray | None = None
    """Object in each pixel, -1 where nothing is in range, shape [A, H, W], int32; only on request."""


def trace_depth(scene: Scene, views: Views, config: DepthConfig, *, with_details: bool = False) -> DepthBatch:
    """Return a depth image of every view.

    One ray goes through the centre of every pixel, (u + 0.5, v + 0.5) with the optical axis at (W / 2, H / 2). Depth
    is measured along the optical axis, so a wall square to it has one depth everywhere. Depths beyond `range_m` are 0;
    depths below 5 mm read 1 cm, since 0 means no return.

    Args:
        scene: Town and vehicles, with the views' frames loaded.
        views: Camera poses (x along the optical axis, y left, z up), A rows.
        config: Image size, field of view and range.
        with_details: Return unrounded depth and object ids too.

    Raises:
        ValueError: If a view's frame is not loaded in the scene.
    """
    on_device = views.for_scene(scene)
    shape = (len(views), config.height_px, config.width_px)
    detail_shape = shape if with_details else (0, 0, 0)
    images = kernels.DepthImages()
    images.depth = wp.empty(shape, dtype=wp.uint16, device=scene.device)
    images.depth_m = wp.empty(detail_shape, dtype=float, device=scene.device)
    images.object_id = wp.empty(detail_shape, dtype=int, device=scene.device)
    if len(views):
        wp.launch(
            kernels.depth_kernel,
            dim=(len(views), -(-config.height_px // TILE), -(-config.width_px // TILE), TILE * TILE),
            inputs=[scene.struct, on_device, _camera(config)],
            outputs=[images],
            device=scene.device,
            block_dim=TILE * TILE,
        )
    depth = images.depth.numpy()
    if not with_details:
        return DepthBatch(depth)
    return DepthBatch(depth, images.depth_m.numpy(), images.object_id.numpy())


def _camera(config: DepthConfig) -> kernels.Camera:
    intrinsics = pinhole(config.width_px, config.height_px, config.fov_deg)
    camera = kernels.Camera()
    camera.width = intrinsics.width
    camera.height = intrinsics.height
    camera.fx = intrinsics.fx
    camera.cx = intrinsics.cx
    camera.cy = intrinsics.cy
    camera.range = config.range_m
    return camera


def depth_to_metres(depth: np.ndarray) -> np.ndarray:
    """Return depth in metres of 16-bit centimetres, inf for no return, same shape, float32."""
    return np.where(depth == 0, np.inf, depth * CENTIMETRES).astype(np.float32)
