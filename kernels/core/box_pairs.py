"""Overlapping boxes among the candidates that share a cell of a grid."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.kernel
def pairs_kernel(
    low_a: wp.array2d[wp.float64],
    high_a: wp.array2d[wp.float64],
    low_b: wp.array2d[wp.float64],
    high_b: wp.array2d[wp.float64],
    cell: wp.array[wp.float64],
    box_a: wp.array[int],
    cell_a: wp.array2d[int],
    box_b: wp.array[int],
    span: wp.array2d[int],
    is_filling: bool,
    # out
    offset_out: wp.array[int],
    row_out: wp.array[int],
    other_out: wp.array[int],
):
    """Compare box `box_a[row]` with the boxes `box_b[span[row, 0] : span[row, 1]]`; touching boxes overlap.

    A pair counts only in the cell `cell_a[row]` that holds the lowest corner of what the two have in common: once.
    Not filling, the number of overlaps goes to `offset_out[row]`; filling, every overlap is written from
    `offset_out[row]` on, as the row and the box of set b. Launch: dim=rows, first to count and then to fill.
    """
    row = wp.tid()
    a = box_a[row]
    count = wp.int32(0)
    at = wp.int32(0)
    if is_filling:
        at = offset_out[row]
    for k in range(span[row, 0], span[row, 1]):
        b = box_b[k]
        overlaps = wp.bool(True)
        axis = wp.int32(0)
        while overlaps and axis < low_a.shape[1]:
            overlaps = low_a[a, axis] <= high_b[b, axis] and low_b[b, axis] <= high_a[a, axis]
            if overlaps:
                lowest = wp.max(low_a[a, axis], low_b[b, axis])
                overlaps = wp.int32(wp.floor(lowest / cell[axis])) == cell_a[row, axis]
            axis = axis + 1
        if overlaps:
            if is_filling:
                row_out[at + count] = row
                other_out[at + count] = b
            count = count + 1
    if not is_filling:
        offset_out[row] = count
