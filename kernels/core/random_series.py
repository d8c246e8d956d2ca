"""Random series with random access by frame, see `mmw.core.random_series`; each key has its own stream."""

import warp as wp

from mmw.kernels.core.compiler import AS_NUMPY

wp.set_module_options(AS_NUMPY)

TOP = wp.constant(31)
"""Levels of the tree, `mmw.core.random_series.DEPTH`."""

PART_LEVEL = wp.constant(64)
"""Level of the counter of the first millisecond of a frame; those of the tree are below it."""

MULTIPLIER_0 = wp.constant(wp.uint64(0xD2511F53))
MULTIPLIER_1 = wp.constant(wp.uint64(0xCD9E8D57))
"""Constants of Philox4x32's two multiplications."""

WEYL_0 = wp.constant(wp.uint32(0x9E3779B9))
WEYL_1 = wp.constant(wp.uint32(0xBB67AE85))
"""Increments of the two key words after every round of Philox."""


@wp.struct
class Process:
    """Standard deviations and weights by which a Markov series is drawn from coarse to fine."""

    weight: wp.array[wp.float64]
    """Weight of both ends in the mean of the middle of a span of 2^level frames, shape [TOP + 1]."""
    spread: wp.array[wp.float64]
    """Standard deviation of the middle about that mean, shape [TOP + 1]."""
    first: wp.float64
    """Standard deviation of the value at frame 0."""
    last: wp.float64
    """Standard deviation of the value at frame 2^TOP about `carry` times the first."""
    carry: wp.float64
    """See `last`."""
    step: wp.array2d[wp.float64]
    """Weights of the value before and of the frame's end, and spread, of each millisecond of a frame, shape [10, 3]."""


@wp.func
def philox(key: wp.vec2ui, counter: wp.vec4ui) -> wp.vec4ui:
    """Return four independent 32-bit words of a key and counter.

    Source: Philox4x32-10, J. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3" (2011).
    """
    c0 = counter[0]
    c1 = counter[1]
    c2 = counter[2]
    c3 = counter[3]
    k0 = key[0]
    k1 = key[1]
    for _ in range(10):
        one = MULTIPLIER_0 * wp.uint64(c0)
        two = MULTIPLIER_1 * wp.uint64(c2)
        c0 = wp.uint32(two >> wp.uint64(32)) ^ c1 ^ k0
        c1 = wp.uint32(two)
        c2 = wp.uint32(one >> wp.uint64(32)) ^ c3 ^ k1
        c3 = wp.uint32(one)
        k0 = k0 + WEYL_0
        k1 = k1 + WEYL_1
    return wp.vec4ui(c0, c1, c2, c3)


@wp.func
def cell_center(word: wp.uint32) -> wp.float64:
    """Return the center of one of 2^32 cells of (0, 1): never zero, for the logarithm."""
    return (wp.float64(word) + wp.float64(0.5)) * wp.float64(2.3283064365386963e-10)


@wp.func
def normal4(key: wp.vec2ui, item: int, draw: int, level: int) -> wp.vec4d:
    """Return four independent standard normal numbers.

    Source: G. Box and M. Muller, "A note on the generation of random normal deviates" (1958).
    """
    bits = philox(key, wp.vec4ui(wp.uint32(item), wp.uint32(draw), wp.uint32(level), wp.uint32(0)))
    radius = wp.sqrt(wp.float64(-2.0) * wp.log(cell_center(bits[0])))
    angle = wp.float64(6.283185307179586) * cell_center(bits[1])
    radius_2 = wp.sqrt(wp.float64(-2.0) * wp.log(cell_center(bits[2])))
    angle_2 = wp.float64(6.283185307179586) * cell_center(bits[3])
    return wp.vec4d(
        radius * wp.cos(angle), radius * wp.sin(angle), radius_2 * wp.cos(angle_2), radius_2 * wp.sin(angle_2)
    )


@wp.func
def white4(key: wp.vec2ui, frame: int, part: int, draw: int) -> wp.vec4d:
    """Return four numbers of a white series at an instant: a frame of 100 Hz and milliseconds since then."""
    return normal4(key, frame, draw, wp.where(part > 0, PART_LEVEL + part, 0))


@wp.func
def value_at(
    key: wp.vec2ui, frame: int, before: int, draw: int, process: Process, ends: wp.array3d[wp.vec4d], row: int
) -> wp.vec4d:
    """Return four numbers of a Markov series at a frame.

    The values at both ends of each span that contains the frame are kept: the next frame begins at the smallest span
    that contains both.

    Args:
        key: Key of the stream.
        frame: The frame.
        before: Frame of the last call with this key and draw, -1 for none.
        draw: Which four numbers.
        process: The series.
        ends: Ends of the spans of 2^level frames around the last frame, shape [rows, TOP + 1, 2].
        row: Row of `ends`.
    """
    depth = wp.int32(0)
    if before < 0:
        depth = TOP
        first = process.first * normal4(key, 0, draw, TOP + 1)
        ends[row, TOP, 0] = first
        ends[row, TOP, 1] = process.carry * first + process.last * normal4(key, 1, draw, TOP + 1)
    else:
        while (frame >> depth) != (before >> depth):
            depth += 1
    left = ends[row, depth, 0]
    right = ends[row, depth, 1]
    while depth > 0:
        drawn = normal4(key, frame >> depth, draw, depth)
        middle = process.weight[depth] * (left + right) + process.spread[depth] * drawn
        depth -= 1
        if ((frame >> depth) & 1) == 1:
            left = middle
        else:
            right = middle
        ends[row, depth, 0] = left
        ends[row, depth, 1] = right
    return left


@wp.kernel
def philox_kernel(
    key: wp.array[wp.vec2ui],
    counter: wp.array[wp.vec4ui],
    # out
    words_out: wp.array[wp.vec4ui],
):
    """Draw words.

    Launch: dim=(words)

    Args:
        key: Key of each draw, or a single one for all, shape [N] or [1].
        counter: Counters, shape [N].
        words_out: Words, shape [N].
    """
    row = wp.tid()
    words_out[row] = philox(key[wp.where(key.shape[0] > 1, row, 0)], counter[row])


@wp.kernel
def white_kernel(
    key: wp.array[wp.vec2ui],
    frame: wp.array[int],
    part: wp.array[int],
    # out
    values_out: wp.array3d[wp.vec4d],
):
    """Draw white series at instants.

    Launch: dim=(keys, instants, draws)

    Args:
        key: Keys of the streams, shape [A].
        frame: Frames of 100 Hz, shape [F].
        part: Milliseconds since then, shape [F].
        values_out: Numbers, shape [A, F, draws].
    """
    stream, index, draw = wp.tid()
    values_out[stream, index, draw] = white4(key[stream], frame[index], part[index], draw)


@wp.kernel
def markov_kernel(
    key: wp.array[wp.vec2ui],
    frame: wp.array[int],
    part: wp.array[int],
    process: Process,
    # out
    ends_out: wp.array3d[wp.vec4d],
    values_out: wp.array3d[wp.vec4d],
):
    """Draw a Markov series at instants.

    Launch: dim=(keys, draws)

    Args:
        key: Keys of the streams, shape [A].
        frame: Frames of 100 Hz; few spans are drawn where neighbors follow each other, shape [F].
        part: Milliseconds since then, shape [F].
        process: The series.
        ends_out: Scratch, shape [A x draws, TOP + 1, 2].
        values_out: Numbers, shape [A, F, draws].
    """
    stream, draw = wp.tid()
    row = stream * values_out.shape[2] + draw
    before = wp.int32(-1)
    for index in range(frame.shape[0]):
        base = frame[index]
        value = value_at(key[stream], base, before, draw, process, ends_out, row)
        before = base
        if part[index] > 0:  # between two known values it is drawn from the left
            end = value_at(key[stream], base + 1, before, draw, process, ends_out, row)
            before = base + 1
            for k in range(1, part[index] + 1):
                drawn = white4(key[stream], base, k, draw)
                value = process.step[k, 0] * value + process.step[k, 1] * end + process.step[k, 2] * drawn
        values_out[stream, index, draw] = value
