"""What every camera sensor shares: its intrinsics on the device, and the launch of one thread a pixel."""

from mmw.kernels import camera as kernels
from mmw.patterns import Pinhole

TILE = 8
"""Pixels on a side of a block's square."""

BLOCK_DIM = TILE * TILE
"""Threads of a block: one a pixel of its square."""


def device_camera(intrinsics: Pinhole, range_m: float) -> kernels.Camera:
    """Return a pinhole camera as kernels take it.

    Args:
        intrinsics: Size and focal length.
        range_m: Longest depth [m].
    """
    camera = kernels.Camera()
    camera.width = intrinsics.width
    camera.height = intrinsics.height
    camera.fx = intrinsics.fx
    camera.cx = intrinsics.cx
    camera.cy = intrinsics.cy
    camera.range = range_m
    return camera


def tiles(views: int, intrinsics: Pinhole) -> tuple[int, int, int, int]:
    """Return the launch of one thread a pixel, in blocks of `BLOCK_DIM`: (views, tile rows, tile columns, lanes)."""
    return (views, -(-intrinsics.height // TILE), -(-intrinsics.width // TILE), BLOCK_DIM)
