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

from functools import lru_cache

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from mmw.core.errors import InputError
from mmw.core.repeated_launch import launch_again
from mmw.kernels.core import geodesy as kernels

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
    return _geodetic(points, earth_map(False, reference))


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
    return _geodetic(points, earth_map(True, reference))


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

    Valid except within 43 km of the earth's center.
    """
    return _geodetic(points, _earth(False, None))


def earth_map(is_mercator: bool, reference: ArrayLike) -> kernels.EarthMap:
    """Return how a world lies on the earth, as an argument of kernels.

    Args:
        is_mercator: Whether the map is CARLA's, or else WGS-84.
        reference: As `wgs84_from_world`.

    Raises:
        InputError: If the reference's latitude is not between -90 and 90 deg, or a pole with a Mercator map.
    """
    return _earth(is_mercator, tuple(_checked("reference", reference, is_open=is_mercator).tolist()))


@lru_cache(maxsize=16)
def _earth(is_mercator: bool, reference: tuple[float, ...] | None) -> kernels.EarthMap:
    """Return `earth_map` of a checked reference, or the map of earth-centered points."""
    out = kernels.EarthMap()
    out.e2 = E2
    out.kind = int(kernels.MERCATOR if is_mercator else kernels.WGS84)
    out.axes = wp.mat33d(*np.eye(3).ravel())
    if reference is not None and is_mercator:
        # arsinh(tan) of a latitude is ln tan(pi / 4 + latitude / 2), the north coordinate of a map of radius 1.
        latitude = np.radians(reference[0])
        out.radius = SEMI_MAJOR_AXIS * np.cos(latitude)
        out.origin = wp.vec3d(np.arcsinh(np.tan(latitude)), *reference[1:])
    elif reference is not None:
        place = np.array(reference)
        out.origin, out.axes = wp.vec3d(*ecef_from_geodetic(place)), wp.mat33d(*_axes(place).T.ravel())
    return out


def _geodetic(points: ArrayLike, earth: kernels.EarthMap) -> np.ndarray:
    """Return latitude [deg], longitude [deg] and height [m] of points [..., 3]."""
    points = np.asarray(points, dtype=np.float64)
    out = np.empty(points.shape)
    given = wp.array(points.reshape(-1, 3), dtype=wp.vec3d, device="cpu")
    made = wp.array(out.reshape(-1, 3), dtype=wp.vec3d, device="cpu", copy=False)
    launch_again(kernels.geodetic_kernel, given.shape, [given, earth, made], "cpu")
    return out


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
