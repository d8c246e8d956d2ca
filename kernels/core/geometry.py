"""Geometry that kernels share: launch directions, and planes in float64."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

GOLDEN_RATIO_INVERSE = wp.constant(wp.float64(0.6180339887498949))
"""1 / golden ratio."""


@wp.func
def single(v: wp.vec3d) -> wp.vec3:
    """Return a vector in the precision of the tracer."""
    return wp.vec3(wp.float32(v[0]), wp.float32(v[1]), wp.float32(v[2]))


@wp.func
def double(v: wp.vec3) -> wp.vec3d:
    """Return a vector of the tracer in float64."""
    return wp.vec3d(wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))


@wp.func
def fibonacci_direction_64(ray: int, ray_count: int) -> wp.vec3d:
    """Return direction `ray` of `ray_count` > 1 spread evenly over the sphere by the Fibonacci lattice.

    Source: R. Swinbank and R. J. Purser, Q. J. R. Meteorol. Soc. 132 (2006); the same lattice as Sionna RT 2.2.
    """
    turn = wp.float64(ray) * GOLDEN_RATIO_INVERSE
    azimuth = wp.float64(2.0) * wp.float64(wp.PI) * (turn - wp.floor(turn))
    z = wp.float64(1.0) - wp.float64(2.0) * wp.float64(ray) / wp.float64(ray_count - 1)
    across = wp.sqrt(wp.max(wp.float64(1.0) - z * z, wp.float64(0.0)))
    return wp.vec3d(across * wp.cos(azimuth), across * wp.sin(azimuth), z)


@wp.func
def fibonacci_direction(ray: int, ray_count: int) -> wp.vec3:
    """Return the same direction in the precision of the tracer."""
    return single(fibonacci_direction_64(ray, ray_count))


@wp.func
def reflection_point(tx: wp.vec3d, rx: wp.vec3d, normal: wp.vec3d, offset: wp.float64) -> wp.vec3d:
    """Return where the plane normal . p = offset mirrors `tx` to `rx`; both lie off it, on one side.

    It divides tx - rx, projected on the plane, in the ratio of the two heights: the image method written so that equal
    heights and grazing rays lose no digits, and so that swapping the ends gives the same point.
    """
    tx_height = wp.dot(normal, tx) - offset
    rx_height = wp.dot(normal, rx) - offset
    tx_foot = tx - tx_height * normal
    rx_foot = rx - rx_height * normal
    return (rx_height * tx_foot + tx_height * rx_foot) / (tx_height + rx_height)


@wp.func
def is_beyond_edge(along: wp.vec3d, offset: wp.vec3d, normal: wp.vec3d, limit: wp.float64) -> bool:
    """Return whether a point at `offset` from the begin of an edge is outside it, farther than the root of `limit`
    times the edge's length; without a root."""
    height = wp.dot(wp.cross(along, offset), normal)
    return height < wp.float64(0.0) and height * height > limit * wp.dot(along, along)


@wp.func
def is_inside(point: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, margin: wp.float64) -> bool:
    """Return whether a point, seen along the triangle's normal, is in the triangle or within `margin` [m] of it."""
    normal = wp.cross(b - a, c - a)
    # Most points are far outside; twice the margin leaves all that are near to the exact test.
    limit = wp.float64(4.0) * margin * margin * wp.dot(normal, normal)
    if is_beyond_edge(b - a, point - a, normal, limit):
        return False
    if is_beyond_edge(c - b, point - b, normal, limit):
        return False
    if is_beyond_edge(a - c, point - c, normal, limit):
        return False
    reach = -margin * wp.length(normal)
    return (
        wp.dot(wp.cross(b - a, point - a), normal) >= reach * wp.length(b - a)
        and wp.dot(wp.cross(c - b, point - b), normal) >= reach * wp.length(c - b)
        and wp.dot(wp.cross(a - c, point - c), normal) >= reach * wp.length(a - c)
        and reach < wp.float64(0.0)
    )
