"""Complex numbers of float64 as vectors (real, imaginary part)."""

import warp as wp

ZERO = wp.constant(wp.float64(0.0))
"""0 in float64."""
ONE = wp.constant(wp.float64(1.0))
"""1 in float64."""


@wp.func
def multiply(a: wp.vec2d, b: wp.vec2d) -> wp.vec2d:
    """Return a b."""
    return wp.vec2d(a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0])


@wp.func
def divide(a: wp.vec2d, b: wp.vec2d) -> wp.vec2d:
    """Return a / b, with no square of b that could overflow. Source: R. L. Smith, Comm. ACM 5(8), 1962."""
    if wp.abs(b[0]) >= wp.abs(b[1]):
        ratio = b[1] / b[0]
        scale = ONE / (b[0] + b[1] * ratio)
        return wp.vec2d((a[0] + a[1] * ratio) * scale, (a[1] - a[0] * ratio) * scale)
    ratio = b[0] / b[1]
    scale = ONE / (b[1] + b[0] * ratio)
    return wp.vec2d((a[0] * ratio + a[1]) * scale, (a[1] * ratio - a[0]) * scale)


@wp.func
def square_root(a: wp.vec2d) -> wp.vec2d:
    """Return the root of a whose real part is not negative, with an imaginary part of the sign of that of a."""
    size = wp.sqrt(a[0] * a[0] + a[1] * a[1])
    if size == ZERO:
        return wp.vec2d(ZERO, a[1])
    root = wp.sqrt(wp.float64(0.5) * (size + wp.abs(a[0])))
    other = wp.float64(0.5) * a[1] / root
    if a[0] >= ZERO:
        return wp.vec2d(root, other)
    if a[1] < ZERO:
        return wp.vec2d(-other, -root)
    return wp.vec2d(other, root)


@wp.func
def exponential(a: wp.vec2d) -> wp.vec2d:
    """Return e^a."""
    size = wp.exp(a[0])
    return wp.vec2d(size * wp.cos(a[1]), size * wp.sin(a[1]))


@wp.func
def real(a: wp.float64) -> wp.vec2d:
    """Return a real number as a complex one."""
    return wp.vec2d(a, ZERO)
