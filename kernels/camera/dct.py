"""Compute the two integer cosine transforms of JPEG files, rounded as libjpeg-turbo does.

The fast one rounds its products down and leaves a factor in each value, for which the quantisation makes up; the
accurate one rounds to the nearest. Both make values eight times too large.

Sources: Y. Arai, T. Agui and M. Nakajima, "A fast DCT-SQ scheme for images", Trans. IEICE E-71(11), 1988, with factors
of 8 bits (libjpeg's "ifast"); C. Loeffler et al., "Practical fast 1-D DCT algorithms with 11 multiplications", ICASSP
1989, with factors of 13 bits and two more bits between its passes (libjpeg's "islow").
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False, "max_unroll": 8})

Eight = wp.types.vector(length=8, dtype=wp.int32)
"""A row or column of a block."""

FACTOR_BITS = wp.constant(13)
"""Bits of the accurate transform's factors behind the point."""

MORE_BITS = wp.constant(2)
"""Additional bits of values between its two passes."""

FAST_BITS = wp.constant(8)
"""Bits of the fast transform's factors behind the point."""


@wp.func
def rounded(value: int, bits: int) -> int:
    """Return a number divided by 2^bits, to the nearest, halves upward."""
    return (value + (1 << (bits - 1))) >> bits


@wp.func
def butterfly(x: Eight):
    """Return the sums x[k] + x[7 - k] of the two halves of eight values, then the differences."""
    return x[0] + x[7], x[1] + x[6], x[2] + x[5], x[3] + x[4], x[0] - x[7], x[1] - x[6], x[2] - x[5], x[3] - x[4]


@wp.func
def cosines(x: Eight, bits: int) -> Eight:
    """Return the accurate cosine transform of eight values, divided by 2^bits but for its first and fifth."""
    a0, a1, a2, a3, b0, b1, b2, b3 = butterfly(x)
    out = Eight()
    out[0] = a0 + a3 + a1 + a2
    out[4] = a0 + a3 - a1 - a2
    out[2] = rounded(10703 * (a0 - a3) + 4433 * (a1 - a2), bits)
    out[6] = rounded(4433 * (a0 - a3) - 10704 * (a1 - a2), bits)
    out[1] = rounded(11363 * b0 + 9633 * b1 + 6437 * b2 + 2260 * b3, bits)
    out[3] = rounded(9633 * b0 - 2259 * b1 - 11362 * b2 - 6436 * b3, bits)
    out[5] = rounded(6437 * b0 - 11362 * b1 + 2261 * b2 + 9633 * b3, bits)
    out[7] = rounded(2260 * b0 - 6436 * b1 + 9633 * b2 - 11363 * b3, bits)
    return out


@wp.func
def accurate_rows(x: Eight) -> Eight:
    """Return the accurate transform of a row, with some bits more."""
    out = cosines(x, FACTOR_BITS - MORE_BITS)
    out[0] = out[0] << MORE_BITS
    out[4] = out[4] << MORE_BITS
    return out


@wp.func
def accurate_columns(x: Eight) -> Eight:
    """Return the accurate transform of a column of transformed rows, without their bits more."""
    out = cosines(x, FACTOR_BITS + MORE_BITS)
    out[0] = rounded(out[0], MORE_BITS)
    out[4] = rounded(out[4], MORE_BITS)
    return out


@wp.func
def fast_product(factor: int, value: int) -> int:
    """Return `factor` / 256 times a value, rounded down.

    The library's vector instructions use the upper half of a product of 16-bit numbers, for which the value is
    quadrupled first. That exceeds 16 bits in blocks of the hardest black-and-white patterns alone, where its top bits
    are lost: so here.
    """
    return (factor * int(wp.int16(value << 2))) >> (FAST_BITS + 2)


@wp.func
def fast_cosines(x: Eight) -> Eight:
    """Return the fast cosine transform of eight values, each too large by a factor of its own (`fast_divisors`).

    Arai, Agui and Nakajima's flow graph: five products, with cos(pi/4) = 181, sin(pi/8) = 98, cos(pi/8) - sin(pi/8) =
    139 and cos(pi/8) + sin(pi/8) = 334 of 256.
    """
    a0, a1, a2, a3, b0, b1, b2, b3 = butterfly(x)
    out = Eight()
    out[0] = a0 + a3 + (a1 + a2)
    out[4] = a0 + a3 - (a1 + a2)
    even = fast_product(181, a0 - a3 + a1 - a2)
    out[2] = a0 - a3 + even
    out[6] = a0 - a3 - even
    low = b3 + b2
    high = b1 + b0
    middle = fast_product(181, b2 + b1)
    turn = fast_product(98, low - high)
    low = fast_product(139, low) + turn
    high = fast_product(334, high) + turn
    out[1] = b0 + middle + high
    out[7] = b0 + middle - high
    out[5] = b0 - middle + low
    out[3] = b0 - middle - low
    return out
