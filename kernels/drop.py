"""Wheel drops: how high the drivable surface is under a point."""

import warp as wp

from mmw.kernels.trace import closest_mesh_hit

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.kernel
def drop_kernel(
    mesh: wp.uint64,
    origin: wp.array[wp.vec3],
    t_max: float,
    # out
    fall_out: wp.array[float],
):
    """Write how far every point falls before it meets the mesh [m], inf where it meets nothing.

    Launch: dim=(R,), block_dim=64.
    """
    ray = wp.tid()
    fall_out[ray] = closest_mesh_hit(mesh, origin[ray], wp.vec3(0.0, 0.0, -1.0), t_max).t
