"""Place points of a coordinate reference system in the world: x east, y north, z up, meters from an origin."""

import re
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from mmw.core.errors import InputError
from mmw.core.extras import install
from mmw.core.geodesy import geodetic_from_ecef, world_from_wgs84
from mmw.core.georeference import Georeference
from mmw.worlds.importers.mesh_cleanup import MAX_COORDINATE_M, MAX_NUMBER_M

MAX_OFFSET = 10e3
"""Points of an unknown system that are farther than this from its origin get one of their own [m]."""
LATITUDE_FIRST = (4326, 4979, 4258, 4937, 6697)
"""EPSG codes of geographic systems: latitude, longitude [deg], maybe height [m]. Source: EPSG registry: WGS 84, ETRS89,
JGD2011 with heights. A meter between these datums does not count here."""
GEOCENTRIC = (4978,)
"""EPSG codes of earth-centered, earth-fixed systems [m]."""


@dataclass(frozen=True)
class ReferenceSystem:
    """A coordinate reference system, as far as it is known."""

    code: int = 0
    """Horizontal EPSG code; 0 if unknown: x, y and z are meters then."""
    is_longitude_first: bool = False
    """Whether degrees come as longitude, latitude, against the registry."""


def reference_system(text: str) -> ReferenceSystem:
    """Return the system of a name such as `urn:ogc:def:crs:EPSG::25832`.

    Short names (`EPSG:4979`) have longitudes first, as in GML 2 and in most programs. Models of German states have
    names such as `urn:adv:crs:ETRS89_UTM32*DE_DHHN2016_NH` (AdV), in zone 32 EPSG:25832.
    """
    found = re.search(r"EPSG(?:\.xml#|[:/](?:[\d.]*[:/])?)(\d{4,6})", text, re.IGNORECASE)
    zone = re.search(r"ETRS89_UTM(\d\d)", text)
    code = int(found[1]) if found else 25800 + int(zone[1]) if zone else 0
    return ReferenceSystem(code, text.strip().upper().startswith("EPSG:"))


def place(where: str, points: np.ndarray, system: ReferenceSystem) -> tuple[np.ndarray, Georeference | None, list[str]]:
    """Return points in the world, its place on the earth if that is known, and notes on its origin.

    The origin is the middle of the points, on the height of the lowest one.

    Args:
        where: File, for errors.
        points: Finite coordinates in their system, shape [N, 3], N >= 1.
        system: Their system.

    Raises:
        InputError: If the system cannot be used, or a place is not on the earth.
    """
    degrees, notes = _degrees(where, points, system)
    if degrees is None:
        world, more = _shifted(points)
        return world, None, [*notes, *more]
    if (np.abs(degrees[:, :2]) > [90.0, 180.0]).any():
        raise InputError(f"{where}: a place of EPSG:{system.code} is not on the earth; correct coordinates or system")
    low, high = degrees.min(axis=0), degrees.max(axis=0)
    latitude, longitude = np.round(0.5 * (low + high)[:2], 6).tolist()
    level = round(float(low[2]), 2)
    # in the tangent plane, as extracts of OpenStreetMap are placed, so that both fit; heights do not bend with it
    plan = np.column_stack([degrees[:, :2], np.zeros(len(degrees))])
    world = world_from_wgs84(plan, (latitude, longitude, 0.0))
    world[:, 2] = degrees[:, 2] - level
    note = f"origin: latitude {latitude:.6f}, longitude {longitude:.6f} deg, height {level:.2f} m"
    return world, Georeference(latitude, longitude), [*notes, note]


def check_numbers(where: str, points: np.ndarray) -> None:
    """Raise InputError for coordinates that are not finite, or too large to be computed with."""
    bad = points[~(np.abs(points) <= MAX_NUMBER_M)]
    if len(bad):
        raise InputError(f"{where}: a coordinate is {bad[0]:g}; a number below {MAX_NUMBER_M:g} is needed; correct it")


def check_reach(where: str, points: np.ndarray) -> None:
    """Raise InputError for points of a world that lie too far from its origin for vertices in single precision."""
    reach = float(np.abs(points).max(initial=0.0))
    if reach > MAX_COORDINATE_M:
        raise InputError(
            f"{where}: reaches {reach / 1e3:.4g} km from the middle of the file; {MAX_COORDINATE_M / 1e3:.0f} km or "
            "less are needed; correct it, or cut out a smaller area"
        )


def _degrees(where: str, points: np.ndarray, system: ReferenceSystem) -> tuple[np.ndarray | None, list[str]]:
    """Return latitude, longitude [deg] and height [m], shape [N, 3]; None for a plane system that is not known."""
    code = system.code
    if code in LATITUDE_FIRST:
        return points[:, [1, 0, 2]] if system.is_longitude_first else points, []
    if code in GEOCENTRIC:
        return geodetic_from_ecef(points), []
    if not code:
        return None, []
    if find_spec("rasterio") is None:
        return None, [f"EPSG:{code}: no latitude and longitude without rasterio; {install('geo')}"]
    import rasterio.errors
    import rasterio.warp

    try:
        x, y, *_ = rasterio.warp.transform(f"EPSG:{code}", "EPSG:4326", points[:, 0].tolist(), points[:, 1].tolist())
    except (rasterio.errors.RasterioError, ValueError) as error:
        raise InputError(f"{where}: EPSG:{code} cannot be used ({error}); correct the reference system") from None
    degrees = np.column_stack([y, x, points[:, 2]])
    if not np.isfinite(degrees).all():
        raise InputError(f"{where}: a place of EPSG:{code} is not on the earth; correct coordinates or system")
    return degrees, []


def _shifted(points: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Return points as they are, or relative to a round point in their middle if they are far from their origin."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    if np.abs(middle[:2]).max() < MAX_OFFSET and abs(middle[2]) < MAX_OFFSET:
        return points, []
    origin = np.round(middle, -2)
    origin[2] = np.floor(points[:, 2].min())
    text = f"x = {origin[0]:.0f} m, y = {origin[1]:.0f} m, z = {origin[2]:.0f} m"
    return points - origin, [f"the origin was moved to {text} of the file"]
