"""Random numbers as functions of (key, item, draw): no state, so they do not depend on batches, order or device."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.func
def random_bits(key: wp.vec2ui, item: int, draw: int) -> wp.vec4ui:
    """Return four independent 32-bit words.

    Args:
        key: Stream, from `mmw.core.random_keys`: object, place and time.
        item: Which ray, point or cell of the stream.
        draw: Which draw of the item.

    Source: hash pcg4d of M. Jarzynski and M. Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020.
    """
    step = wp.uint32(1664525)
    offset = wp.uint32(1013904223)
    x = key[0] * step + offset
    y = key[1] * step + offset
    z = wp.uint32(item) * step + offset
    w = wp.uint32(draw) * step + offset
    x += y * w
    y += z * x
    z += x * y
    w += y * z
    shift = wp.uint32(16)
    x = x ^ (x >> shift)
    y = y ^ (y >> shift)
    z = z ^ (z >> shift)
    w = w ^ (w >> shift)
    x += y * w
    y += z * x
    z += x * y
    w += y * z
    return wp.vec4ui(x, y, z, w)


@wp.func
def unit_interval(bits: wp.uint32) -> float:
    """Return a word as a number in (0, 1): the middle of one of 2^24 equal cells, so that a logarithm never gets 0.

    The topmost cell's middle rounds to 1 - 2^-24 in float32.
    """
    cell = wp.float32(bits >> wp.uint32(8))
    return wp.min((cell + 0.5) * 5.9604644775390625e-08, 0.99999994)


@wp.func
def uniform4(key: wp.vec2ui, item: int, draw: int) -> wp.vec4:
    """Return four independent numbers, uniform in (0, 1)."""
    bits = random_bits(key, item, draw)
    return wp.vec4(unit_interval(bits[0]), unit_interval(bits[1]), unit_interval(bits[2]), unit_interval(bits[3]))


@wp.func
def normal2(u: float, v: float) -> wp.vec2:
    """Return two independent standard normal numbers from two uniform ones.

    Source: G. Box and M. Muller, "A note on the generation of random normal deviates", 1958.
    """
    radius = wp.sqrt(-2.0 * wp.log(u))
    return wp.vec2(radius * wp.cos(2.0 * wp.PI * v), radius * wp.sin(2.0 * wp.PI * v))
