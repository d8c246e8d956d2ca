"""The map projection of an OpenDRIVE file: its <geoReference> and <offset>, by PROJ (extra geo)."""

import importlib
import math
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mmw.core.errors import InputError
from mmw.core.extras import needed_by
from mmw.core.geodesy import world_from_wgs84
from mmw.core.georeference import Georeference

WGS84 = "EPSG:4326"
VERTICAL = re.compile(r"\+(geoidgrids|vunits|vto_meter|nadgrids=@null)\S*")
"""Parts of a PROJ string that concern heights: those of a world are its own, and grids of geoids need files."""
FIT = 1000.0
"""Least distance over which heading and scale are told [m]; design value."""


@dataclass(frozen=True)
class Projection:
    """Map projection of a world."""

    text: str
    """PROJ string, code such as `EPSG:25833`, or WKT."""
    offset: tuple[float, float] = (0.0, 0.0)
    """Projected coordinates of the world's origin [m]."""
    turn: float = 0.0
    """Angle from the projected to the world's axes, counter-clockwise [rad]."""
    where: str = ""
    """File, for errors."""

    def world(self, degrees: np.ndarray) -> np.ndarray:
        """Return x and y [m], shape [N, 2], of latitudes and longitudes [deg], shape [N, 2]."""
        x, y = np.array(self._transform(WGS84, self._system(), degrees[:, 1], degrees[:, 0])) - np.array(
            self.offset
        ).reshape(2, 1)
        cos, sin = math.cos(self.turn), math.sin(self.turn)
        return np.column_stack([cos * x + sin * y, cos * y - sin * x])

    def degrees(self, world: np.ndarray) -> np.ndarray:
        """Return latitudes and longitudes [deg], shape [N, 2], of x and y [m], shape [N, 2]: the inverse of `world`."""
        x, y = world.T
        cos, sin = math.cos(self.turn), math.sin(self.turn)
        longitude, latitude = self._transform(
            self._system(), WGS84, cos * x - sin * y + self.offset[0], sin * x + cos * y + self.offset[1]
        )
        return np.column_stack([latitude, longitude])

    def georeference(self, middle: np.ndarray) -> Georeference:
        """Return the place of the world's origin, with heading and scale told between it and the middle, shape [2]."""
        far = np.asarray(middle, float) if np.hypot(*middle) > FIT else np.array([0.0, FIT])
        (latitude, longitude), other = self.degrees(np.stack([np.zeros(2), far])).tolist()
        east, north, _ = world_from_wgs84((*other, 0.0), (latitude, longitude, 0.0)).tolist()
        heading = math.atan2(east, north) - math.atan2(far[0], far[1])
        scale = math.hypot(*far) / math.hypot(east, north)
        return Georeference(latitude, longitude, math.remainder(heading, 2 * math.pi), scale)

    def _system(self) -> Any:
        with needed_by(f"{self.where}: its geographic reference"):
            crs = importlib.import_module("rasterio.crs")
        text = VERTICAL.sub("", self.text).strip()
        if text.startswith("+") and "+proj=" not in text:
            # RoadRunner's own, which CARLA's files leave out
            text = f"+proj=tmerc {text} +datum=WGS84 +units=m +no_defs"
        try:
            system = crs.CRS.from_user_input(text)
        except ValueError as error:
            raise InputError(
                f"{self.where}: <geoReference> {self.text[:60]!r} is no projection ({error}); correct it, or give "
                "--geo-origin LATITUDE LONGITUDE of the point (0, 0)"
            ) from None
        if not system.is_projected:
            raise InputError(
                f"{self.where}: <geoReference> {self.text[:60]!r} has degrees instead of meters; a projection is needed"
            )
        return system

    def _transform(self, source: Any, target: Any, x: np.ndarray, y: np.ndarray) -> tuple[list[float], list[float]]:
        with needed_by(f"{self.where}: its geographic reference"):
            warp = importlib.import_module("rasterio.warp")
        found = warp.transform(source, target, np.asarray(x).tolist(), np.asarray(y).tolist())
        if not np.isfinite(found).all():
            raise InputError(
                f"{self.where}: a place lies outside its projection {self.text[:60]!r}; correct <geoReference>"
            )
        return found


def read_projection(path: Path, origin: np.ndarray) -> Projection | None:
    """Return the projection of an OpenDRIVE file; None if it has none.

    Source: ASAM OpenDRIVE 1.8, 8.2 and 8.3: projected coordinates are those of the file turned by `hdg` and shifted
    by x and y of <offset>.

    Args:
        path: The file.
        origin: Point of the file that is the world's origin [m], shape [2].

    Raises:
        InputError: If <offset> has no numbers.
    """
    header = None
    for _, element in ElementTree.iterparse(path):
        if element.tag == "header":
            header = element
            break
        if element.tag == "road":
            break
    text = "" if header is None else (header.findtext("geoReference") or "").strip()
    if header is None or not text:
        return None
    offset = header.find("offset")
    values = [0.0, 0.0, 0.0]
    if offset is not None:
        try:
            values = [float(offset.get(name, "0")) for name in ("x", "y", "hdg")]
        except ValueError:
            values = [math.nan]
        if not np.isfinite(values).all():
            raise InputError(f"{path}: <offset> of <header> has no numbers; x, y and hdg are needed; correct it")
    x, y, turn = values
    cos, sin = math.cos(turn), math.sin(turn)
    place = (cos * origin[0] - sin * origin[1] + x, sin * origin[0] + cos * origin[1] + y)
    return Projection(text, place, turn, str(path))
