"""Read heights of the ground from a raster, GeoTIFF above all, in the plane of a world (extra geo)."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.interpolate
import scipy.ndimage
import shapely

from mmw.core.errors import InputError
from mmw.core.extras import needed_by

MARGIN = 45.0
"""How far heights are needed beyond roads, buildings and areas [m]: the ground of importers reaches 30 to 40 m."""
SPACING = (1.0, 30.0)
"""Least and largest spacing of the grid of heights [m]: that of the raster in between; design values."""
MAX_GRID = 16_000_000
"""Most heights of the grid; design value: 4 km x 4 km at 1 m. Beyond, the spacing grows."""
ROAD_SMOOTHING = 8.0
"""Standard deviation of the Gaussian that smooths heights under roads [m]; design value: a survey's noise and steps
between its cells are no bumps that wheels feel."""
ROAD_REACH = 25.0
"""Distance from center lines within which the ground goes over into the raster's heights [m]; design value."""
LEVEL_REACH = 8.0
"""Distance from center lines within which the ground has the heights of the lines: roads are level across [m]; design
value. Of several lines the mean counts, by the inverse square of their distances."""
AXIS = 0.5
"""Distance that is added to that of a line [m], so that crossing lines blend; design value."""
MAX_HEIGHT = 9000.0
"""Heights beyond this, either sign, are marks of missing data [m]: over the highest mountain of 8849 m."""


@dataclass(frozen=True)
class Relief:
    """Heights of the ground."""

    raw: Callable[[np.ndarray, np.ndarray], np.ndarray]
    """Height [m] over x and y [m], a twice differentiable function through the raster's heights."""
    smooth: Callable[[np.ndarray, np.ndarray], np.ndarray]
    """The same for roads."""
    roads: shapely.STRtree
    """Center lines of roads."""
    zero: float
    """Height of the raster that is z = 0 [m]."""
    spacing: float
    """Spacing of the heights [m]."""

    def height(self, xy: np.ndarray) -> np.ndarray:
        """Return the height of the ground over points [m], shape [N, 2] -> [N]."""
        z = self.raw(*xy.T)
        points = np.asarray(shapely.points(xy))
        found, line = self.roads.query(points, predicate="dwithin", distance=ROAD_REACH)
        if not len(found):
            return z
        lines = np.asarray(self.roads.geometries)[line]
        feet = shapely.get_coordinates(
            shapely.line_interpolate_point(lines, shapely.line_locate_point(lines, points[found]))
        )
        distance = np.hypot(*(feet - xy[found]).T)
        t = np.clip((distance - LEVEL_REACH) / (ROAD_REACH - LEVEL_REACH), 0.0, 1.0)
        share = 1.0 - t * t * (3.0 - 2.0 * t)
        weight = share / (distance + AXIS) ** 2
        total, mean, near = np.zeros(len(xy)), np.zeros(len(xy)), np.zeros(len(xy))
        np.add.at(total, found, weight)
        np.add.at(mean, found, weight * self.smooth(*feet.T))
        np.maximum.at(near, found, share)
        mean = np.divide(mean, total, out=z.copy(), where=total > 0.0)
        return near * mean + (1.0 - near) * z


def read_relief(
    path: Path, to_degrees: Callable[[np.ndarray], np.ndarray], box: np.ndarray, roads: list[shapely.LineString]
) -> Relief:
    """Return the heights of a raster over a world.

    Args:
        path: The raster, in any format and coordinate system that GDAL reads; its first band, in meters.
        to_degrees: Map of x and y [m] to latitude and longitude [deg], shape [N, 2] each.
        box: Least x and y and largest x and y of roads, buildings and areas [m], shape [4].
        roads: Center lines of roads.

    Raises:
        InputError: If the raster cannot be read, has no coordinate system, does not cover the world, or lacks heights
            there.
        MissingPackageError: If rasterio is not installed.
    """
    with needed_by(f"{path}: reading heights"):
        rasterio = importlib.import_module("rasterio")
    low, high = np.asarray(box[:2]) - MARGIN, np.asarray(box[2:]) + MARGIN
    try:
        with rasterio.open(path) as source:
            if source.crs is None:
                raise InputError(
                    f"{path}: --terrain: has no coordinate system; a georeferenced raster is needed; assign one, as "
                    "with gdal_edit.py -a_srs EPSG:25832"
                )
            spacing = _spacing(source, to_degrees, 0.5 * (low + high), high - low)
            count = np.maximum(np.ceil((high - low) / spacing).astype(int) + 1, 4)
            x, y = (np.linspace(low[k], high[k], count[k]) for k in range(2))
            points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
            z = _sample(path, source, to_degrees(points)).reshape(len(x), len(y))
    except rasterio.errors.RasterioIOError as error:
        raise InputError(f"{path}: --terrain: cannot be read ({error}); give an existing GeoTIFF") from None
    zero = float(np.floor(z.min() * 100) / 100)
    z = z - zero
    widths = ROAD_SMOOTHING / np.array([x[1] - x[0], y[1] - y[0]])
    even = scipy.ndimage.gaussian_filter(z, widths, mode="nearest")
    return Relief(_spline(x, y, z), _spline(x, y, even), shapely.STRtree(roads), zero, float(spacing))


def _spline(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    return scipy.interpolate.RectBivariateSpline(x, y, z).ev


def _spacing(
    source: Any, to_degrees: Callable[[np.ndarray], np.ndarray], middle: np.ndarray, size: np.ndarray
) -> float:
    """Return the spacing of the grid [m]: the size of the raster's cells in the middle of the world, within limits."""
    step = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    cells = np.stack(_pixels(source, to_degrees(middle + step)))
    finest = 1.0 / max(float(np.abs(cells[:, 1:] - cells[:, :1]).max()), 1e-9)
    return max(float(np.clip(finest, *SPACING)), float(np.sqrt(np.prod(size) / MAX_GRID)))


def _pixels(source: Any, degrees: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return column and row of places [deg], shape [N, 2], counted from the middle of the first cell."""
    warp = importlib.import_module("rasterio.warp")
    x, y = warp.transform("EPSG:4326", source.crs, degrees[:, 1].tolist(), degrees[:, 0].tolist())
    column, row = ~source.transform @ (np.array(x), np.array(y))
    return np.asarray(column) - 0.5, np.asarray(row) - 0.5


def _sample(path: Path, source: Any, degrees: np.ndarray) -> np.ndarray:
    """Return heights by bilinear interpolation, shape [N]."""
    column, row = _pixels(source, degrees)
    size = np.array([source.width, source.height])
    with np.errstate(invalid="ignore"):
        outside = ~((column >= -0.5) & (row >= -0.5) & (column <= size[0] - 0.5) & (row <= size[1] - 0.5))
    if outside.any():
        south, west = degrees.min(axis=0)
        north, east = degrees.max(axis=0)
        raise InputError(
            f"{path}: --terrain: covers {(1 - outside.mean()) * 100:.0f} % of the map with {MARGIN:g} m around it; "
            f"latitudes {south:.5f} to {north:.5f} and longitudes {west:.5f} to {east:.5f} deg are needed; give a "
            "larger raster or cut the map"
        )
    window = importlib.import_module("rasterio.windows").Window
    first = np.maximum(np.floor([column.min(), row.min()]).astype(int), 0)
    last = np.minimum(np.ceil([column.max(), row.max()]).astype(int) + 1, size)
    part = window(*first.tolist(), *(last - first).tolist())
    cells = source.read(1, window=part, masked=True).astype(np.float64).filled(np.nan)
    cells = cells * source.scales[0] + source.offsets[0]
    cells[~(np.abs(cells) <= MAX_HEIGHT)] = np.nan
    found = scipy.ndimage.map_coordinates(cells, [row - first[1], column - first[0]], order=1, mode="nearest")
    missing = ~np.isfinite(found)
    if missing.any():
        latitude, longitude = degrees[np.flatnonzero(missing)[0]]
        raise InputError(
            f"{path}: --terrain: has no height at {missing.mean() * 100:.1f} % of the map, such as at latitude "
            f"{latitude:.5f}, longitude {longitude:.5f}; fill its gaps, as with gdal_fillnodata.py"
        )
    return found
