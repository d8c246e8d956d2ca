"""Single rays on one mesh, given one by one: for checks of a town, and for the height of the road under a wheel."""

import warp as wp

from mmw.kernels.core.bvh import Tree
from mmw.kernels.core.trace import nearest_in_tree

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.kernel
def rays_kernel(
    tree: Tree,
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    t_max: float,
    # out
    t_out: wp.array[float],
    face_out: wp.array[int],
):
    """Write the distance [m] and the face of what every ray hits first, inf and -1 where it hits nothing.

    Launch: dim=(R,), block_dim=64.
    """
    ray = wp.tid()
    near = nearest_in_tree(tree, 0, origin[ray], direction[ray], t_max)
    t_out[ray] = wp.where(near.face >= 0, near.t, wp.inf)
    face_out[ray] = near.face
