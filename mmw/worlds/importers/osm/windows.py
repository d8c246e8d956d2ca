"""Windows of imported buildings: panes of glass in the plane of a wall, storey by storey."""

import numpy as np
import shapely

from mmw.core.mesh import TriangleMesh
from mmw.worlds.towns.block_description import BuildingStyle
from mmw.worlds.towns.facades import window_columns
from mmw.worlds.towns.plan_geometry import triangulate_polygons

PANE = "window_glass"
"""Material of the panes."""
LAYOUT = BuildingStyle()
"""Bays, sills and heads of the town kit's windows."""
MIN_WIDTH = 1.6
"""Narrower walls have no windows [m]; design value."""
STOREY = (2.2, 7.0)
"""Least and greatest height of a storey with windows [m]; design values."""
MAX_WINDOWS = 60_000
"""With more windows than this in an extract, a storey of a wall has one band of glass; design value, half a million
triangles."""
BAND_EDGE = 0.5
"""Wall beside a band [m]; design value."""


def window_frames(width: float, low: float, high: float, storeys: int, *, bands: bool) -> np.ndarray:
    """Return the windows of a wall, shape [N, 4]: left, bottom, right, top in the plane of the wall [m].

    Args:
        width: Length of the wall [m].
        low: Height of the lowest floor [m].
        high: Height of the eaves [m].
        storeys: Storeys between them.
        bands: Whether each storey has one band instead of a window for each bay.
    """
    tall = (high - low) / storeys
    if width < MIN_WIDTH or not STOREY[0] <= tall <= STOREY[1]:
        return np.zeros((0, 4))
    if bands:
        edge = min(BAND_EDGE, 0.2 * width)
        spans = np.array([[edge, width - edge]])
    else:
        across, is_window = window_columns(LAYOUT, width)
        columns = np.flatnonzero(is_window)
        spans = np.column_stack([across[columns], across[columns + 1]]) * width
    floor = low + tall * np.arange(storeys)
    sill, head = min(LAYOUT.sill_m, 0.35 * tall), min(LAYOUT.head_m, 0.25 * tall)
    levels = np.column_stack([floor + sill, floor + tall - head])
    count, rows = len(spans), len(levels)
    (left, right), (bottom, top) = np.tile(spans, (rows, 1)).T, np.repeat(levels, count, axis=0).T
    return np.column_stack([left, bottom, right, top])


def glazed_wall(
    a: np.ndarray, b: np.ndarray, low: float, high: float, frames: np.ndarray
) -> tuple[TriangleMesh, TriangleMesh]:
    """Return wall and glass of a wall from `a` to `b` in plan [2], its outside on the right, between two heights [m].

    The outer edges of the wall have no vertices but the corners, so that it meets its neighbors without gaps.

    Args:
        a: Start of the wall [m], shape [2].
        b: Its end [m], shape [2].
        low: Lower edge [m].
        high: Upper edge [m].
        frames: Windows [N, 4] of `window_frames`.
    """
    width = float(np.linalg.norm(b - a))
    boxes = shapely.box(*frames.T)
    holes = [np.asarray(box.exterior.coords) for box in boxes]
    outline = [(0.0, low), (width, low), (width, high), (0.0, high)]
    wall = triangulate_polygons(shapely.Polygon(outline, holes)).reshape(-1, 2)
    x0, z0, x1, z1 = frames.T
    panes = np.stack([x0, z0, x1, z0, x1, z1, x0, z0, x1, z1, x0, z1], axis=1).reshape(-1, 2)
    return _placed(wall, a, b, width), _placed(panes, a, b, width)


def _placed(flat: np.ndarray, a: np.ndarray, b: np.ndarray, width: float) -> TriangleMesh:
    """Return corners of triangles in the plane of a wall [3 M, 2] as a mesh in the world."""
    part = flat[:, :1] / width
    points = np.column_stack([(1 - part) * a + part * b, flat[:, 1]])
    return TriangleMesh(points, np.arange(len(points), dtype=np.int32).reshape(-1, 3))
