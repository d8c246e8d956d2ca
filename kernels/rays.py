"""Single rays on one mesh, given one by one: what a check of a town asks."""

import warp as wp

from mmw.kernels.trace import closest_mesh_hit

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.kernel
def rays_kernel(
    mesh: wp.uint64,
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    t_max: float,
    # out
    t_out: wp.array[float],
    face_out: wp.array[int],
):
    """Write the distance [m] and the face of what every ray meets first, inf and -1 where it meets nothing.

    Launch: dim=(R,), block_dim=64.
    """
    ray = wp.tid()
    hit = closest_mesh_hit(mesh, origin[ray], direction[ray], t_max)
    t_out[ray] = hit.t
    face_out[ray] = hit.face
