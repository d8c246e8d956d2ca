"""Depth camera: distance along the optical axis of a pinhole camera, in 16-bit centimetres."""

import warp as wp

from mmw.kernels.structs import Scene, Views
from mmw.kernels.trace import TRACE_REGISTERS, nearest_surface, object_of

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


@wp.struct
class DepthImages:
    """Images of all views, shape [A, H, W]; the last two may be empty and are then left out."""

    depth: wp.array3d[wp.uint16]
    """Depth along the optical axis [cm], 0 for no return."""
    depth_m: wp.array3d[float]
    """The same before rounding [m], inf for no return."""
    object_id: wp.array3d[int]
    """Object in the pixel, -1 for none."""


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def depth_kernel(
    scene: Scene,
    views: Views,
    camera: Camera,
    # out
    images_out: DepthImages,
):
    """Trace one ray through the centre of every pixel.

    Launch: dim=(A, ceil(H / 8), ceil(W / 8), 64), block_dim=64.
    """
    view, tile_row, tile_column, lane = wp.tid()
    v = tile_row * TILE + lane // TILE
    u = tile_column * TILE + lane % TILE
    if u >= camera.width or v >= camera.height:
        return
    pose = views.pose[view]
    # x is 1 along the optical axis, so the length of this vector is ray length over depth.
    through = wp.vec3(1.0, (camera.cx - float(u) - 0.5) / camera.fx, (camera.cy - float(v) - 0.5) / camera.fx)
    stretch = wp.length(through)
    direction = wp.transform_vector(pose, through / stretch)
    origin = wp.transform_get_translation(pose)
    near = nearest_surface(scene, views.slot[view], origin, direction, camera.range * stretch, views.ignore[view])
    depth = near.t / stretch
    centimetres = wp.uint16(0)
    if near.face >= 0:
        # 0 means no return, so the nearest depth that can be told is 1 cm.
        centimetres = wp.uint16(int(wp.clamp(wp.rint(depth * 100.0), 1.0, 65535.0)))
    images_out.depth[view, v, u] = centimetres
    if images_out.object_id.shape[0] > 0:
        images_out.object_id[view, v, u] = object_of(scene, near)
        images_out.depth_m[view, v, u] = depth
