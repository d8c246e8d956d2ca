"""Sort rows on the host by several keys at once."""

import warp as wp


@wp.func
def is_before(keys: wp.array2d[wp.float64], row: int, other: int) -> bool:
    """Return whether a row's keys come before those of another one, the first key first."""
    column = wp.int32(0)
    while column < keys.shape[1] and keys[row, column] == keys[other, column]:
        column = column + 1
    return column < keys.shape[1] and keys[row, column] < keys[other, column]


@wp.func
def sort_rows(
    keys: wp.array2d[wp.float64], count: int,
    # in and out
    order: wp.array[int],
    # scratch
    spare: wp.array[int],
):  # fmt: skip
    """Sort the first `count` entries of `order`, rows of `keys`; equal ones keep their order, as in `np.lexsort`.

    Parts that are in order already are not touched. `spare` is as long as `order`. Source: merge sort from short runs
    to long ones, Knuth, TAOCP 3, section 5.2.4.
    """
    width = wp.int32(1)
    while width < count:
        begin = wp.int32(0)
        while begin + width < count:
            middle = begin + width
            end = wp.min(middle + width, count)
            if is_before(keys, order[middle], order[middle - 1]):
                left = begin
                right = middle
                for place in range(begin, end):
                    is_right = left >= middle
                    if left < middle and right < end:
                        is_right = is_before(keys, order[right], order[left])
                    if is_right:
                        spare[place] = order[right]
                        right = right + 1
                    else:
                        spare[place] = order[left]
                        left = left + 1
                for place in range(begin, end):
                    order[place] = spare[place]
            begin = end
        width = 2 * width
