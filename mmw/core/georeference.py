"""Relate a world's plan to latitude and longitude: a point of the earth, a heading and a scale.

A map projection without distortion of angles is a similarity near any point, so a world that was cut from a projected
map needs its grid's heading (meridian convergence) and scale beside the place of its origin. Height is that of the
world: heights above an ellipsoid or the sea are not related to it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.errors import InputError
from mmw.core.geodesy import wgs84_from_world, world_from_wgs84

REACH_M = 100e3
"""Places farther than this from the origin are in no world [m]: five times the largest extent; design value."""


@dataclass(frozen=True)
class Georeference:
    """Place of a world on the earth."""

    latitude: float
    """Latitude of (0, 0) on WGS-84 [deg]."""
    longitude: float
    """Longitude of (0, 0) [deg]."""
    heading: float = 0.0
    """Direction of the world's y axis, clockwise from true north [rad]."""
    scale: float = 1.0
    """Meters of the world to a meter on the earth [-]."""

    def __post_init__(self) -> None:
        numbers = (self.latitude, self.longitude, self.heading, self.scale)
        if not (np.isfinite(numbers).all() and abs(self.latitude) <= 90 and abs(self.longitude) <= 180):
            raise InputError(
                f"geographic origin {self.latitude}, {self.longitude}: latitude -90 to 90 and longitude -180 to 180 "
                "deg are needed; give them in this order"
            )
        if not 0.5 < self.scale < 2.0:
            raise InputError(f"geographic scale {self.scale:g}: 0.5 to 2 is needed; the map's unit must be the meter")

    def world(self, degrees: ArrayLike) -> np.ndarray:
        """Return x and y [m], shape [N, 2], of latitudes and longitudes [deg], shape [N, 2].

        Raises:
            InputError: If a latitude is not between -90 and 90 deg.
        """
        degrees = np.asarray(degrees, np.float64)
        reference = (self.latitude, self.longitude, 0.0)
        east, north, _ = world_from_wgs84(np.pad(degrees, ((0, 0), (0, 1))), reference).T
        cos, sin = np.cos(self.heading), np.sin(self.heading)
        return self.scale * np.column_stack([cos * east - sin * north, sin * east + cos * north])

    def degrees(self, world: ArrayLike) -> np.ndarray:
        """Return latitudes and longitudes [deg], shape [N, 2], of x and y [m], shape [N, 2]: the inverse of `world`."""
        x, y = np.asarray(world, np.float64).T / self.scale
        cos, sin = np.cos(self.heading), np.sin(self.heading)
        plane = np.column_stack([cos * x + sin * y, -sin * x + cos * y, np.zeros(len(x))])
        reference = (self.latitude, self.longitude, 0.0)
        for _ in range(2):  # the tangent plane rises above the ellipsoid; each step takes off the rest
            geodetic = wgs84_from_world(plane, reference)
            plane[:, 2] -= geodetic[:, 2]
        return geodetic[:, :2]


def locate(reference: Georeference | None, degrees: ArrayLike, where: str) -> np.ndarray:
    """Return x and y [m] of latitudes and longitudes [deg], shape [N, 2] each.

    Args:
        reference: Place of the world; None if its asset says nothing.
        degrees: Latitudes and longitudes.
        where: What gives them, for errors.

    Raises:
        InputError: If the world has no geographic origin, or a place is far from it.
    """
    if reference is None:
        raise InputError(
            f"{where}: latitude and longitude need a town with a geographic origin; give x and y in meters, or import "
            "the town again with --geo-origin LATITUDE LONGITUDE"
        )
    degrees = np.asarray(degrees, np.float64)
    xy = reference.world(degrees)
    far = ~(np.hypot(*xy.T) <= REACH_M) | (np.abs(degrees[:, 1] - reference.longitude) > 90.0)
    if far.any():
        latitude, longitude = degrees[np.flatnonzero(far)[0]]
        raise InputError(
            f"{where}: ({latitude:g}, {longitude:g}) is far from the town at ({reference.latitude:g}, "
            f"{reference.longitude:g}); latitude comes first; correct the place"
        )
    return xy
