"""List the pairs that a kernel selects, of the many that it tests."""

import warp as wp


@wp.func
def select_pair(
    row: int, column: int,
    # out
    count_out: wp.array[int],
    pair_out: wp.array2d[int],
):  # fmt: skip
    """Add a pair to a list, in any order; `count_out` counts them all, also those that have no room."""
    place = wp.atomic_add(count_out, 0, 1)
    if place < pair_out.shape[0]:
        pair_out[place, 0] = row
        pair_out[place, 1] = column
