"""Test line of sight between point pairs and count surface crossings along rays."""

import warp as wp

from mmw.kernels.core.structs import MISS_ID, Scene
from mmw.kernels.core.trace import closest_hit_raw, object_of

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


MAX_CROSSINGS = wp.constant(64)
"""Surfaces that are counted on one ray."""
CLEARANCE = wp.constant(1.0e-4)
"""Distance behind a surface from which the next one is searched [m]."""


@wp.kernel
def line_of_sight_kernel(
    scene: Scene,
    batch_index: wp.array[int],
    origin: wp.array[wp.vec3],
    target: wp.array[wp.vec3],
    ignore: wp.array[int],
    # out
    object_out: wp.array[int],
):
    """Write the first object on the line from `origin` to `target`, -1 for a free line of sight.

    Launch: dim=(N,), block_dim=64.
    """
    line = wp.tid()
    span = target[line] - origin[line]
    distance = wp.length(span)
    object_out[line] = MISS_ID
    if distance > 0.0:
        near = closest_hit_raw(scene, batch_index[line], origin[line], span / distance, distance, ignore[line])
        object_out[line] = object_of(scene, near)


@wp.kernel
def count_hits_kernel(
    scene: Scene,
    batch_index: wp.array[int],
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    t_max: float,
    # out
    count_out: wp.array2d[int],
    object_out: wp.array2d[int],
):
    """Count the surfaces on each ray, up to `MAX_CROSSINGS`, and write the object of the first, -1 for none.

    Of S threads one works, see `mmw.core.device.thread_spread`. Launch: dim=(N, K, S), block_dim=64.
    """
    point, ray, lane = wp.tid()
    if lane > 0:
        return
    start = origin[point]
    count = wp.int32(0)
    first = wp.int32(MISS_ID)
    is_on = wp.bool(True)
    while is_on and count < MAX_CROSSINGS:
        near = closest_hit_raw(scene, batch_index[point], start, direction[ray], t_max, MISS_ID)
        is_on = near.face >= 0
        if is_on:
            if count == 0:
                first = object_of(scene, near)
            count += 1
            start += direction[ray] * (near.t + CLEARANCE)
    count_out[point, ray] = count
    object_out[point, ray] = first
