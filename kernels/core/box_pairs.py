"""Overlapping boxes among candidates that are next to each other in a sorted list."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.kernel
def pairs_kernel(
    low_a: wp.array2d[wp.float64],
    high_a: wp.array2d[wp.float64],
    low_b: wp.array2d[wp.float64],
    high_b: wp.array2d[wp.float64],
    order_b: wp.array[int],
    span: wp.array2d[int],
    first: int,
    is_filling: bool,
    # out
    offset_out: wp.array[int],
    a_out: wp.array[int],
    b_out: wp.array[int],
):
    """Compare box a = `first` + thread with the boxes `order_b[span[a, 0] : span[a, 1]]`; touching boxes overlap.

    Not filling, the number of overlaps goes to `offset_out`; filling, every overlap is written from there on. Launch:
    dim=boxes of set a, first to count and then to fill.
    """
    row = wp.tid()
    a = first + row
    count = wp.int32(0)
    at = wp.int32(0)
    if is_filling:
        at = offset_out[row]
    for k in range(span[a, 0], span[a, 1]):
        b = order_b[k]
        overlaps = wp.bool(True)
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
