"""Convert world coordinates to latitude, longitude and height and back, and compute headings from north.

The origin of the world (x east, y north, z up) is a reference point, given as latitude [deg], longitude [deg] and
height [m]. There are two maps:

- WGS-84: the world is the tangent plane of the ellipsoid at the reference point, so height above the ellipsoid grows
  by 8 cm at 1 km. Exact in both directions, errors below 1e-8 m within 100 km.
- Mercator, as reported by CARLA's GNSS sensor: a spherical Mercator map whose scale is 1 at the reference latitude,
  and height as z. It deviates from WGS-84 as the sphere does from the ellipsoid: at 49 deg north 0.10 % of
  the distance to the north and 0.19 % to the east. In CARLA's world y points south: its y is our -y.

Source: WGS-84 constants, NIMA TR8350.2 (2000); geodetic to geocentric coordinates, B. Hofmann-Wellenhof et al., "GPS:
Theory and Practice"; inverse, H. Vermeille, "Direct transformation from geocentric coordinates to geodetic
coordinates", J. Geodesy 76 (2002); Mercator map of CARLA 0.9.15, `carla/geom/GeoLocation.cpp` (versions from 2025 on
use a transverse one).
"""

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.errors import InputError
from mmw.core.transforms import rotate

SEMI_MAJOR_AXIS = 6_378_137.0
"""Equatorial radius of WGS-84 [m], and the radius of CARLA's sphere."""

FLATTENING = 1.0 / 298.257223563
"""Flattening of WGS-84."""

E2 = FLATTENING * (2.0 - FLATTENING)
"""Square of the first eccentricity of WGS-84."""


def wgs84_from_world(points: ArrayLike, reference: ArrayLike) -> np.ndarray:
    """Return latitude [deg], longitude [deg] and height above the ellipsoid [m] of world points, shape [..., 3].

    Args:
        points: World frame [m], shape [..., 3].
        reference: Latitude [deg], longitude [deg] and height [m] of the world's origin, shape [3].

    Raises:
        InputError: If the reference's latitude is not between -90 and 90 deg.
    """
    reference = _checked("reference", reference)
    offset = _turn(_axes(reference).T, np.asarray(points, dtype=np.float64))
    return geodetic_from_ecef(ecef_from_geodetic(reference) + offset)


def world_from_ecef(points: ArrayLike, reference: ArrayLike) -> np.ndarray:
    """Return world points [m], shape [..., 3], of earth-centered, earth-fixed ones [m]; places of satellites too.

    Args:
        points: Earth-centered, earth-fixed [m], shape [..., 3].
        reference: As `wgs84_from_world`.

    Raises:
        InputError: If the reference's latitude is not between -90 and 90 deg.
    """
    reference = _checked("reference", reference)
    return _turn(_axes(reference), np.asarray(points, dtype=np.float64) - ecef_from_geodetic(reference))


def world_from_wgs84(geodetic: ArrayLike, reference: ArrayLike) -> np.ndarray:
    """Return world points [m], shape [..., 3]: the inverse of `wgs84_from_world`.

    Args:
        geodetic: Latitude [deg], longitude [deg] and height above the ellipsoid [m], shape [..., 3].
        reference: As `wgs84_from_world`.

    Raises:
        InputError: If a latitude is not between -90 and 90 deg.
    """
    return world_from_ecef(ecef_from_geodetic(_checked("points", geodetic)), reference)


def mercator_from_world(points: ArrayLike, reference: ArrayLike) -> np.ndarray:
    """Return CARLA's latitude [deg], longitude [deg] and altitude [m] of world points, shape [..., 3].

    Args and Raises as `wgs84_from_world`; the reference must not be a pole.
    """
    latitude, longitude, height = _checked("reference", reference, is_open=True)
    x, y, z = np.moveaxis(np.asarray(points, dtype=np.float64), -1, 0)
    radius = SEMI_MAJOR_AXIS * np.cos(np.radians(latitude))
    # arsinh(tan) of a latitude is ln tan(pi / 4 + latitude / 2), the north coordinate of a Mercator map of radius 1.
    north = np.arcsinh(np.tan(np.radians(latitude))) + y / radius
    return np.stack(
        [np.degrees(np.arctan(np.sinh(north))), _wrap_deg(longitude + np.degrees(x / radius)), height + z], axis=-1
    )


def world_from_mercator(geodetic: ArrayLike, reference: ArrayLike) -> np.ndarray:
    """Return world points [m], shape [..., 3]: the inverse of `mercator_from_world`.

    Args:
        geodetic: CARLA's latitude [deg], longitude [deg] and altitude [m], shape [..., 3].
        reference: As `wgs84_from_world`.

    Raises:
        InputError: If a latitude is not between -90 and 90 deg, or a pole.
    """
    reference = _checked("reference", reference, is_open=True)
    latitude, longitude, height = np.moveaxis(_checked("points", geodetic, is_open=True), -1, 0)
    radius = SEMI_MAJOR_AXIS * np.cos(np.radians(reference[0]))
    north = np.arcsinh(np.tan(np.radians(latitude))) - np.arcsinh(np.tan(np.radians(reference[0])))
    east = np.radians(_wrap_deg(longitude - reference[1]))
    return np.stack([radius * east, radius * north, height - reference[2]], axis=-1)


def ecef_from_geodetic(geodetic: ArrayLike) -> np.ndarray:
    """Return earth-centered, earth-fixed points [m] of WGS-84 latitude, longitude [deg], height [m], shape [..., 3]."""
    latitude, longitude, height = np.moveaxis(np.asarray(geodetic, dtype=np.float64), -1, 0)
    latitude, longitude = np.radians(latitude), np.radians(longitude)
    normal = SEMI_MAJOR_AXIS / np.sqrt(1.0 - E2 * np.sin(latitude) ** 2)  # radius of curvature across the meridian
    across = (normal + height) * np.cos(latitude)
    return np.stack(
        [
            across * np.cos(longitude),
            across * np.sin(longitude),
            (normal * (1.0 - E2) + height) * np.sin(latitude),
        ],
        axis=-1,
    )


def geodetic_from_ecef(points: ArrayLike) -> np.ndarray:
    """Return WGS-84 latitude, longitude [deg] and height [m], shape [..., 3], of earth-centered points [m].

    Valid except within 43 km of the earth's center. Symbols as in Vermeille's paper.
    """
    x, y, z = np.moveaxis(np.asarray(points, dtype=np.float64), -1, 0)
    across = np.hypot(x, y)
    p = (across / SEMI_MAJOR_AXIS) ** 2
    q = (1.0 - E2) * (z / SEMI_MAJOR_AXIS) ** 2
    r = (p + q - E2**2) / 6.0
    s = E2**2 * p * q / (4.0 * r**3)
    t = np.cbrt(1.0 + s + np.sqrt(s * (2.0 + s)))
    u = r * (1.0 + t + 1.0 / t)
    v = np.sqrt(u**2 + E2**2 * q)
    w = E2 * (u + v - q) / (2.0 * v)
    k = np.sqrt(u + v + w**2) - w
    d = k * across / (k + E2)
    latitude = 2.0 * np.arctan2(z, d + np.hypot(d, z))
    height = (k + E2 - 1.0) / k * np.hypot(d, z)
    return np.stack([np.degrees(latitude), np.degrees(np.arctan2(y, x)), height], axis=-1)


def heading_from_north(direction: ArrayLike) -> np.ndarray:
    """Return the heading of world vectors [rad], clockwise from north (+y) seen from above, in [0, 2 pi), shape [...].

    Same as CARLA's compass: 0 north, pi / 2 east. A vector without a horizontal part gives 0.
    """
    direction = np.asarray(direction, dtype=np.float64)
    heading = np.mod(np.arctan2(direction[..., 0], direction[..., 1]), 2.0 * np.pi)
    return np.where(heading >= 2.0 * np.pi, 0.0, heading)  # np.mod rounds up for -1e-17


def sensor_heading(q: ArrayLike) -> np.ndarray:
    """Return the heading of a sensor's x axis [rad], in [0, 2 pi), shape [...], of its orientation, shape [..., 4]."""
    return heading_from_north(rotate(q, (1.0, 0.0, 0.0)))


def _axes(reference: np.ndarray) -> np.ndarray:
    """Return the unit vectors to the east, to the north and up as rows, earth-fixed frame, shape [3, 3]."""
    latitude, longitude = np.radians(reference[:2])
    east = [-np.sin(longitude), np.cos(longitude), 0.0]
    up = [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)]
    return np.array([east, np.cross(up, east), up])


def _turn(matrix: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return matrix x vector, shape [..., 3], by plain sums: the rounding of BLAS may depend on the batch size."""
    return np.sum(matrix * vectors[..., None, :], axis=-1)


def _wrap_deg(longitude: ArrayLike) -> np.ndarray:
    """Return longitudes in [-180, 180); values in this range are returned unchanged."""
    longitude = np.asarray(longitude, dtype=np.float64)
    return np.where(np.abs(longitude) < 180.0, longitude, np.mod(longitude + 180.0, 360.0) - 180.0)


def _checked(name: str, geodetic: ArrayLike, is_open: bool = False) -> np.ndarray:
    """Return coordinates after a check of their latitudes; `is_open` excludes the poles."""
    geodetic = np.asarray(geodetic, dtype=np.float64)
    latitude = np.abs(geodetic[..., 0])
    is_bad = ~(latitude < 90.0) if is_open else ~(latitude <= 90.0)
    if np.any(is_bad):
        found = geodetic[..., 0][is_bad].ravel()[0] if geodetic.ndim > 1 else geodetic[0]
        raise InputError(
            f"{name}: latitude {found} deg; it must lie between -90 and 90 deg{', poles excluded' if is_open else ''}; "
            "give latitude, longitude, height in this order"
        )
    return geodetic
