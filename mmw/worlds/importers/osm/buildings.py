"""Buildings of an OpenStreetMap extract as closed solids: walls, roof and an underside below the ground.

Source of the tags: OpenStreetMap wiki, Simple 3D Buildings.
"""

from collections import defaultdict
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from mmw.core.mesh import TriangleMesh, merge, separate
from mmw.worlds.importers.mesh_cleanup import PrimNames
from mmw.worlds.importers.osm.feature import Extract, Feature
from mmw.worlds.importers.osm.materials import Palette
from mmw.worlds.importers.osm.windows import PANE, glazed_wall, window_frames
from mmw.worlds.importers.osm.xml import length_m, number
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.plan_geometry import triangulate_polygons
from mmw.worlds.towns.primitives import weld

LEVEL = 3.0
"""Height of a storey [m]; the wiki's rule of thumb."""
LEVELS = {
    "house": 2, "detached": 2, "semidetached_house": 2, "terrace": 2, "garage": 1, "garages": 1, "shed": 1, "hut": 1,
    "kiosk": 1, "roof": 1, "greenhouse": 1, "apartments": 4, "office": 5, "hotel": 5, "church": 4,
}  # fmt: skip
"""Type of building -> storeys where neither height nor levels are given; design values."""
BLIND = (
    "garage", "garages", "shed", "hut", "roof", "carport", "greenhouse", "barn", "silo", "storage_tank", "bunker",
    "tank", "transformer_tower", "ruins", "wall", "chimney", "column", "collapsed",
)  # fmt: skip
"""Types of buildings without windows."""
CANOPY = 0.5
"""Thickness of a building that is only a roof [m]; design value."""
UNKNOWN_LEVELS = 3
"""Storeys of all other types."""
FOOT = 0.5
"""How far buildings reach below the ground [m], so that no underside lies in its plane; design value."""
PITCH = 0.6
"""Rise of a roof of unknown height by half its span [-]: 31 degrees; design value."""
MIN_AREA = 1.0
"""Areas below this are no buildings [m^2]."""
FORMS = ("flat", "gabled", "hipped", "pyramidal")
"""Roof shapes that are built; others become flat."""


@dataclass(frozen=True)
class Body:
    """One building or building part: a prism with a roof."""

    name: str
    """Kind and number of the feature, such as `w123`, as a prim name of its own: JOSM's new features count down."""
    plan: shapely.Polygon
    """Counter-clockwise, holes clockwise [m]."""
    bottom: float
    eaves: float
    """Height of the top of the walls [m]."""
    rise: float
    """Height of the roof above them [m]; 0 for a flat one."""
    form: str
    facade: str
    roof: str
    storeys: int = 0
    """Storeys with windows; 0 for a building without."""


def find_bodies(extract: Extract, palette: Palette) -> tuple[list[Body], list[str]]:
    """Return the buildings of an extract in order of their ids, and notes for people."""
    outlines = _areas(extract, "building")
    parts = _areas(extract, "building:part")
    notes, bodies, guessed, odd = [], [], 0, 0
    names = PrimNames()
    covered = _with_parts(outlines, parts)
    for feature, _ in [*((f, k) for k, f in enumerate(outlines) if k not in covered), *((f, -1) for f in parts)]:
        tags = feature.tags
        top, bottom, rise, is_guess = _heights(feature)
        guessed += is_guess
        pieces = [piece for piece in shapely.get_parts([feature.area]) if piece.area >= MIN_AREA]
        for k, piece in enumerate(pieces):
            plan = shapely.orient_polygons(shapely.remove_repeated_points(piece, 0.01))
            form = roof_form(tags.get("roof:shape", "flat"), plan)
            odd += form != tags.get("roof:shape", "flat")
            height = 0.0 if form == "flat" else _rise(rise, plan, top - bottom)
            name = names.child("", feature.id if len(pieces) == 1 else f"{feature.id}_{k}")
            facade, roof = palette.facade(tags), palette.roof(tags, form)
            foot, eaves = bottom - (FOOT if bottom == 0 else 0.0), top - height
            storeys = _storeys(tags, facade, eaves - bottom)
            bodies.append(Body(name, plan, foot, eaves, height, form, facade, roof, storeys))
    if guessed:
        notes.append(
            f"{guessed} of {len(bodies)} buildings have neither height nor levels; the height of their type assumed"
        )
    if odd:
        notes.append(f"{odd} roofs of other shapes, or on plans too complex for theirs, were made flat")
    if covered:
        notes.append(f"{len(covered)} outlines left out, because their parts (building:part) are built")
    return bodies, notes


def _storeys(tags: dict[str, str], facade: str, height: float) -> int:
    """Return the storeys with windows between the bottom and the eaves, `height` [m] apart."""
    kind = tags.get("building", tags.get("building:part", ""))
    if kind in BLIND or facade.startswith("glass_facade"):
        return 0
    levels = (number(tags.get("building:levels")) or 0.0) - (number(tags.get("building:min_level")) or 0.0)
    if levels < 1 or not 2.2 <= height / levels <= 7.0:
        levels = max(1.0, height / LEVEL)
    return round(levels)


def _areas(extract: Extract, key: str) -> list[Feature]:
    found = [f for f in (*extract.ways, *extract.relations) if f.area is not None and f.tags.get(key, "no") != "no"]
    return [f for f in found if f.tags.get("location") != "underground"]


def _with_parts(outlines: list[Feature], parts: list[Feature]) -> set[int]:
    """Return the indices of the outlines that contain parts."""
    if not outlines or not parts:
        return set()
    tree = shapely.STRtree([f.area for f in outlines])
    inside = shapely.point_on_surface(np.array([f.area for f in parts]))
    return set(tree.query(inside, predicate="within")[1].tolist())


def _heights(feature: Feature) -> tuple[float, float, float | None, bool]:
    """Top, bottom and height of the roof if it is given [m], and whether the top is a guess."""
    tags = feature.tags
    rise, roof_levels = length_m(tags.get("roof:height")), number(tags.get("roof:levels"))
    if rise is None and roof_levels is not None and tags.get("roof:shape", "flat") != "flat":
        rise = roof_levels * LEVEL
    bottom = length_m(tags.get("min_height"))
    below = number(tags.get("building:min_level"))
    bottom = bottom if bottom is not None else LEVEL * (below or 0.0)
    top, levels = length_m(tags.get("height")), number(tags.get("building:levels"))
    is_guess = top is None and levels is None
    kind = tags.get("building", tags.get("building:part", ""))
    if top is None:
        walls = LEVEL * (levels if levels is not None else LEVELS.get(kind, UNKNOWN_LEVELS))
        top = walls + (rise or 0.0)
    if kind == "roof" and bottom <= 0.0:  # it stands on columns, which the map does not have
        bottom = top - (rise or 0.0) - CANOPY
    return max(top, bottom + 0.5), max(bottom, 0.0), rise, is_guess


def _corners(plan: shapely.Polygon) -> np.ndarray:
    """Corners of a plan without those on straight walls, shape [K, 2]."""
    return shapely.get_coordinates(shapely.simplify(plan.exterior, 0.05))[:-1]


def roof_form(wanted: str, plan: shapely.Polygon) -> str:
    """Return the roof shape that can be built on a plan."""
    count = len(shapely.get_coordinates(plan.exterior)) - 1
    if wanted not in FORMS or plan.interiors:
        return "flat"
    if wanted == "pyramidal":
        ring, middle = shapely.get_coordinates(plan.exterior), shapely.get_coordinates(plan.centroid)[0]
        a, b = ring[:-1] - middle, ring[1:] - middle
        return wanted if np.all(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 1e-6) else "flat"
    is_convex = plan.convex_hull.area < 1.001 * plan.area
    return wanted if count == 4 and len(_corners(plan)) == 4 and is_convex else "flat"


def _rise(given: float | None, plan: shapely.Polygon, height: float) -> float:
    span = np.sqrt(plan.area)
    if len(_corners(plan)) == 4:
        ring = shapely.get_coordinates(plan.exterior)
        span = float(np.linalg.norm(np.diff(ring, axis=0), axis=1).min())
    return min(given if given is not None else PITCH * 0.5 * span, 0.9 * height)


def shared_walls(bodies: list[Body]) -> dict[tuple, list[int]]:
    """Return wall -> buildings that have it, for walls of more than one; a wall is the unordered pair of its ends."""
    walls: dict[tuple, list[int]] = defaultdict(list)
    for k, body in enumerate(bodies):
        for ring in (body.plan.exterior, *body.plan.interiors):
            xy = np.round(shapely.get_coordinates(ring), 3)
            for a, b in pairwise(xy.tolist()):
                walls[tuple(sorted((tuple(a), tuple(b))))].append(k)
    return {wall: found for wall, found in walls.items() if len(found) > 1}


def build_body(body: Body, others: dict[tuple, list[Body]], windows: str = "single") -> list[MeshPart]:
    """Return the meshes of a building.

    Args:
        body: The building.
        others: Wall -> other buildings with the same wall; what they cover is left out.
        windows: `single` for each bay, `bands` for each storey, or `none`.
    """
    out: dict[str, list[TriangleMesh]] = {"facade": [], "roof": [], "windows": []}
    ring = shapely.get_coordinates(body.plan.exterior)[:-1]
    ridge = _ridge(body, ring)
    for border in (body.plan.exterior, *body.plan.interiors):
        xy = shapely.get_coordinates(border)
        for a, b in pairwise(xy):
            key = tuple(sorted((tuple(np.round(a, 3).tolist()), tuple(np.round(b, 3).tolist()))))
            covered = [(other.bottom, other.eaves) for other in others.get(key, [])]
            stretches = _uncovered(body.bottom, body.eaves, covered)
            for low, high in stretches:
                frames = wall_windows(body, a, b, windows) if stretches == [(body.bottom, body.eaves)] else ()
                if len(frames):
                    wall, panes = glazed_wall(a, b, low, high, frames)
                    out["facade"].append(wall)
                    out["windows"].append(panes)
                else:
                    out["facade"].append(_fan(np.array([[*a, low], [*b, low], [*b, high], [*a, high]])))
    out["facade"].append(_cap(body.plan, body.bottom, up=False))
    if ridge is None:
        out["roof"].append(_cap(body.plan, body.eaves, up=True))
    else:
        gables, slopes = _pitched(body, ring, ridge)
        out["facade"] += gables
        out["roof"] += slopes
    built = []
    for use, material in (("facade", body.facade), ("windows", PANE), ("roof", body.roof)):
        if not out[use]:
            continue
        built.append(MeshPart.of(f"Buildings/b_{body.name}/{use}", weld(merge(out[use])), material, "building"))
    return built


def wall_windows(body: Body, a: np.ndarray, b: np.ndarray, windows: str) -> np.ndarray:
    """Return the windows of a wall between two corners in plan, shape [N, 4], as `window_frames` does."""
    if not body.storeys or windows == "none":
        return np.zeros((0, 4))
    width = float(np.linalg.norm(b - a))
    return window_frames(width, max(body.bottom, 0.0), body.eaves, body.storeys, bands=windows == "bands")


def _uncovered(low: float, high: float, covered: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return what is left of a stretch of heights."""
    left = [(low, high)]
    for a, b in covered:
        left = [piece for c, d in left for piece in ((c, min(d, a)), (max(c, b), d)) if piece[1] - piece[0] > 1e-6]
    return left


def _cap(plan: shapely.Polygon, z: float, up: bool) -> TriangleMesh:
    """Horizontal face over a plan."""
    triangles = triangulate_polygons(plan)[:, :: 1 if up else -1]
    return separate(np.column_stack([triangles.reshape(-1, 2), np.full(3 * len(triangles), z)]))


def _fan(corners: np.ndarray) -> TriangleMesh:
    """Return a triangle or a convex quadrilateral, corners [3 or 4, 3]."""
    return TriangleMesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32)[: len(corners) - 2])


def _ridge(body: Body, ring: np.ndarray) -> np.ndarray | None:
    """Return the ends of the ridge in plan, shape [2, 2] or [1, 2]; None for a flat roof."""
    if body.form == "flat":
        return None
    if body.form == "pyramidal":
        return shapely.get_coordinates(body.plan.centroid)
    sides = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    first = 0 if sides[0] + sides[2] <= sides[1] + sides[3] else 1  # the gables are on the shorter sides
    ends = np.array([0.5 * (ring[k] + ring[(k + 1) % 4]) for k in (first, first + 2)])
    if body.form == "hipped":
        long = float(np.linalg.norm(ends[1] - ends[0]))
        inset = min(0.5 * sides[[first, first + 2]].mean(), 0.5 * long) / long
        ends = ends + inset * (ends[::-1] - ends)
        if np.linalg.norm(ends[1] - ends[0]) < 0.01:
            ends = ends[:1]
    return ends


def _pitched(body: Body, ring: np.ndarray, ridge: np.ndarray) -> tuple[list[TriangleMesh], list[TriangleMesh]]:
    """Return gable walls and slopes."""
    low = np.column_stack([ring, np.full(len(ring), body.eaves)])
    top = np.column_stack([ridge, np.full(len(ridge), body.eaves + body.rise)])
    gables, slopes = [], []
    for k in range(len(ring)):
        a, b = low[k], low[(k + 1) % len(ring)]
        near = [int(np.argmin(np.linalg.norm(top[:, :2] - p[:2], axis=1))) for p in (a, b)]
        if near[0] == near[1]:
            (gables if body.form == "gabled" else slopes).append(_fan(np.array([a, b, top[near[0]]])))
        else:
            slopes.append(_fan(np.array([a, b, top[near[1]], top[near[0]]])))
    return gables, slopes
