"""Pinhole cameras: what every camera kernel shares, the tiles of pixels and the ray through a pixel."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

TILE = wp.constant(8)
"""Pixels on a side of the square that one block of 64 threads traces: neighbours walk the same branches of the tree."""


@wp.struct
class Camera:
    """A pinhole camera; pixel (u, v) has its centre at (u + 0.5, v + 0.5)."""

    width: int
    height: int
    fx: float
    """Focal length [px]."""
    cx: float
    """Column of the optical axis [px]."""
    cy: float
    """Row of the optical axis [px]."""
    range: float
    """Longest depth [m]."""


@wp.func
def through_point(camera: Camera, u: float, v: float) -> wp.vec3:
    """Return the direction through a point of the image, sensor frame, scaled so that x (the optical axis) is 1.

    Its length is ray length over depth.

    Args:
        camera: The camera.
        u: Column [px], pixel edges at whole numbers.
        v: Row [px], pixel edges at whole numbers.
    """
    return wp.vec3(1.0, (camera.cx - u) / camera.fx, (camera.cy - v) / camera.fx)


@wp.func
def tile_column(tile: int, lane: int) -> int:
    """Return the column of the pixel that a lane of a tile's block traces; it may lie outside the image."""
    return tile * TILE + lane % TILE


@wp.func
def tile_row(tile: int, lane: int) -> int:
    """Return the row of the pixel that a lane of a tile's block traces; it may lie outside the image."""
    return tile * TILE + lane // TILE
