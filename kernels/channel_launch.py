"""Shooting: which surfaces can a transmitter see? The candidates of the image method."""

import warp as wp

from mmw.kernels.geometry import fibonacci_direction
from mmw.kernels.structs import MISS_ID, Scene
from mmw.kernels.trace import TRACE_REGISTERS, nearest_surface

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def launch_kernel(
    scene: Scene,
    slot: wp.array[int],
    origin: wp.array[wp.vec3],
    ray_count: int,
    stride: int,
    row_count: int,
    # out
    is_seen_out: wp.array2d[wp.uint8],
):
    """Mark every surface that a launched ray meets first. All writers write 1, so their order does not matter.

    Rays whose numbers differ by `stride`, a Fibonacci number, are neighbours on the sphere: threads take them one after
    the other, so that a block's rays stay together.

    Launch: dim=(A, row_count * stride), block_dim=64; A transmitters, one a slot and actor, and row_count * stride at
    least the number of rays. `is_seen_out` starts as zeros, shape [A, G].
    """
    source, thread = wp.tid()
    ray = (thread % row_count) * stride + thread // row_count
    if ray >= ray_count:
        return
    direction = fibonacci_direction(ray, ray_count)
    near = nearest_surface(scene, slot[source], origin[source], direction, wp.inf, MISS_ID)
    if near.face >= 0:
        surface = wp.int32(0)
        if near.instance < 0:
            surface = scene.town_surface[near.face]
        else:
            face = scene.instance_face_offset[near.instance] + near.face
            surface = scene.instance_surface_offset[near.instance] + scene.model_surface[face]
        is_seen_out[source, surface] = wp.uint8(1)
