"""The ground of an OpenDRIVE junction: the roads that cross it overlap in plan, so their areas are joined to one sheet.

Asphalt goes before sidewalks, and sidewalks before grass. The height is the mean of the roads' heights, weighted with
the distance from their edges, so it is continuous and equals that of the roads where only one lies.
"""

from dataclasses import dataclass

import numpy as np
import scipy.spatial
import shapely

from mmw.worlds.importers.opendrive.cross_section import KERB_HEIGHT, RoadShape, choose_rows, surface_of
from mmw.worlds.importers.opendrive.road_surface import MATERIAL, Sheet, breaks
from mmw.worlds.towns.plan_geometry import polygons_of, subtract_area, triangulate_polygons, twice_areas

CELL = 4.0
"""Size of the triangles where a junction is not plane [m]; design value."""
FLAT = 0.002
"""A junction whose heights lie within this of a plane needs no inner vertices [m]."""
MAX_HOLE = 30.0
"""Gaps between the roads of a junction below this area are paved [m^2]; design value, a small traffic island."""
SNAP = 2e-3
"""Vertices of the seams with the roads are adopted within this distance [m]."""
MIN_OVERLAP = 1e-3
"""Less than this of a junction lies on the roads outside by rounding only [m^2]; design value."""
MIN_HEIGHT = 1e-4
"""Triangles that are lower are left out [m]: in single precision, a kilometer from the origin, they have no area."""
LAP = 3e-4
"""Areas reach this far over their neighbors [m], so that no crack is left between rounded corners."""
EVERY = 0.25
"""Distance of the samples that a point is related to a road by [m]."""


@dataclass(frozen=True)
class _CrossingRoad:
    """A road of the junction, prepared for heights."""

    shape: RoadShape
    tree: scipy.spatial.cKDTree
    s: np.ndarray
    xy: np.ndarray
    heading: np.ndarray
    right: np.ndarray
    left: np.ndarray


def build_junction(name: str, shapes: list[RoadShape], seams: np.ndarray, outside: shapely.Geometry) -> Sheet:
    """Return the surface of a junction.

    Args:
        name: Name of the junction, an identifier.
        shapes: The roads that cross it.
        seams: Vertices of the ends of the roads outside [m], shape [N, 3].
        outside: What the roads outside cover in plan; it is left to them.
    """
    areas = {kind: [] for kind in MATERIAL}
    for shape in shapes:
        for kind, polygon in _areas(shape):
            areas[kind].append(polygon)
    paved = _fill(shapely.union_all(areas["paved"], grid_size=1e-4))
    walk = shapely.union_all(areas["walk"], grid_size=1e-4)
    green = shapely.union_all(areas["green"], grid_size=1e-4)
    if len(seams):
        corners = shapely.multipoints(seams[:, :2])
        paved, walk, green = (shapely.snap(area, corners, SNAP) for area in (paved, walk, green))
    paved, walk, green = (_repair(area) for area in (paved, walk, green))
    overlap = shapely.intersection(shapely.union_all([paved, walk, green]), outside)
    if overlap.area > MIN_OVERLAP:
        paved, walk, green = (subtract_area(area, outside, 1e-4) for area in (paved, walk, green))
    walk = subtract_area(walk, paved, 1e-4)
    green = subtract_area(green, shapely.union(paved, walk), 1e-4)
    paved, walk, green = (area.buffer(LAP, join_style="mitre") for area in (paved, walk, green))
    roads = [_prepare(shape) for shape in shapes]
    sheet = Sheet(name, outline=shapely.union_all([paved, walk, green], grid_size=1e-4))
    for kind, area in (("paved", paved), ("walk", walk), ("green", green)):
        _add_area(sheet, MATERIAL[kind], area, roads, KERB_HEIGHT if kind == "walk" else 0.0)
    return sheet


def _areas(shape: RoadShape) -> list[tuple[str, shapely.Geometry]]:
    """Kind of surface and area in plan of every stretch of neighboring lanes of one kind."""
    found = []
    for section in shape.road.sections:
        s = choose_rows(shape, section.start, section.end, breaks(shape, section, with_paint=False))
        borders = shape.borders(section, s)
        runs: list[tuple[str, np.ndarray, np.ndarray]] = []
        for number in sorted(borders):
            if not number:
                continue
            inner, outer = borders[number]
            low, high = (outer, inner) if number < 0 else (inner, outer)
            kind = surface_of(section.lanes[number].kind)
            if runs and runs[-1][0] == kind:
                runs[-1] = (kind, runs[-1][1], high)
            else:
                runs.append((kind, low, high))
        for kind, low, high in runs:
            if np.max(high - low) < 1e-3:
                continue
            found.append((kind, _strip(shape.place(s, low)[:, :2], shape.place(s, high)[:, :2])))
    return found


def _strip(low: np.ndarray, high: np.ndarray) -> shapely.Geometry:
    """Return the area between two borders, each [N, 2]; in tight turns its ring crosses itself."""
    whole = shapely.Polygon(np.concatenate([low, high[::-1]]))
    if whole.is_valid:
        return whole
    cells = shapely.polygons(np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1))
    return shapely.union_all([p for cell in shapely.make_valid(cells) for p in polygons_of(cell, 0.0)], grid_size=1e-4)


def _repair(area: shapely.Geometry) -> shapely.Geometry:
    """Return the valid areas of a geometry; a spike that snapping folds flat becomes a line, which has none."""
    return shapely.union_all(polygons_of(shapely.make_valid(area), 0.0))


def _fill(area: shapely.Geometry) -> shapely.Geometry:
    """Return an area without its small holes."""
    filled = []
    for polygon in polygons_of(area, 0.0):
        holes = [ring for ring in polygon.interiors if shapely.Polygon(ring).area >= MAX_HOLE]
        filled.append(shapely.Polygon(polygon.exterior, holes))
    return shapely.union_all(filled)


def _prepare(shape: RoadShape) -> _CrossingRoad:
    count = max(2, int(np.ceil(shape.road.length / EVERY)) + 1)
    s = np.linspace(0.0, shape.road.length, count)
    xy, heading = shape.line.at(s)
    right, left = np.zeros(count), np.zeros(count)
    for section in shape.road.sections:
        mask = (s >= section.start - 1e-9) & (s <= section.end + 1e-9)
        borders = shape.borders(section, s[mask])
        right[mask], left[mask] = borders[min(borders)][1], borders[max(borders)][1]
    return _CrossingRoad(shape, scipy.spatial.cKDTree(xy), s, xy, heading, right, left)


def _blend(roads: list[_CrossingRoad], xy: np.ndarray) -> np.ndarray:
    """Return the height of the junction at points in plan [N, 2], without kerbs [m], shape [N]."""
    total, weights = np.zeros(len(xy)), np.zeros(len(xy))
    for road in roads:
        _, k = road.tree.query(xy)
        cos, sin = np.cos(road.heading[k]), np.sin(road.heading[k])
        offset = xy - road.xy[k]
        along = offset[:, 0] * cos + offset[:, 1] * sin
        s = np.clip(road.s[k] + along, 0.0, road.s[-1])
        beyond = np.abs(road.s[k] + along - s)
        t = offset[:, 1] * cos - offset[:, 0] * sin
        inside = np.minimum(t - road.right[k], road.left[k] - t)
        clamped = np.clip(t, road.right[k], road.left[k])
        away = np.maximum(-inside, 0.0) + beyond
        weight = np.where(away < 1e-3, np.maximum(inside, 0.0) + 1e-3, 1e-6 / (away + 1e-3) ** 2)
        z = road.shape.road.elevation.at(s) + clamped * np.tan(road.shape.road.superelevation.at(s))
        total += weight * z
        weights += weight
    return total / weights


def _add_area(sheet: Sheet, material: str, area: shapely.Geometry, roads: list[_CrossingRoad], dz: float) -> None:
    """Triangulate an area of one material into a sheet."""
    parts = polygons_of(area, 1e-3)
    if not parts:
        return
    corners = shapely.get_coordinates(parts)
    inner = np.concatenate([road.xy for road in roads])
    probe = np.concatenate([corners, inner])
    z = _blend(roads, probe)
    plane = np.column_stack([probe, np.ones(len(probe))])
    off = z - plane @ np.linalg.lstsq(plane, z, rcond=None)[0]
    if np.abs(off).max() > FLAT:
        parts = _cut(parts)
    triangles = triangulate_polygons(parts)
    longest = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    triangles = triangles[twice_areas(triangles) > MIN_HEIGHT * longest]
    xy, faces = np.unique(triangles.reshape(-1, 2), axis=0, return_inverse=True)
    index = sheet.surface.add_points(np.column_stack([xy, _blend(roads, xy) + dz]))
    sheet.surface.add_faces(material, index[faces.reshape(-1)].reshape(-1, 3))


def _cut(parts: list[shapely.Polygon]) -> list[shapely.Polygon]:
    """Cut polygons by a square grid."""
    low = np.floor(np.min([p.bounds[:2] for p in parts], axis=0) / CELL)
    high = np.ceil(np.max([p.bounds[2:] for p in parts], axis=0) / CELL)
    x, y = (np.arange(low[k], high[k]) * CELL for k in range(2))
    corner = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    cells = shapely.box(corner[:, 0], corner[:, 1], corner[:, 0] + CELL, corner[:, 1] + CELL)
    found = []
    for part in parts:
        pieces = shapely.intersection(part, cells, grid_size=1e-6)
        found += [p for piece in pieces for p in polygons_of(piece, 1e-8)]
    return found
