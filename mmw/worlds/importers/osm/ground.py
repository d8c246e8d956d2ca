"""The ground of an OpenStreetMap extract: one plane, parted into carriageways, sidewalks, water and green."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

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
KERB_HEIGHT = 0.14
"""Height of sidewalks beside lanes above the carriageway [m]; design value, as in OpenDRIVE imports."""
GRID = 1e-3
"""Grid that the lines of the plan are snapped to [m]."""
SLIVER = 0.01
"""Faces that are thinner belong to a neighbor [m]; design value, ten times the grid."""
COVERED = 0.6
"""A road is not drawn again where lanes cover this share of its line [-]; design value."""
NEAR = 3.0
"""Distance from lanes that counts as covered [m]; design value."""
SURFACES = (
    ("paint", "Roads/marking", "road_marking", "road_line"),
    ("paved", "Roads/lanes", "asphalt", "road"),
    ("raised", "Sidewalks/raised", "concrete_sidewalk", "sidewalk"),
    ("road", "Roads/street", "asphalt", "road"),
    ("walk", "Sidewalks/walk", "concrete_sidewalk", "sidewalk"),
    ("water", "Terrain/water", "water", "water"),
    ("green", "Terrain/ground", "grass", "terrain"),
)
"""Kind, path, material and label; the first of two that overlap counts."""


@dataclass(frozen=True)
class GroundPlan:
    """The ground in plan."""

    layers: dict[str, shapely.Geometry]
    """Kind -> area, without `green`; areas may overlap."""
    frame: shapely.Polygon
    """Border of the ground."""


def plan_ground(
    extract: Extract, buildings: list[shapely.Polygon], lanes: Mapping[str, shapely.Geometry] | None = None
) -> tuple[GroundPlan, list[str]]:
    """Return the area of every kind of ground in plan, and notes for people.

    Args:
        extract: The extract.
        buildings: What stands on the ground.
        lanes: Areas of lanes, sidewalks beside them and paint: `paved`, `raised`, `paint`; roads there are not drawn.

    Raises:
        InputError: If there are neither buildings nor roads.
    """
    found: dict[str, list[shapely.Geometry]] = {"road": [], "walk": [], "water": []}
    notes, tunnels, bridges = [], 0, 0
    driven = lanes["paved"].buffer(NEAR, quad_segs=2) if lanes else shapely.Polygon()
    shapely.prepare(driven)
    for way in extract.ways:
        tags = way.tags
        if tags.get("tunnel", "no") not in ("no", "building_passage") or tags.get("indoor", "no") != "no":
            tunnels += "highway" in tags
            continue
        bridges += "highway" in tags and tags.get("bridge", "no") != "no"
        if lanes and tags.get("highway") in WIDTH and len(way.xy) > 1:
            line = shapely.LineString(way.xy)
            if shapely.intersection(line, driven).length > COVERED * line.length:
                continue
        for kind, area in strips(way):
            found[kind].append(area)
    add_areas(extract, found)
    if not buildings and all(area.is_empty for kind in ("road", "walk") for area in found[kind]) and not lanes:
        raise InputError(
            f"{extract.path}: holds neither buildings nor roads; an extract with them is needed; choose another area"
        )
    if tunnels:
        notes.append(f"{tunnels} roads in tunnels left out")
    if bridges:
        notes.append(f"{bridges} roads on bridges lie on the ground: the world is flat")
    every = [*buildings, *(area for areas in found.values() for area in areas), *(lanes or {}).values()]
    x0, y0, x1, y1 = shapely.total_bounds(np.array(every))
    frame = shapely.box(*np.round([x0 - MARGIN, y0 - MARGIN, x1 + MARGIN, y1 + MARGIN], 3))
    return GroundPlan({**(lanes or {}), **{kind: _union(areas) for kind, areas in found.items()}}, frame), notes


def _union(areas: list[shapely.Geometry]) -> shapely.MultiPolygon:
    return shapely.MultiPolygon(polygons_of(shapely.union_all(areas, grid_size=GRID), 0.0))


def add_areas(extract: Extract, found: Mapping[str, list[shapely.Geometry]]) -> None:
    """Add the areas of an extract that are ground of a kind, such as parks and waters, to those found before."""
    for feature in (*extract.ways, *extract.relations):
        kind = area_kind(feature.tags)
        if feature.area is not None and kind:
            found[kind].append(feature.area)


def strips(way: Feature) -> list[tuple[str, shapely.Geometry]]:
    """Return the areas that a highway covers, each with its kind of ground: `road` or `walk`."""
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


def area_kind(tags: dict[str, str]) -> str:
    """Return the kind of ground that an area with tags is: `road`, `walk`, `water`, or empty."""
    if tags.get("natural") == "water" or tags.get("waterway") == "riverbank":
        return "water"
    if tags.get("amenity") == "parking" and tags.get("parking", "surface") == "surface":
        return "road"
    if tags.get("area:highway") in WIDTH or (tags.get("area") == "yes" and tags.get("highway") in WIDTH):
        return "road"
    is_square = tags.get("area") == "yes" and tags.get("highway") in WALK
    return "walk" if is_square or tags.get("place") == "square" else ""


def build_ground(plan: GroundPlan) -> list[MeshPart]:
    """Return the ground as meshes, one for each kind and tile of 100 m: the plane z = 0, and raised sidewalks.

    The borders of all areas part the plane into faces that share their corners, so nothing overlaps and nothing gapes.
    """
    faces = _faces(plan)
    inside = shapely.point_on_surface(faces)
    kind = np.full(len(faces), len(SURFACES) - 1)
    for rank in reversed(range(len(SURFACES) - 1)):
        area = plan.layers.get(SURFACES[rank][0], shapely.Polygon())
        shapely.prepare(area)
        kind[shapely.contains(area, inside)] = rank
    kind = _without_slivers(faces, kind)
    origin = np.array(plan.frame.bounds[:2])
    tile = np.floor((shapely.get_coordinates(inside) - np.floor(origin / TILE) * TILE) / TILE).astype(int)
    groups: dict[tuple[int, int, int], list[int]] = defaultdict(list)
    for k, key in enumerate(zip(kind.tolist(), *tile.T.tolist(), strict=True)):
        groups[key].append(k)
    parts = []
    for (rank, i, j), members in sorted(groups.items()):
        name, path, material, label = SURFACES[rank]
        mesh = _flat(faces[members], KERB_HEIGHT if name == "raised" else 0.0)
        if len(mesh.faces):
            parts.append(MeshPart.of(f"{path}_{i:02d}_{j:02d}", mesh, material, label))
        if name == "raised":
            kerb = _kerbs(faces[members], faces[kind == rank])
            if len(kerb.faces):
                parts.append(MeshPart.of(f"Sidewalks/kerb_{i:02d}_{j:02d}", kerb, "curb", "sidewalk"))
    return parts


def _faces(plan: GroundPlan) -> np.ndarray:
    """Return the polygons into which the borders of all areas, and those of the tiles, part the frame."""
    x0, y0, x1, y1 = plan.frame.bounds
    lines: list[shapely.Geometry] = [plan.frame.exterior]
    lines += [shapely.LineString([(x, y0), (x, y1)]) for x in np.arange(np.floor(x0 / TILE) + 1, x1 / TILE) * TILE]
    lines += [shapely.LineString([(x0, y), (x1, y)]) for y in np.arange(np.floor(y0 / TILE) + 1, y1 / TILE) * TILE]
    for area in plan.layers.values():
        lines += [polygon.boundary for polygon in polygons_of(shapely.intersection(area, plan.frame), 0.0)]
    noded = shapely.union_all(np.array([line for line in lines if not line.is_empty]), grid_size=GRID)
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts([noded])))
    return np.asarray(faces)[shapely.area(faces) > 1e-5]


def _without_slivers(faces: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """Return the kinds of faces [F], those of slivers replaced by that of the neighbor with the longest common border.

    Borders that nearly coincide leave slivers, whose kerbs would lie in one plane.
    """
    is_sliver = 2.0 * shapely.area(faces) < SLIVER * shapely.length(faces)
    thin = np.flatnonzero(is_sliver)
    if not len(thin):
        return kind
    own, other = shapely.STRtree(faces).query(faces[thin], predicate="intersects")
    own, other = own[~is_sliver[other]], other[~is_sliver[other]]
    shared = shapely.length(shapely.intersection(shapely.boundary(faces[thin[own]]), shapely.boundary(faces[other])))
    found = kind.copy()
    for k, face in enumerate(thin):
        near = own == k
        if near.any():
            found[face] = kind[other[near][np.argmax(shared[near])]]
    return found


def _flat(polygons: np.ndarray, height: float) -> TriangleMesh:
    """Return polygons as upward triangles at a height [m]."""
    if not len(polygons):
        return EMPTY
    triangles = triangulate_polygons(list(polygons))
    triangles = triangles[twice_areas(triangles) > 1e-8]
    return weld(separate(np.column_stack([triangles.reshape(-1, 2), np.full(3 * len(triangles), height)])))


def _kerbs(polygons: np.ndarray, every: np.ndarray) -> TriangleMesh:
    """Return vertical faces below the borders of raised polygons where no other raised one, of `every`, follows."""
    raised = set(_edges(every))
    outer = np.array([edge for edge in _edges(polygons) if (edge[1], edge[0]) not in raised]).reshape(-1, 2, 2)
    if not len(outer):
        return EMPTY
    a, b = outer[:, 0], outer[:, 1]
    low_a, low_b = (np.pad(p, ((0, 0), (0, 1))) for p in (a, b))
    top_a, top_b = (p + np.array([0.0, 0.0, KERB_HEIGHT]) for p in (low_a, low_b))
    quad = np.stack([low_a, low_b, top_b, low_a, top_b, top_a], axis=1).reshape(-1, 3)
    return weld(separate(quad))


def _edges(polygons: np.ndarray) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Return the edges of polygons, each with its polygon on its left."""
    found = []
    for polygon in shapely.orient_polygons(polygons):
        for ring in (polygon.exterior, *polygon.interiors):
            xy = [tuple(point) for point in np.round(shapely.get_coordinates(ring), 6).tolist()]
            found += list(pairwise(xy))
    return found
