"""The ground of an OpenStreetMap extract: one plane, parted into carriageways, sidewalks, water and green."""

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.core.mesh import EMPTY, TriangleMesh, separate
from mmw.worlds.importers.osm.feature import Extract, Feature
from mmw.worlds.importers.osm.xml import length_m, number
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.plan_geometry import polygons_of, triangulate_polygons, twice_areas
from mmw.worlds.towns.primitives import weld

WIDTH = {
    "motorway": 11.5, "trunk": 10.5, "primary": 9.0, "secondary": 8.0, "tertiary": 7.0, "unclassified": 6.0,
    "residential": 6.0, "living_street": 5.0, "service": 4.0, "road": 6.0, "busway": 4.0, "track": 3.0,
    "motorway_link": 5.0, "trunk_link": 5.0, "primary_link": 5.0, "secondary_link": 5.0, "tertiary_link": 5.0,
}  # fmt: skip
"""Class of a road -> width of its carriageway [m] where the way has neither width nor lanes; design values."""
WALK = {"pedestrian": 5.0, "footway": 2.0, "path": 1.5, "cycleway": 2.0, "steps": 2.0}
"""Class of a way on foot -> width [m]; design values."""
LANE = 3.25
"""Width of a lane where the way has `lanes` only [m]; design value."""
SIDEWALK = 2.0
"""Width of a sidewalk along a road that has the tag [m]; design value."""
MARGIN = 30.0
"""How far the ground reaches beyond everything else [m]; design value."""
TILE = 100.0
"""Size of the pieces that the ground is cut into [m]; design value."""
SURFACES = (
    ("road", "Roads/street", "asphalt", "road"),
    ("walk", "Sidewalks/walk", "concrete_sidewalk", "sidewalk"),
    ("water", "Terrain/water", "water", "water"),
    ("green", "Terrain/ground", "grass", "terrain"),
)
"""Kind, path, material and label; the first of two that overlap counts."""


def plan_ground(extract: Extract, buildings: list[shapely.Polygon]) -> tuple[dict[str, shapely.Geometry], list[str]]:
    """Return the area of every kind of ground in plan, without overlaps, and notes for people.

    Raises:
        InputError: If there are neither buildings nor roads.
    """
    found: dict[str, list[shapely.Geometry]] = {"road": [], "walk": [], "water": []}
    notes, tunnels, bridges = [], 0, 0
    for way in extract.ways:
        tags = way.tags
        if tags.get("tunnel", "no") not in ("no", "building_passage") or tags.get("indoor", "no") != "no":
            tunnels += "highway" in tags
            continue
        bridges += "highway" in tags and tags.get("bridge", "no") != "no"
        for kind, area in _strips(way):
            found[kind].append(area)
    for feature in (*extract.ways, *extract.relations):
        kind = _area_kind(feature.tags)
        if feature.area is not None and kind:
            found[kind].append(feature.area)
    if not buildings and all(area.is_empty for kind in ("road", "walk") for area in found[kind]):
        raise InputError(
            f"{extract.path}: holds neither buildings nor roads; an extract with them is needed; choose another area"
        )
    if tunnels:
        notes.append(f"{tunnels} roads in tunnels left out")
    if bridges:
        notes.append(f"{bridges} roads on bridges lie on the ground: the world is flat")
    every = [*buildings, *(area for areas in found.values() for area in areas)]
    x0, y0, x1, y1 = shapely.total_bounds(np.array(every))
    free: shapely.Geometry = shapely.box(x0 - MARGIN, y0 - MARGIN, x1 + MARGIN, y1 + MARGIN)
    plan = {}
    for kind, areas in found.items():
        area = _polygons(shapely.intersection(shapely.union_all(areas, grid_size=1e-3), free, grid_size=1e-3))
        plan[kind] = area
        free = _polygons(shapely.difference(free, area, grid_size=1e-3))
    return {**plan, "green": free}, notes


def _polygons(area: shapely.Geometry) -> shapely.MultiPolygon:
    """Return an area without the lines and points in which two areas touch: overlays take no mixed dimensions."""
    return shapely.MultiPolygon(polygons_of(area, 0.0))


def _strips(way: Feature) -> list[tuple[str, shapely.Geometry]]:
    """Areas that a highway covers."""
    kind = way.tags.get("highway", "")
    if len(way.xy) < 2 or way.tags.get("area") == "yes" or (kind not in WIDTH and kind not in WALK):
        return []
    line = shapely.LineString(way.xy)
    given, lanes = length_m(way.tags.get("width")), number(way.tags.get("lanes"))
    width = given or (lanes * LANE if lanes and kind in WIDTH else None)
    if width is None:
        width = WIDTH.get(kind) or WALK[kind]
        if kind in WIDTH and way.tags.get("oneway") in ("yes", "1", "true", "-1"):
            width = min(width, max(0.6 * width, 4.0))
    built: list[tuple[str, shapely.Geometry]] = [
        ("walk" if kind in WALK else "road", line.buffer(0.5 * width, quad_segs=4))
    ]
    sides = {"both": (1, -1), "yes": (1, -1), "left": (1,), "right": (-1,)}.get(way.tags.get("sidewalk", ""), ())
    if kind in WIDTH:
        for side in sides:
            reach = side * (0.5 * width + SIDEWALK)
            built.append(("walk", line.buffer(reach, single_sided=True, quad_segs=4, join_style="round")))
    return built


def _area_kind(tags: dict[str, str]) -> str:
    if tags.get("natural") == "water" or tags.get("waterway") == "riverbank":
        return "water"
    if tags.get("amenity") == "parking" and tags.get("parking", "surface") == "surface":
        return "road"
    if tags.get("area:highway") in WIDTH or (tags.get("area") == "yes" and tags.get("highway") in WIDTH):
        return "road"
    is_square = tags.get("area") == "yes" and tags.get("highway") in WALK
    return "walk" if is_square or tags.get("place") == "square" else ""


def build_ground(plan: dict[str, shapely.Geometry]) -> list[MeshPart]:
    """Return the ground as meshes in the plane z = 0, one for each kind and tile of 100 m."""
    low = np.floor(np.array(shapely.bounds(plan["green"]))[:2] / TILE)
    high = np.ceil(np.array(shapely.bounds(plan["green"]))[2:] / TILE)
    parts = []
    for kind, path, material, label in SURFACES:
        for i in range(int(low[0]), int(high[0])):
            for j in range(int(low[1]), int(high[1])):
                cell = shapely.box(i * TILE, j * TILE, (i + 1) * TILE, (j + 1) * TILE)
                mesh = _flat(shapely.intersection(plan[kind], cell, grid_size=1e-3))
                if len(mesh.faces):
                    name = f"{path}_{i - int(low[0]):02d}_{j - int(low[1]):02d}"
                    parts.append(MeshPart.of(name, mesh, material, label))
    return parts


def _flat(area: shapely.Geometry) -> TriangleMesh:
    """Return an area as upward triangles at height 0."""
    polygons = polygons_of(area, 1e-4)
    if not polygons:
        return EMPTY
    triangles = triangulate_polygons(polygons)
    triangles = triangles[twice_areas(triangles) > 1e-8]
    return weld(separate(np.column_stack([triangles.reshape(-1, 2), np.zeros(3 * len(triangles))])))
