"""The solid of an elevated road: carriageway, kerbs and parapets above, soffit and walls below, closed all around."""

import numpy as np
import shapely

from mmw.worlds.towns.elevated_roads import PARAPET_WIDTH, Structure, Walls, bridge_of, plan_of
from mmw.worlds.towns.junctions import triangulate
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.roads import RoadBody, add_carriageway
from mmw.worlds.towns.strip_mesh import Surface, quads

CONCRETE = "concrete_structure"
"""Material of everything but the carriageway, the kerbs and the sidewalks."""
TOP_STRIPS = ("curb", "curb", "concrete_sidewalk")
"""Materials from the foot of the kerb outward to the parapet: face and top of the kerb, sidewalk."""
INNER_TOP, OUTER_TOP, OUTER_BASE, SOFFIT, BURIED = 4, 5, 6, 7, 8
"""Columns of a side after the four borders of kerb and sidewalk: two edges of the parapet, the edge between parapet and
deck on the outer face, the edge of the soffit, and the foot of the wall."""


def build_solid(body: RoadBody, walls: Walls) -> Structure:
    """Return the solid of a bridge without its piers."""
    _, begin, end = bridge_of(body)
    name, piece = body.road.id, slice(begin, end + 1)
    top, rail, mass = Surface(), Surface(), Surface()
    index = add_carriageway(top, body.section, body.rows, piece)
    rows = [np.concatenate(top.points)[row] for row in index]
    road = np.concatenate([*top.faces["asphalt"], *top.faces["road_marking"]])
    sides = _sides(body, walls)
    fills = [slice(0, walls.first + 1), slice(walls.last, end - begin + 1)]
    for table, is_left in zip(sides, (False, True), strict=True):
        for k, material in enumerate(TOP_STRIPS):
            _strip(top, material, table[:, k], table[:, k + 1], is_left)
        for k in (3, INNER_TOP, OUTER_TOP):
            _strip(rail, CONCRETE, table[:, k], table[:, k + 1], is_left)
        _strip(mass, CONCRETE, table[:, OUTER_BASE], table[:, SOFFIT], is_left)
        for fill in fills:
            _strip(mass, CONCRETE, table[fill, SOFFIT], table[fill, BURIED], is_left)
    right, left = sides
    span = slice(walls.first, walls.last + 1)
    soffit = _strip(mass, CONCRETE, right[span, SOFFIT], left[span, SOFFIT], False)
    for fill in fills:
        _strip(mass, CONCRETE, right[fill, BURIED], left[fill, BURIED], False)
    for row, is_ahead in ((walls.first, True), (walls.last, False)):
        ring = [right[row, BURIED], left[row, BURIED], left[row, SOFFIT], right[row, SOFFIT]]
        _face(mass, np.array(ring), np.array([[0, 1, 2], [0, 2, 3]]), is_ahead)
    for row, is_ahead in ((0, False), (-1, True)):
        ring = np.concatenate([right[row, :0:-1], _across(body, rows[row], begin if row == 0 else end), left[row, 1:]])
        ring = ring[np.append(True, np.any(np.diff(ring, axis=0) != 0, axis=1))]
        to_left = body.rows.left[begin if row == 0 else end]
        flat = np.column_stack([(ring[:, :2] - ring[0, :2]) @ to_left, ring[:, 2]])
        _face(mass, ring, triangulate(flat, f"{name} (end of its bridge)"), is_ahead)
    paths = {
        "asphalt": (f"Bridges/{name}/asphalt", "road"),
        "road_marking": (f"Bridges/{name}/marking", "road_line"),
        "curb": (f"Bridges/{name}/curb", "sidewalk"),
        "concrete_sidewalk": (f"Bridges/{name}/walk", "sidewalk"),
        "grass": (f"Bridges/{name}/median_grass", "terrain"),
    }
    parts: list[MeshPart] = top.parts(paths)
    parts += rail.parts({CONCRETE: (f"Bridges/{name}/parapet", "guard_rail")})
    parts += mass.parts({CONCRETE: (f"Bridges/{name}/structure", "bridge")})
    supports = shapely.union_all([plan_of(body, fill) for fill in fills])
    return Structure(name, tuple(parts), plan_of(body), supports, np.concatenate(top.points)[road], soffit)


def _sides(body: RoadBody, walls: Walls) -> list[np.ndarray]:
    """Return the points of the right and of the left side at every row, from the kerb outward and down, [N, 9, 3]."""
    bridge, begin, end = bridge_of(body)
    piece = slice(begin, end + 1)
    z = body.rows.z[piece]
    made = []
    for table, sign in ((body.right.table, -1.0), (body.left.table[::-1], 1.0)):
        edge = table[piece, :4]
        away = sign * body.rows.left[piece] * PARAPET_WIDTH
        outer = np.column_stack([edge[:, 3, :2] + away, edge[:, 3, 2]])
        up = np.array([0.0, 0.0, bridge.parapet])
        soffit, buried = outer.copy(), outer.copy()
        soffit[:, 2], buried[:, 2] = z - bridge.deck, walls.foot
        more = np.stack([edge[:, 3] + up, outer + up, outer, soffit, buried], axis=1)
        made.append(np.concatenate([edge, more], axis=1))
    return made


def _across(body: RoadBody, carriageway: np.ndarray, row: int) -> np.ndarray:
    """Return the points of one row from the right to the left kerb, over the raised median if it has one, [K, 3]."""
    section, (first, last) = body.section, body.rows.between
    if not len(section.island) or not first <= row <= last:
        return carriageway
    right, left = section.island_breaks
    top = body.rows.across(row, section.island) + np.array([0.0, 0.0, section.island_height])
    return np.concatenate([carriageway[: right + 1], top, carriageway[left:]])


def _strip(surface: Surface, material: str, a: np.ndarray, b: np.ndarray, is_left: bool) -> np.ndarray:
    """Add the strip between two lines of points along the road, and return its triangles turned over, [M, 3, 3]."""
    low, high = surface.add_points(a), surface.add_points(b)
    faces = quads(low, high)
    surface.add_faces(material, faces[:, ::-1] if is_left else faces)
    points = np.concatenate([a, b])
    return points[faces[:, ::-1] - low[0]]


def _face(surface: Surface, ring: np.ndarray, faces: np.ndarray, is_ahead: bool) -> None:
    """Add a wall across the road, whose triangles look ahead as given, or back."""
    index = surface.add_points(ring)
    surface.add_faces(CONCRETE, index[faces if is_ahead else faces[:, ::-1]])
