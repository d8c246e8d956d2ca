"""The ground between and around imported roads, and the undersides of roads that lead over others.

The ground ends a hand's breadth below the edges of the roads and reaches a little under them, so nothing looks through.
"""

import numpy as np
import scipy.spatial
import shapely

from mmw.core.mesh import compact
from mmw.worlds.importers.opendrive.curbs import SLAB, Sheets
from mmw.worlds.importers.opendrive.road_surface import Sheet
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.plan_geometry import harmonic_heights, polygons_of, triangular_lattice, twice_areas

DROP = 0.06
"""Height of the edges of roads above the ground [m]; design value."""
TUCK = 0.3
"""How far the ground reaches under the roads, and how far it stays at their height beside them [m]; design value."""
SPACING = 8.0
"""Size of the grid [m]; design value."""
MAX_GRID = 500_000
"""Vertices of the grid: beyond 5 km x 5 km it becomes coarser; design value."""
MARGIN = 40.0
"""How far the ground reaches beyond the outermost road [m]; design value."""
EVERY = 2.0
"""Largest distance of the vertices along the roads [m]; design value."""
OVERPASS = 2.5
"""A road that lies this far above another is a bridge there [m]; design value."""
ABUTMENT = 6.0
"""A bridge reaches this far beyond what it crosses [m]; design value."""
MIN_PART = 1e-3
"""Smallest part of the roads that the ground is cut around [m^2]: overlays of roads that overlap leave slivers by the
thousand, for whose mitred borders GEOS takes minutes. Design value."""


def bridge_rows(sheet: Sheet, sheets: Sheets) -> np.ndarray:
    """Return which rows of a road lie on a bridge, shape [rows], bool."""
    station = np.array(sheet.stations)
    across = np.array([[row[0], row[len(row) // 2], row[-1]] for row in sheet.rows])
    points, at = [], []
    for k in range(len(station) - 1):
        part = np.linspace(0.0, 1.0, 2 + int(station[k + 1] - station[k]))
        points.append((across[k] + part[:, None, None] * (across[k + 1] - across[k])).reshape(-1, 3))
        at.append(station[k] + part * (station[k + 1] - station[k]))
    xyz = np.concatenate(points)
    is_over = (xyz[:, 2] - sheets.lowest(xyz[:, :2]) > OVERPASS).reshape(-1, 3).any(axis=1)
    over = np.concatenate(at)[is_over]
    return np.abs(station[:, None] - over[None]).min(axis=1, initial=np.inf) <= ABUTMENT


def add_deck(sheet: Sheet, over: np.ndarray) -> shapely.Geometry:
    """Add undersides to the rows of a road that are on a bridge, `over` [rows], and return their plan."""
    covered = []
    for k in np.flatnonzero(over[:-1] | over[1:]):
        if sheet.stations[k + 1] - sheet.stations[k] < 1e-6:
            continue
        corners = np.array([sheet.rows[k][0], sheet.rows[k + 1][0], sheet.rows[k + 1][-1], sheet.rows[k][-1]])
        covered += polygons_of(shapely.make_valid(shapely.Polygon(corners[:, :2])), 0.0)
        index = sheet.surface.add_points(corners - (0.0, 0.0, SLAB))
        sheet.surface.add_faces("concrete_structure", index[[[0, 1, 2], [0, 2, 3]]])
    return shapely.union_all(covered, grid_size=1e-4)


def build_ground(area: shapely.Geometry, sheets: Sheets) -> MeshPart:
    """Return the ground around roads and junctions that cover an area in plan, bridges left out."""
    area = shapely.MultiPolygon(polygons_of(area, MIN_PART)) if area.area > MIN_PART else area
    rings = [
        shapely.segmentize(shapely.simplify(area.buffer(d, join_style="mitre"), 0.02), EVERY) for d in (-TUCK, TUCK)
    ]
    inner, outer = (np.unique(np.round(shapely.get_coordinates(ring), 4), axis=0) for ring in rings)
    edge = shapely.get_coordinates(shapely.shortest_line(shapely.points(outer), area)).reshape(-1, 2, 2)[:, 1]
    fixed = np.concatenate([inner, outer])
    level = np.concatenate([sheets.lowest(inner), sheets.lowest(edge)]) - DROP
    known = np.isfinite(level)
    fixed, level = fixed[known], level[known]
    low, high = fixed.min(axis=0) - MARGIN, fixed.max(axis=0) + MARGIN
    spacing = max(SPACING, float(np.sqrt(np.prod(high - low) / MAX_GRID)))
    count = np.maximum(np.ceil((high - low) / (spacing * np.array([1.0, 0.866]))).astype(int), 2)
    grid = triangular_lattice(low, high, count, inner_only=True)
    near = area.buffer(TUCK + 0.4 * spacing)
    shapely.prepare(near)
    grid = grid[~shapely.contains_xy(near, grid[:, 0], grid[:, 1])]
    xy = np.concatenate([fixed, grid])
    faces = scipy.spatial.Delaunay(xy).simplices.astype(np.int64)
    middle = xy[faces].mean(axis=1)
    under = area.buffer(-1.05 * TUCK, join_style="mitre")
    shapely.prepare(under)
    twice = twice_areas(xy[faces])
    faces = np.where((twice < 0)[:, None], faces[:, ::-1], faces)
    z = harmonic_heights(faces, len(xy), level)
    faces = faces[(np.abs(twice) > 1e-6) & ~shapely.contains_xy(under, middle[:, 0], middle[:, 1])]
    return MeshPart.of("Terrain/ground", compact(np.column_stack([xy, z]), faces), "grass", "terrain")
