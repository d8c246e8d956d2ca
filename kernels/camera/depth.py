"""Read the distance along the optical axis, and the object, of every pixel of a traced image."""

import warp as wp

from mmw.kernels.camera.camera import Camera, camera_ray, tile_column, tile_row
from mmw.kernels.camera.image_samples import sample_row
from mmw.kernels.camera.visibility import stored_hit
from mmw.kernels.core.structs import MISS_ID, Scene
from mmw.kernels.core.trace import object_of
from mmw.kernels.shading.structs import Samples

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

MAX_CENTIMETRES = wp.constant(65535.0)
"""Largest depth that the 16-bit image can store [cm]."""


@wp.struct
class DepthImages:
    """Images of all views, shape [A, H, W]; the last two may be empty and are then left out."""

    depth: wp.array3d[wp.uint16]
    """Depth along the optical axis [cm], 0 for no return within 655.35 m."""
    depth_m: wp.array3d[float]
    """The same before rounding [m], inf for no return."""
    object_id: wp.array3d[int]
    """Object in the pixel, -1 for none."""


@wp.kernel
def depth_kernel(
    scene: Scene,
    camera: Camera,
    samples: Samples,
    range: float,
    # out
    images_out: DepthImages,
):
    """Read depth and object of every pixel from what its center sees, as far as `range` [m] along the optical axis.

    Launch: dim=(A, ceil(H / 8), ceil(W / 8), 64), block_dim=64.
    """
    view, down, across, lane = wp.tid()
    v = tile_row(down, lane)
    u = tile_column(across, lane)
    if u >= camera.width or v >= camera.height:
        return
    near = stored_hit(samples, sample_row(camera, view, u, v))
    ray = camera_ray(camera, float(u) + 0.5, float(v) + 0.5)
    depth = near.t * ray[0]
    if depth > range:
        near.face = MISS_ID
        near.instance = MISS_ID
    centimetres = wp.rint(depth * 100.0)
    if near.face < 0 or centimetres > MAX_CENTIMETRES:
        centimetres = 0.0
    else:
        # 0 means no return, so the nearest depth that can be told is 1 cm.
        centimetres = wp.max(centimetres, 1.0)
    images_out.depth[view, v, u] = wp.uint16(int(centimetres))
    if images_out.depth_m.shape[0] > 0:
        images_out.depth_m[view, v, u] = wp.where(near.face < 0, wp.inf, depth)
    if images_out.object_id.shape[0] > 0:
        images_out.object_id[view, v, u] = object_of(scene, near)
