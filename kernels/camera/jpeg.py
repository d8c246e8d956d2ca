"""Write baseline JPEG files of many images: colors, the integer cosine transform, Huffman codes, stuffed bytes.

Every number is an integer and rounded as libjpeg-turbo does, so that the files are those of the library, byte for byte.

Sources: ITU-T T.81 (coding); JFIF 1.02 (colors).
"""

import warp as wp

from mmw.kernels.camera.dct import Eight, accurate_columns, accurate_rows, fast_cosines

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False, "max_unroll": 8})

END_OF_BLOCK = wp.constant(0)
"""Symbol: only zeros follow. Source: ITU-T T.81, F.1.2.2.1, as is the next."""

SIXTEEN_ZEROS = wp.constant(240)
"""Symbol: sixteen zeros, and more behind them."""


@wp.struct
class Layout:
    """Layout of an image, one of equal ones, in blocks of 8 x 8 values."""

    width: int
    height: int
    step: int
    """Pixels of a color's value on each axis, 1 or 2; lightness has one a pixel."""
    columns: int
    """Units, of all blocks that show the same pixels, side by side."""
    blocks: int
    """Blocks of an image in the file's order: unit by unit its lightness, row by row, then both colors."""


@wp.func
def unit_blocks(layout: Layout) -> int:
    """Return the blocks of a unit: of lightness, and one of each color."""
    return layout.step * layout.step + 2


@wp.func
def channel_of(layout: Layout, block: int) -> int:
    """Return 0 for lightness, 1 and 2 for the colors."""
    return wp.max(block % unit_blocks(layout) - layout.step * layout.step + 1, 0)


@wp.func
def corner_of(layout: Layout, block: int) -> wp.vec2i:
    """Return column and row of a block's first value in the grid of its channel."""
    unit = block // unit_blocks(layout)
    column = unit % layout.columns
    row = unit // layout.columns
    if channel_of(layout, block) == 0:
        k = block % unit_blocks(layout)
        column = column * layout.step + k % layout.step
        row = row * layout.step + k // layout.step
    return wp.vec2i(8 * column, 8 * row)


@wp.func
def is_outside(layout: Layout, block: int) -> bool:
    """Return whether a block of an image is one of lightness beyond its edge, which only fills its unit."""
    corner = corner_of(layout, block)
    return channel_of(layout, block) == 0 and (corner[0] >= layout.width or corner[1] >= layout.height)


@wp.func
def pixel_value(images: wp.array4d[wp.uint8], view: int, v: int, u: int, channel: int) -> int:
    """Return lightness or a color of a pixel, 0 to 255; beyond the edge it goes on.

    Factors of JFIF with 16 bits behind the point; what is added rounds, and moves colors by 128.
    """
    row = wp.min(v, images.shape[1] - 1)
    column = wp.min(u, images.shape[2] - 1)
    red = int(images[view, row, column, 0])
    green = int(images[view, row, column, 1])
    blue = int(images[view, row, column, 2])
    if channel == 0:
        return (19595 * red + 38470 * green + 7471 * blue + 32768) >> 16
    if channel == 1:
        return (-11059 * red - 21709 * green + 32768 * blue + 8421375) >> 16
    return (32768 * red - 27439 * green - 5329 * blue + 8421375) >> 16


@wp.func
def channel_value(images: wp.array4d[wp.uint8], view: int, y: int, x: int, step: int, channel: int) -> int:
    """Return a value of a channel at (x, y) of its own grid: the mean of 2 x 2 pixels where `step` is 2."""
    if step == 1:
        return pixel_value(images, view, y, x, channel)
    row = 2 * wp.min(y, (images.shape[1] - 1) // 2)
    total = pixel_value(images, view, row, 2 * x, channel) + pixel_value(images, view, row, 2 * x + 1, channel)
    total += pixel_value(images, view, row + 1, 2 * x, channel) + pixel_value(images, view, row + 1, 2 * x + 1, channel)
    return (total + 1 + (x & 1)) >> 2  # halves go down and up in turn


@wp.kernel
def rows_kernel(
    images: wp.array4d[wp.uint8],
    layout: Layout,
    is_fast: bool,
    # out
    rows_out: wp.array2d[wp.int16],
):
    """Transform every row of every block; `rows_out` has shape [A x blocks, 64].

    Launch: dim=(A, blocks, 8).
    """
    view, block, row = wp.tid()
    channel = channel_of(layout, block)
    corner = corner_of(layout, block)
    step = wp.where(channel == 0, 1, layout.step)
    values = Eight()
    for i in range(8):
        values[i] = channel_value(images, view, corner[1] + row, corner[0] + i, step, channel) - 128
    if is_fast:
        values = fast_cosines(values)
    else:
        values = accurate_rows(values)
    for i in range(8):
        rows_out[view * layout.blocks + block, row * 8 + i] = wp.int16(values[i])


@wp.kernel
def columns_kernel(
    rows: wp.array2d[wp.int16],
    layout: Layout,
    is_fast: bool,
    divisors: wp.array2d[int],
    place: wp.array[int],
    # out
    values_out: wp.array2d[wp.int16],
):
    """Transform every column of every block, divide to the nearest step of the quality, and store in the file's order.

    `divisors` has shape [2, 64], of lightness and colors by place in the block: steps times what the transform makes
    values too large by. `place` [64] says where in the file's zigzag a place of the block comes.

    Launch: dim=(A x blocks, 8).
    """
    block, column = wp.tid()
    values = Eight()
    for i in range(8):
        values[i] = int(rows[block, i * 8 + column])
    if is_fast:
        values = fast_cosines(values)
    else:
        values = accurate_columns(values)
    kind = wp.min(channel_of(layout, block % layout.blocks), 1)
    for i in range(8):
        divisor = divisors[kind, i * 8 + column]
        size = (wp.abs(values[i]) + divisor // 2) // divisor
        values_out[block, place[i * 8 + column]] = wp.int16(wp.where(values[i] < 0, -size, size))


@wp.func
def bit_length(value: int) -> int:
    """Return the bits of a number's size."""
    rest = wp.abs(value)
    count = wp.int32(0)
    while rest > 0:
        rest = rest >> 1
        count += 1
    return count


@wp.func
def put(words: wp.array[wp.uint32], first: int, at: int, bits: wp.uint32, count: int):
    """Write some bits behind bit `at` of the words from `first` on; the first bit of a word is its highest."""
    word = first + at // 32
    left = 32 - at % 32 - count
    if left >= 0:
        wp.atomic_or(words, word, bits << wp.uint32(left))
    else:
        wp.atomic_or(words, word, bits >> wp.uint32(-left))
        wp.atomic_or(words, word + 1, bits << wp.uint32(32 + left))


@wp.func
def code(
    codes: wp.array2d[wp.uint32], table: int, symbol: int, value: int, length: int,
    words: wp.array[wp.uint32], first: int, at: int, is_written: bool,
) -> int:  # fmt: skip
    """Write the code of a symbol and `length` bits of a value behind it; return where the next one begins."""
    entry = codes[table, symbol]
    count = int(entry >> wp.uint32(16)) + length
    if is_written:
        low = wp.uint32(wp.where(value < 0, value + (1 << length) - 1, value))  # one less than a negative number's bits
        put(words, first, at, ((entry & wp.uint32(65535)) << wp.uint32(length)) | low, count)
    return at + count


@wp.func
def code_block(
    values: wp.array2d[wp.int16], layout: Layout, codes: wp.array2d[wp.uint32], block: int,
    words: wp.array[wp.uint32], first: int, begin: int, is_written: bool,
) -> int:  # fmt: skip
    """Write the bits of a block, or only count them; return where the next block begins."""
    own = block % layout.blocks
    kind = wp.min(channel_of(layout, own), 1)
    table = 2 * kind
    if is_outside(layout, own):  # as the block before it, with nothing but its mean
        at = code(codes, table, 0, 0, 0, words, first, begin, is_written)
        return code(codes, table + 1, END_OF_BLOCK, 0, 0, words, first, at, is_written)
    before = own - unit_blocks(layout)
    if kind == 0:
        before = own - 1
        if own % unit_blocks(layout) == 0:
            before = own - 3  # lightness ends its unit before both colors
        while before >= 0 and is_outside(layout, before):
            before -= 1
    mean = int(values[block, 0])
    if before >= 0:
        mean -= int(values[block - own + before, 0])
    length = bit_length(mean)
    at = code(codes, table, length, mean, length, words, first, begin, is_written)
    zeros = wp.int32(0)
    for i in range(1, 64):
        value = int(values[block, i])
        if value == 0:
            zeros += 1
        else:
            while zeros > 15:
                at = code(codes, table + 1, SIXTEEN_ZEROS, 0, 0, words, first, at, is_written)
                zeros -= 16
            length = bit_length(value)
            at = code(codes, table + 1, zeros * 16 + length, value, length, words, first, at, is_written)
            zeros = wp.int32(0)
    if zeros > 0:
        at = code(codes, table + 1, END_OF_BLOCK, 0, 0, words, first, at, is_written)
    return at


@wp.kernel
def count_bits_kernel(
    values: wp.array2d[wp.int16],
    layout: Layout,
    codes: wp.array2d[wp.uint32],
    nowhere: wp.array[wp.uint32],
    # out
    bits_out: wp.array[wp.int64],
):
    """Count the bits of every block; `nowhere` is empty. Launch: dim=A x blocks."""
    block = wp.tid()
    bits_out[block] = wp.int64(code_block(values, layout, codes, block, nowhere, 0, 0, False))


@wp.func
def sum_before(up_to: wp.array[int], k: int) -> int:
    """Return the sum of all numbers before number k, where `up_to` has the sums up to each."""
    if k == 0:
        return 0
    return up_to[k - 1]


@wp.func
def bits_between(bits_up_to: wp.array[wp.int64], begin: int, end: int) -> int:
    """Return the bits of the blocks from `begin` up to `end`; `bits_up_to` has the sums up to each."""
    before = wp.int64(0)
    if begin > 0:
        before = bits_up_to[begin - 1]
    if end == begin:
        return 0
    return int(bits_up_to[end - 1] - before)


@wp.kernel
def count_words_kernel(
    bits_up_to: wp.array[wp.int64],
    layout: Layout,
    # out
    words_out: wp.array[int],
):
    """Count the words of 32 bits that every image fills; `bits_up_to` is summed over blocks. Launch: dim=A."""
    view = wp.tid()
    first = view * layout.blocks
    words_out[view] = (bits_between(bits_up_to, first, first + layout.blocks) + 31) // 32


@wp.kernel
def write_bits_kernel(
    values: wp.array2d[wp.int16],
    layout: Layout,
    codes: wp.array2d[wp.uint32],
    bits_up_to: wp.array[wp.int64],
    words_up_to: wp.array[int],
    # out
    words_out: wp.array[wp.uint32],
):
    """Write the bits of every block, and ones behind the last of an image up to a whole byte; words come in as 0.

    Nothing is written where there is no room for all words.

    Launch: dim=A x blocks.
    """
    block = wp.tid()
    if words_up_to[words_up_to.shape[0] - 1] > words_out.shape[0]:
        return
    view = block // layout.blocks
    begin = bits_between(bits_up_to, view * layout.blocks, block)
    first = sum_before(words_up_to, view)
    end = code_block(values, layout, codes, block, words_out, first, begin, True)
    if block % layout.blocks == layout.blocks - 1 and end % 8 > 0:
        rest = 8 - end % 8
        put(words_out, first, end, wp.uint32((1 << rest) - 1), rest)


@wp.kernel
def count_full_kernel(
    words: wp.array[wp.uint32],
    # out
    full_out: wp.array[int],
):
    """Count the bytes of every word that are 255: a file has a 0 behind each. Launch: dim=room for words."""
    k = wp.tid()
    count = wp.int32(0)
    for i in range(4):
        if ((words[k] >> wp.uint32(8 * i)) & wp.uint32(255)) == wp.uint32(255):
            count += 1
    full_out[k] = count


@wp.kernel
def write_bytes_kernel(
    words: wp.array[wp.uint32],
    full_up_to: wp.array[int],
    # out
    bytes_out: wp.array[wp.uint8],
):
    """Write the bytes of every word, the highest first, and a 0 behind each 255. Launch: dim=room for words."""
    k = wp.tid()
    at = 4 * k + sum_before(full_up_to, k)
    for i in range(4):
        byte = (words[k] >> wp.uint32(24 - 8 * i)) & wp.uint32(255)
        bytes_out[at] = wp.uint8(byte)
        at += 1
        if byte == wp.uint32(255):
            bytes_out[at] = wp.uint8(0)
            at += 1


@wp.kernel
def spans_kernel(
    bits_up_to: wp.array[wp.int64],
    words_up_to: wp.array[int],
    full_up_to: wp.array[int],
    layout: Layout,
    # out
    spans_out: wp.array2d[int],
):
    """Find the first byte of every image and the one behind its last, shape [A, 2]; 0 where words have no room.

    Launch: dim=A.
    """
    view = wp.tid()
    spans_out[view, 0] = 0
    spans_out[view, 1] = 0
    if words_up_to[words_up_to.shape[0] - 1] > full_up_to.shape[0]:
        return
    word = sum_before(words_up_to, view)
    first = view * layout.blocks
    bits = bits_between(bits_up_to, first, first + layout.blocks)
    spans_out[view, 0] = 4 * word + sum_before(full_up_to, word)
    spans_out[view, 1] = 4 * word + (bits + 7) // 8 + full_up_to[words_up_to[view] - 1]
