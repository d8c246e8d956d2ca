"""Share parts of camera sensors: intrinsics on the device, and the launch of one thread a pixel."""

import warp as wp

from mmw.core.camera_models import MODELS, Intrinsics
from mmw.core.remember import remembered
from mmw.kernels.camera import camera as kernels

TILE = 8
"""Pixels on a side of a block's square."""

BLOCK_DIM = TILE * TILE
"""Threads of a block: one a pixel of its square."""


@remembered()
def device_camera(intrinsics: Intrinsics, range_m: float) -> kernels.Camera:
    """Return a camera as kernels take it.

    Raises:
        InputError: If the lens is not one to one in the image.
    """
    lens = intrinsics.distortion
    camera = kernels.Camera()
    camera.width = intrinsics.width
    camera.height = intrinsics.height
    camera.fx = intrinsics.fx
    camera.fy = intrinsics.fy
    camera.cx = intrinsics.cx
    camera.cy = intrinsics.cy
    camera.range = range_m
    camera.model = MODELS.index(lens.model)
    camera.radial = wp.vec4(*lens.radial)
    camera.rational = wp.vec3(*lens.rational)
    camera.tangential = wp.vec2(*lens.tangential)
    camera.reach = intrinsics.reach()
    return camera


def tiles(views: int, intrinsics: Intrinsics) -> tuple[int, int, int, int]:
    """Return the launch of one thread a pixel, in blocks of `BLOCK_DIM`: (views, tile rows, tile columns, lanes)."""
    return (views, -(-intrinsics.height // TILE), -(-intrinsics.width // TILE), BLOCK_DIM)
