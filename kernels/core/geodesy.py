"""Convert world coordinates to latitude, longitude and height in float64, see `mmw.core.geodesy`."""

import warp as wp

from mmw.kernels.core.compiler import AS_NUMPY
from mmw.kernels.core.quaternions import rotated

wp.set_module_options(AS_NUMPY)

MERCATOR = wp.constant(0)
"""Kind of map: CARLA's spherical Mercator map."""
WGS84 = wp.constant(1)
"""Kind of map: the tangent plane of the ellipsoid."""

RADIUS = wp.constant(wp.float64(6_378_137.0))
"""`mmw.core.geodesy.SEMI_MAJOR_AXIS` [m]."""

TWO_PI = wp.constant(wp.float64(6.283185307179586))
DEGREES = wp.constant(wp.float64(57.29577951308232))
"""Degrees of a radian."""


@wp.struct
class EarthMap:
    """How the world lies on the earth."""

    kind: int
    """`MERCATOR` or `WGS84`."""
    e2: wp.float64
    """Square of the first eccentricity of the ellipsoid."""
    origin: wp.vec3d
    """World's origin: with `MERCATOR` the north coordinate on a map of radius 1, longitude [deg] and height [m], with
    `WGS84` earth-centered, earth-fixed [m]."""
    radius: wp.float64
    """Radius of the parallel of the origin on the sphere [m]; `MERCATOR` alone."""
    axes: wp.mat33d
    """World to earth-fixed; `WGS84` alone."""


@wp.func
def wrapped_mod(value: wp.float64, period: wp.float64) -> wp.float64:
    """Return the remainder that has the sign of the period."""
    result = wp.mod(value, period)
    if result < wp.float64(0.0):
        result = result + period
    return result


@wp.func
def full_circle(angle: wp.float64) -> wp.float64:
    """Return an angle in [0, 2 pi) [rad]."""
    result = wrapped_mod(angle, TWO_PI)
    if result >= TWO_PI:  # the remainder rounds up for -1e-17
        result = wp.float64(0.0)
    return result


@wp.func
def heading_of(attitude: wp.vec4d) -> wp.float64:
    """Return the heading of a sensor's x axis, clockwise from north, in [0, 2 pi) [rad]."""
    forward = rotated(attitude, wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0)))
    return full_circle(wp.atan2(forward[0], forward[1]))


@wp.func
def mercator(earth: EarthMap, point: wp.vec3d) -> wp.vec3d:
    """Return CARLA's latitude [deg], longitude [deg] and altitude [m] of a world point."""
    north = earth.origin[0] + point[1] / earth.radius
    longitude = earth.origin[1] + point[0] / earth.radius * DEGREES
    if wp.abs(longitude) >= wp.float64(180.0):
        longitude = wrapped_mod(longitude + wp.float64(180.0), wp.float64(360.0)) - wp.float64(180.0)
    return wp.vec3d(wp.atan(wp.sinh(north)) * DEGREES, longitude, earth.origin[2] + point[2])


@wp.func
def ecef_to_geodetic(point: wp.vec3d, e2: wp.float64) -> wp.vec3d:
    """Return WGS-84 latitude, longitude [deg] and height [m] of an earth-centered point [m].

    Valid except within 43 km of the earth's center.

    Source: H. Vermeille, J. Geodesy 76 (2002), whose symbols these are.
    """
    one = wp.float64(1.0)
    across = wp.sqrt(point[0] * point[0] + point[1] * point[1])
    p = (across / RADIUS) * (across / RADIUS)
    q = (one - e2) * ((point[2] / RADIUS) * (point[2] / RADIUS))
    r = (p + q - e2 * e2) / wp.float64(6.0)
    s = e2 * e2 * p * q / (wp.float64(4.0) * (r * r * r))
    t = wp.cbrt(one + s + wp.sqrt(s * (wp.float64(2.0) + s)))
    u = r * (one + t + one / t)
    v = wp.sqrt(u * u + e2 * e2 * q)
    w = e2 * (u + v - q) / (wp.float64(2.0) * v)
    k = wp.sqrt(u + v + w * w) - w
    d = k * across / (k + e2)
    away = wp.sqrt(d * d + point[2] * point[2])
    latitude = wp.float64(2.0) * wp.atan2(point[2], d + away)
    return wp.vec3d(latitude * DEGREES, wp.atan2(point[1], point[0]) * DEGREES, (k + e2 - one) / k * away)


@wp.func
def to_geodetic(earth: EarthMap, point: wp.vec3d) -> wp.vec3d:
    """Return latitude [deg], longitude [deg] and height [m] of a world point [m]."""
    if earth.kind == MERCATOR:
        return mercator(earth, point)
    return ecef_to_geodetic(earth.origin + earth.axes * point, earth.e2)


@wp.kernel
def geodetic_kernel(
    points: wp.array[wp.vec3d],
    earth: EarthMap,
    # out
    geodetic_out: wp.array[wp.vec3d],
):
    """Convert world points.

    Launch: dim=(points)

    Args:
        points: World frame [m], shape [N].
        earth: The map.
        geodetic_out: Latitude [deg], longitude [deg] and height [m], shape [N].
    """
    row = wp.tid()
    geodetic_out[row] = to_geodetic(earth, points[row])
