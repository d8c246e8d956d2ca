"""The ground between and around imported roads, and the undersides of roads that lead over others.

The ground ends a hand's breadth below the edges of the roads and reaches a little under them, so nothing looks through.
"""

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
import scipy.spatial
import shapely

from mmw.worlds.importers.opendrive.curbs import SLAB, Sheets
from mmw.worlds.importers.opendrive.road_surface import Sheet
from mmw.worlds.towns.mesh_part import MeshPart

DROP = 0.06
"""Height of the edges of roads above the ground [m]; design value."""
TUCK = 0.3
"""How far the ground reaches under the roads, and how far it stays at their height beside them [m]; design value."""
SPACING = 8.0
"""Size of the grid [m]; design value."""
MARGIN = 40.0
"""How far the ground reaches beyond the outermost road [m]; design value."""
EVERY = 2.0
"""Largest distance of the vertices along the roads [m]; design value."""
OVERPASS = 2.5
"""A road that lies this far above another is a bridge there [m]; design value."""
ABUTMENT = 6.0
"""A bridge reaches this far beyond what it crosses [m]; design value."""


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
    """Add undersides to the stretches of a road that are bridges, and return what they cover in plan.

    Args:
        sheet: The road; receives the faces.
        over: Which rows lie on a bridge, shape [rows].
    """
    covered = []
    for k in np.flatnonzero(over[:-1] | over[1:]):
        if sheet.stations[k + 1] - sheet.stations[k] < 1e-6:
            continue
        corners = np.array([sheet.rows[k][0], sheet.rows[k + 1][0], sheet.rows[k + 1][-1], sheet.rows[k][-1]])
        covered.append(shapely.make_valid(shapely.Polygon(corners[:, :2])))
        index = sheet.surface.add_points(corners - (0.0, 0.0, SLAB))
        sheet.surface.add_faces("concrete_structure", index[[[0, 1, 2], [0, 2, 3]]])
    return shapely.union_all(covered, grid_size=1e-4)


def build_ground(area: shapely.Geometry, sheets: Sheets) -> MeshPart:
    """Return the ground.

    Args:
        area: What roads and junctions cover in plan, bridges left out.
        sheets: Their surfaces.
    """
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
    count = np.maximum(np.ceil((high - low) / (SPACING * np.array([1.0, 0.866]))).astype(int), 2)
    x, y = (np.linspace(low[k], high[k], count[k] + 1) for k in range(2))
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    grid[1:-1, 1::2, 0] += 0.5 * (x[1] - x[0])  # a triangular lattice has one Delaunay triangulation
    grid = grid.reshape(-1, 2)
    near = area.buffer(TUCK + 0.4 * SPACING)
    shapely.prepare(near)
    grid = grid[~shapely.contains_xy(near, grid[:, 0], grid[:, 1])]
    xy = np.concatenate([fixed, grid])
    faces = scipy.spatial.Delaunay(xy).simplices.astype(np.int64)
    middle = xy[faces].mean(axis=1)
    under = area.buffer(-1.05 * TUCK, join_style="mitre")
    shapely.prepare(under)
    a, b, c = (xy[faces[:, k]] for k in range(3))
    twice = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    faces = np.where((twice < 0)[:, None], faces[:, ::-1], faces)
    z = np.concatenate([level, np.zeros(len(grid))])
    z[len(level) :] = _harmonic(faces, len(xy), level)
    faces = faces[(np.abs(twice) > 1e-6) & ~shapely.contains_xy(under, middle[:, 0], middle[:, 1])]
    used, index = np.unique(faces, return_inverse=True)
    points = np.column_stack([xy, z])[used]
    return MeshPart("Terrain/ground", points, index.reshape(-1, 3).astype(np.int32), "grass", "terrain")


def _harmonic(faces: np.ndarray, count: int, level: np.ndarray) -> np.ndarray:
    """Return heights of the vertices after the first ones: each the mean of its neighbours [m].

    Discrete harmonic interpolation: no bump or hollow between roads, and level ground between level roads.
    """
    i, j = faces[:, [0, 1, 2, 1, 2, 0]].ravel(), faces[:, [1, 2, 0, 0, 1, 2]].ravel()
    link = scipy.sparse.coo_matrix((np.ones(len(i)), (i, j)), shape=(count, count)).tocsr()
    link.data[:] = 1.0
    known = len(level)
    if known == count:
        return np.zeros(0)
    laplacian = (scipy.sparse.diags(np.asarray(link.sum(axis=1)).ravel()) - link).tocsr()[known:]
    inner = scipy.sparse.linalg.spsolve(laplacian[:, known:].tocsc(), -laplacian[:, :known] @ level)
    return np.round(np.atleast_1d(inner), 6)
