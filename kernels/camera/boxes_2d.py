"""Count the pixels that show each object, and find the smallest rectangle that holds them."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

STRIP = wp.constant(16)
"""Pixels, one below the other, that a thread reads: it adds a run of equal ones at once, so that atomics are few."""


@wp.func
def add_run(
    view: int,
    place: int,
    u: int,
    v_begin: int,
    v_end: int,
    pixels: wp.array2d[int],
    lower: wp.array3d[int],
    upper: wp.array3d[int],
):
    """Add the pixels [v_begin, v_end) of column u to the box of one object; nothing for place -1."""
    if place >= 0:
        wp.atomic_add(pixels, view, place, v_end - v_begin)
        wp.atomic_min(lower, view, place, 0, u)
        wp.atomic_min(lower, view, place, 1, v_begin)
        wp.atomic_max(upper, view, place, 0, u + 1)
        wp.atomic_max(upper, view, place, 1, v_end)


@wp.kernel
def visible_boxes_kernel(
    object_id: wp.array3d[int],
    place_of: wp.array[int],
    # out
    pixels_out: wp.array2d[int],
    lower_out: wp.array3d[int],
    upper_out: wp.array3d[int],
):
    """Count the pixels of every wanted object in every view and find their smallest rectangle (u, v) [px].

    `object_id` has shape [A, H, W], -1 for nothing; `place_of` maps an object to its place in the outputs, -1 for an
    object that is not wanted. The outputs, shapes [A, K], [A, K, 2] and [A, K, 2], come in as 0, more than any pixel,
    and 0. Sums and extremes of integers do not depend on the order of the threads.

    Launch: dim=(A, ceil(H / 16), W).
    """
    view, strip, u = wp.tid()
    v_end = wp.min((strip + 1) * STRIP, object_id.shape[1])
    v_begin = strip * STRIP
    place = wp.int32(-1)
    for v in range(strip * STRIP, v_end):
        found = object_id[view, v, u]
        here = wp.int32(-1)
        if found >= 0 and found < place_of.shape[0]:
            here = place_of[found]
        if here != place:
            add_run(view, place, u, v_begin, v, pixels_out, lower_out, upper_out)
            place = here
            v_begin = v
    add_run(view, place, u, v_begin, v_end, pixels_out, lower_out, upper_out)
