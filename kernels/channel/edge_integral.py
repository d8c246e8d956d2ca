"""Integrate the wave of a straight edge of a finite surface: Owen's T function of a complex argument, in float64.

G(x) is the integral from 0 to x of exp(-j beta (1 + t^2)) / (1 + t^2) dt. Where the phase along the edge is small it is
taken by quadrature; farther on along the path of steepest descent, where the integrand only falls.

Source: D. B. Owen, Ann. Math. Stat. 27 (1956); Gauss-Legendre quadrature on both paths.
"""

import warp as wp

from mmw.kernels.core.compiler import DOUBLE_PRECISION

wp.set_module_options(DOUBLE_PRECISION)

HALF_PI = wp.constant(wp.float64(1.5707963267948966))
NODES = wp.constant(32)
"""Nodes of the Gauss-Legendre quadrature of an edge."""
SETTLED = wp.constant(wp.float64(9.0))
"""Phase along an edge from which its integral is taken along the path of steepest descent [rad]."""


@wp.struct
class Quadrature:
    """Gauss-Legendre quadrature on 0 to 1."""

    node: wp.array[wp.float64]
    """Nodes, shape [NODES]."""
    weight: wp.array[wp.float64]
    """Weights, shape [NODES]."""


@wp.func
def turn(phase: wp.float64) -> wp.vec2d:
    """Return exp(-j phase) as real and imaginary part."""
    return wp.vec2d(wp.cos(phase), -wp.sin(phase))


@wp.func
def times(a: wp.vec2d, b: wp.vec2d) -> wp.vec2d:
    """Return the product of two complex numbers."""
    return wp.vec2d(a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0])


@wp.func
def near_part(rule: Quadrature, beta: wp.float64, x: wp.float64) -> wp.vec2d:
    """Return G(x) for x >= 0 and a moderate phase, by quadrature over t = sinh(q)."""
    top = wp.log(x + wp.sqrt(x * x + wp.float64(1.0)))
    total = wp.vec2d()
    for k in range(NODES):
        grown = wp.exp(top * rule.node[k])
        cosh = wp.float64(0.5) * (grown + wp.float64(1.0) / grown)
        total = total + (rule.weight[k] * top / cosh) * turn(beta * cosh * cosh)
    return total


@wp.func
def far_part(rule: Quadrature, beta: wp.float64, x: wp.float64) -> wp.vec2d:
    """Return the integral from x >= 0 to infinity, along t = x + e^{-j pi/4} q, where the integrand falls."""
    half = wp.float64(0.7071067811865476)
    slope = wp.float64(2.0) * half * beta * x
    top = (wp.sqrt(slope * slope + wp.float64(140.0) * beta) - slope) / (wp.float64(2.0) * beta)
    total = wp.vec2d()
    for k in range(NODES):
        q = top * rule.node[k]
        fall = wp.exp(-beta * q * q - slope * q) * rule.weight[k] * top
        real = x + half * q
        imaginary = -half * q
        below = wp.vec2d(wp.float64(1.0) + real * real - imaginary * imaginary, wp.float64(2.0) * real * imaginary)
        share = fall / wp.dot(below, below)
        total = total + times(turn(slope * q), wp.vec2d(below[0] * share, -below[1] * share))
    return times(total, turn(beta * (wp.float64(1.0) + x * x) + wp.float64(0.5) * HALF_PI))


@wp.func
def edge_part(rule: Quadrature, beta: wp.float64, x: wp.float64) -> wp.vec2d:
    """Return G(x), an odd function of x."""
    a = wp.abs(x)
    total = wp.vec2d()
    if beta >= wp.float64(4.0):
        total = far_part(rule, beta, wp.float64(0.0)) - far_part(rule, beta, a)
    else:
        middle = wp.sqrt(SETTLED / wp.max(beta, wp.float64(1e-30)))
        total = near_part(rule, beta, wp.min(a, middle))
        if a > middle:
            total = total + far_part(rule, beta, middle) - far_part(rule, beta, a)
    if x < wp.float64(0.0):
        total = -total
    return total
