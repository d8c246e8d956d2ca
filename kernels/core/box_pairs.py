"""Pairs of boxes that overlap, found with a BVH of one of the two sets."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.kernel
def pairs_kernel(
    tree: wp.uint64,
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
    low_a: wp.array2d[wp.float64],
    high_a: wp.array2d[wp.float64],
    low_b: wp.array2d[wp.float64],
    high_b: wp.array2d[wp.float64],
    first: int,
    is_own: bool,
    is_filling: bool,
    # out
    offset_out: wp.array[int],
    a_out: wp.array[int],
    b_out: wp.array[int],
):
    """Compare box `first` + thread of set a with the boxes of set b in `tree`; touching boxes overlap.

    `lower` and `upper` enclose the boxes of set a in float32. Of one and the same set, a pair counts once, its lower
    number first. Not filling, the number of overlaps goes to `offset_out`; filling, every overlap is written from
    there on. Launch: dim=boxes of set a, first to count and then to fill.
    """
    row = wp.tid()
    a = first + row
    count = wp.int32(0)
    at = wp.int32(0)
    if is_filling:
        at = offset_out[row]
    query = wp.bvh_query_aabb(tree, lower[a], upper[a])
    b = wp.int32(0)
    while wp.bvh_query_next(query, b):
        overlaps = not is_own or a < b
        axis = wp.int32(0)
        while overlaps and axis < low_a.shape[1]:
            overlaps = low_a[a, axis] <= high_b[b, axis] and low_b[b, axis] <= high_a[a, axis]
            axis = axis + 1
        if overlaps:
            if is_filling:
                a_out[at + count] = a
                b_out[at + count] = b
            count = count + 1
    if not is_filling:
        offset_out[row] = count
