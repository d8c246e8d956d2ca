"""Merge maps: what an OpenStreetMap extract has around the roads of an OpenDRIVE file, placed by their georeference."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.core.mesh import TriangleMesh, merge
from mmw.worlds.importers.blocks.layout import OPEN_GROUND, plan_of
from mmw.worlds.importers.geo.drape import stand
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.osm.buildings import find_bodies
from mmw.worlds.importers.osm.feature import Extract, Feature, is_building
from mmw.worlds.importers.osm.ground import WIDTH, add_areas, strips
from mmw.worlds.importers.osm.materials import Palette
from mmw.worlds.importers.osm.quarter import build_quarter
from mmw.worlds.importers.osm.read_osm import NOTICE, WATER, place_trees
from mmw.worlds.importers.osm.xml import read_extract
from mmw.worlds.towns.ground_height import Ground
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.paved_areas import Region, pave
from mmw.worlds.towns.plan_geometry import polygons_of, subtract_area, triangulate_polygons

CLEAR = 0.3
"""Distance of buildings from carriageways and sidewalks [m]; design value."""
KEPT = 0.5
"""A building of which less than this share lies beside the roads is left out [-]; design value."""
FOLLOWED = 3.0
"""A street of the extract within this distance of a road's surface is that road [m]; design value."""
AROUND = 30.0
"""How far the ground reaches beyond what is merged [m]; design value."""
TRUNK = 0.8
"""Trees nearer to carriageways and sidewalks are left out [m]; design value."""
HEADROOM = 4.6
"""Height of crowns over roads [m]: 4.5 m for trucks, and a decimeter."""
COARSE = 25.0
"""Largest distance of the vertices of added ground [m]; design value."""
SLIVER = 2e-4
"""Triangles of cut ground that are lower are left out [m]: in single precision, a kilometer away, they have no area."""
FLOATS = 1e-3
"""Grid of the areas [m]."""
SURFACES = {
    "road": ("Roads/street", "asphalt", "road"),
    "walk": ("Sidewalks/street", "concrete_sidewalk", "sidewalk"),
    "water": ("Terrain/water", "water", "water"),
}
"""Kind of ground -> path, material and label; the first of two that overlap counts."""


@dataclass
class _Counts:
    cut: int = 0
    """Buildings that lost a part."""
    dropped: int = 0
    """Buildings that were left out."""
    streets: int = 0
    """Streets that are left to the roads."""
    notes: list[str] = field(default_factory=list)

    def lines(self, name: str) -> list[str]:
        """Return notes for people."""
        found = list(self.notes)
        if self.cut or self.dropped:
            found.append(
                f"{name}: {self.cut} buildings reached into roads and were cut, {self.dropped} stood on them and were "
                "left out"
            )
        if self.streets:
            found.append(f"{name}: {self.streets} streets left to the roads that follow them")
        return found


def merge_extract(scene: ImportedScene, path: Path) -> ImportedScene:
    """Return a world of roads with the buildings, trees and areas of an extract around them.

    Roads, sidewalks, lanes and heights are those of the world. Streets of the extract are built where no road follows
    them. The ground is one surface: areas of the extract are cut out of it, and it is widened as far as they reach.

    Args:
        scene: A world with roads and a place on the earth: `projection` or `georeference`.
        path: The extract.

    Raises:
        InputError: If the world has no place on the earth, the extract cannot be used, or it lies elsewhere.
    """
    extract = read_extract(path, None, place=_placing(scene, path))
    ground = [part for part in scene.parts if part.path.startswith(OPEN_GROUND)]
    if not ground:
        raise InputError(f"{path}: cannot be merged: the roads have no ground around them; import an OpenDRIVE file")
    counts = _Counts(notes=[f"{path.name}: {note}" for note in extract.notes])
    labels = ("road", "road_line", "sidewalk", "bridge")
    surface = plan_of([part for part in scene.parts if part.label in labels])
    corridor = plan_of([part for part in scene.parts if part not in ground and part.label in (*labels, "terrain")])
    _check_near(path, extract, surface)
    _cut_features(extract, surface, counts)
    regions = _regions(extract, corridor)
    plans = [f.area for f in (*extract.ways, *extract.relations) if f.area is not None and is_building(f.tags)]
    widened = _widened(ground, [*plans, *(region.area for region in regions)])
    paved = [_without_slivers(part) for part in pave(widened, regions)]
    height = Ground([part for part in (*scene.parts, *paved) if part.label != "building"]).height
    palette = Palette()
    bodies, notes = find_bodies(extract, palette)
    bodies, buildings, apart = build_quarter(bodies, height=lambda xy: np.nan_to_num(height(*xy.T)))
    trees = _stand_trees(place_trees(extract, bodies, None), height, surface)
    others = [part for part in scene.parts if part not in ground]
    parts = [*others, *paved, *buildings, *trees]
    foreign = {WATER.name: WATER} if any(part.material == WATER.name for part in parts) else {}
    return replace(
        scene,
        parts=parts,
        materials={**scene.materials, **palette.foreign, **foreign},
        notes=(*scene.notes, *(f"{path.name}: {note}" for note in (*notes, *apart)), *counts.lines(path.name)),
        notice=NOTICE,
    )


def _placing(scene: ImportedScene, path: Path) -> Callable[[np.ndarray], np.ndarray]:
    """Return the map of latitudes and longitudes [deg] to the world [m], shape [N, 2] each."""
    if scene.projection is not None:
        return scene.projection.world
    if scene.georeference is not None:
        return scene.georeference.world
    raise InputError(
        f"{path}: cannot be placed, for the roads have no <geoReference>; write one into their file, or give "
        "--geo-origin LATITUDE LONGITUDE of its point (0, 0)"
    )


def _check_near(path: Path, extract: Extract, surface: shapely.Geometry) -> None:
    """Raise InputError if an extract lies beside the roads: another place, or a wrong georeference."""
    found = [f.xy for f in extract.ways if len(f.xy)]
    found += [shapely.get_coordinates(f.area) for f in extract.relations if f.area is not None]
    every = np.concatenate(found) if found else np.zeros((0, 2))
    low, high = np.reshape(surface.bounds, (2, 2))
    if not len(every) or (every.max(axis=0) < low).any() or (every.min(axis=0) > high).any():
        middle = 0.5 * (every.min(axis=0) + every.max(axis=0)) if len(every) else np.full(2, np.nan)
        away = float(np.linalg.norm(middle - 0.5 * (low + high))) / 1e3
        raise InputError(
            f"{path}: lies {away:.1f} km from the roads, beside all of them; give an extract of their place, or "
            "correct their <geoReference> by --geo-origin LATITUDE LONGITUDE"
        )


def _cut_features(extract: Extract, surface: shapely.Geometry, counts: _Counts) -> None:
    """Cut buildings and streets of an extract at roads, and leave out trees on them."""
    near = shapely.buffer(surface, CLEAR, join_style="mitre")
    followed = shapely.buffer(surface, FOLLOWED)
    for area in (near, followed):
        shapely.prepare(area)
    extract.points = [f for f in extract.points if not shapely.contains_xy(near, *f.xy[0])]
    for name in ("ways", "relations"):
        kept: list[Feature] = []
        for feature in getattr(extract, name):
            if feature.area is not None and is_building(feature.tags):
                kept += _beside(feature, near, counts)
            elif len(feature.xy) > 1 and feature.tags.get("highway"):
                kept += _not_followed(feature, followed, counts)
            else:
                kept.append(feature)
        setattr(extract, name, kept)


def _beside(feature: Feature, near: shapely.Geometry, counts: _Counts) -> list[Feature]:
    area = feature.area
    if area is None or not shapely.intersects(near, area):
        return [feature]
    if feature.tags.get("location") == "underground" or float(feature.tags.get("layer", "0") or 0) < 0:
        return []
    rest = polygons_of(shapely.difference(area, near, grid_size=FLOATS), 1.0)
    if sum(part.area for part in rest) < KEPT * area.area:
        counts.dropped += 1
        return []
    counts.cut += 1
    return [replace(feature, xy=np.zeros((0, 2)), area=shapely.MultiPolygon(rest))]


def _not_followed(feature: Feature, followed: shapely.Geometry, counts: _Counts) -> list[Feature]:
    line = shapely.LineString(feature.xy)
    if not shapely.intersects(followed, line):
        return [feature]
    counts.streets += feature.tags["highway"] in WIDTH
    rest = [part for part in shapely.get_parts(shapely.difference(line, followed)) if part.length > FOLLOWED]
    return [replace(feature, xy=shapely.get_coordinates(part), area=None) for part in rest]


def _regions(extract: Extract, corridor: shapely.Geometry) -> list[Region]:
    """Return the streets, walks and waters of an extract beside the roads, without overlaps."""
    found: dict[str, list[shapely.Geometry]] = {kind: [] for kind in SURFACES}
    for way in extract.ways:
        if way.tags.get("tunnel", "no") == "no" and way.tags.get("indoor", "no") == "no":
            for kind, area in strips(way):
                found[kind].append(area)
    add_areas(extract, found)
    taken = shapely.buffer(corridor, 0.0)
    regions = []
    for kind, areas in found.items():
        whole = shapely.MultiPolygon(polygons_of(shapely.union_all(areas, grid_size=FLOATS), 0.0))
        area = subtract_area(whole, taken, FLOATS)
        area = shapely.MultiPolygon(
            [part for part in polygons_of(area, 0.5) if not shapely.is_empty(part.buffer(-0.1))]
        )
        if not area.is_empty:
            path, material, label = SURFACES[kind]
            regions.append(Region(path, area, material, label))
            taken = shapely.union(taken, area, grid_size=FLOATS)
    return regions


def _without_slivers(part: MeshPart) -> MeshPart:
    corners = part.mesh.corners
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    mesh = part.mesh.select(2.0 * part.mesh.areas > SLIVER * longest)
    return replace(part, points=mesh.points, faces=mesh.faces)


def _widened(ground: list[MeshPart], areas: list[shapely.Geometry]) -> list[MeshPart]:
    """Return ground that reaches beyond some areas: a frame around it, level outward from its border."""
    corners = np.concatenate([part.points[:, :2] for part in ground])
    low, high = corners.min(axis=0), corners.max(axis=0)
    if not areas:
        return ground
    x0, y0, x1, y1 = shapely.total_bounds(np.array(areas))
    least, most = np.minimum(low, [x0 - AROUND, y0 - AROUND]), np.maximum(high, [x1 + AROUND, y1 + AROUND])
    if (least == low).all() and (most == high).all():
        return ground
    mesh = merge(part.mesh for part in ground)
    border = _border(mesh)
    frame = shapely.segmentize(shapely.Polygon(shapely.box(*least, *most).exterior, [border[:, :2]]), COARSE)
    triangles = triangulate_polygons(frame)
    xy, index = np.unique(triangles.reshape(-1, 2), axis=0, return_inverse=True)
    ring = shapely.STRtree(shapely.points(border[:, :2]))
    z = border[ring.nearest(shapely.points(xy)), 2]
    points = np.column_stack([xy, z])
    around = TriangleMesh(points, index.reshape(-1, 3).astype(np.int32))
    first = ground[0]
    return [*ground, MeshPart.of(f"{OPEN_GROUND}_around", around, first.material, first.label)]


def _border(mesh: TriangleMesh) -> np.ndarray:
    """Return the outer border of a mesh that lies like terrain [m], shape [N, 3], without the repeated first vertex."""
    points, inverse = np.unique(np.round(mesh.points, 6), axis=0, return_inverse=True)
    faces = inverse.reshape(-1)[mesh.faces]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    _, back, count = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    after = dict(edges[count[back.reshape(-1)] == 1].tolist())
    start = int(np.lexsort((points[:, 1], points[:, 0]))[0])
    ring = [start]
    while (following := after[ring[-1]]) != start:
        ring.append(following)
    return points[ring]


def _stand_trees(parts: list[MeshPart], height: Callable[..., np.ndarray], surface: shapely.Geometry) -> list[MeshPart]:
    """Return trees on the ground, without those on roads; where a crown reaches over one, the tree is taller."""
    objects: dict[str, list[MeshPart]] = {}
    for part in parts:
        objects.setdefault("/".join(part.path.split("/")[:2]), []).append(part)
    shapely.prepare(surface)
    made = []
    for members in objects.values():
        whole = np.concatenate([part.points for part in members])
        foot = whole[whole[:, 2] <= 0.0, :2].mean(axis=0)
        if shapely.dwithin(surface, shapely.Point(foot), TRUNK):
            continue
        if shapely.intersects(surface, shapely.convex_hull(shapely.multipoints(whole[:, :2]))):
            low = min(float(part.points[:, 2].min()) for part in members if part.points[:, 2].min() > 0.0)
            tall = np.array([1.0, 1.0, max(1.0, HEADROOM / low)])
            members = [replace(part, points=part.points * tall) for part in members]
        made += stand(members, lambda xy: np.nan_to_num(height(*xy.T)))
    return made
