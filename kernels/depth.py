"""Depth camera: distance along the optical axis of a pinhole camera, and the object in every pixel."""

import warp as wp

from mmw.kernels.camera import Camera, through_point, tile_column, tile_row
from mmw.kernels.structs import Scene, Views
from mmw.kernels.trace import TRACE_REGISTERS, nearest_surface, object_of

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

MOST_CENTIMETRES = wp.constant(65535.0)
"""Largest depth that the 16-bit image tells [cm]."""


@wp.struct
class DepthImages:
    """Images of all views, shape [A, H, W]; the last two may be empty and are then left out."""

    depth: wp.array3d[wp.uint16]
    """Depth along the optical axis [cm], 0 for no return within 655.35 m."""
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
    view, down, across, lane = wp.tid()
    v = tile_row(down, lane)
    u = tile_column(across, lane)
    if u >= camera.width or v >= camera.height:
        return
    pose = views.pose[view]
    through = through_point(camera, float(u) + 0.5, float(v) + 0.5)
    stretch = wp.length(through)
    direction = wp.transform_vector(pose, through / stretch)
    origin = wp.transform_get_translation(pose)
    near = nearest_surface(scene, views.slot[view], origin, direction, camera.range * stretch, views.ignore[view])
    depth = near.t / stretch
    centimetres = wp.rint(depth * 100.0)
    if near.face < 0 or centimetres > MOST_CENTIMETRES:
        centimetres = 0.0
    else:
        # 0 means no return, so the nearest depth that can be told is 1 cm.
        centimetres = wp.max(centimetres, 1.0)
    images_out.depth[view, v, u] = wp.uint16(int(centimetres))
    if images_out.depth_m.shape[0] > 0:
        images_out.depth_m[view, v, u] = depth
    if images_out.object_id.shape[0] > 0:
        images_out.object_id[view, v, u] = object_of(scene, near)
