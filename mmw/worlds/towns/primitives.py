"""Simple shapes as points and triangles with outward normals: boxes, prisms, tapered cylinders, balls, wall grids."""

import itertools
from collections.abc import Sequence

import mapbox_earcut
import numpy as np

from mmw.core.mesh import TriangleMesh, compact, merge
from mmw.worlds.towns.plan_geometry import twice_areas


def place(mesh: TriangleMesh, at: Sequence[float], yaw: float = 0.0) -> TriangleMesh:
    """Return the mesh turned about z by `yaw` [rad], then moved so that its origin comes to `at` [m], shape [3]."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return TriangleMesh(mesh.points @ turn + np.asarray(at, float), mesh.faces)


def weld(mesh: TriangleMesh) -> TriangleMesh:
    """Return the mesh with vertices closer than a micrometer joined, so that neighboring faces share their edges."""
    if not len(mesh.faces):
        return mesh
    _, first, joined = np.unique(np.round(mesh.points * 1e6), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # in order of first use, which does not depend on the last bit of a coordinate
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return TriangleMesh(mesh.points[first[order]], rank[joined.reshape(-1)][mesh.faces].astype(np.int32))


def quads(points: np.ndarray, corners: Sequence[Sequence[int]] | np.ndarray) -> TriangleMesh:
    """Return quadrilaterals `corners` (counter-clockwise from outside, indices into `points`), two triangles each."""
    four = np.asarray(corners, np.int32).reshape(-1, 4)
    faces = np.stack([four[:, [0, 1, 2]], four[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
    return TriangleMesh(np.asarray(points, float), faces.astype(np.int32))


def box(size: Sequence[float], center: Sequence[float], bottom: bool = True) -> TriangleMesh:
    """Return an axis-aligned box of `size` [m] around `center` [m]; without its underside if `bottom` is false."""
    corners = np.array([[x, y, z] for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
    sides = [[0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6], [4, 5, 7, 6]]
    return quads(corners * np.asarray(size) + np.asarray(center), [*sides, [0, 2, 3, 1]] if bottom else sides)


def triangulate(ring: np.ndarray) -> np.ndarray:
    """Return triangles over a simple counter-clockwise polygon `ring`, shape [K, 2]; faces shape [M, 3], upward."""
    ends = np.array([len(ring)], np.uint32)
    faces = mapbox_earcut.triangulate_float64(np.ascontiguousarray(ring, float), ends).reshape(-1, 3).astype(np.int32)
    return np.where((twice_areas(ring[faces]) < 0)[:, None], faces[:, ::-1], faces)


def flat(ring: np.ndarray, z: float) -> TriangleMesh:
    """Return an upward polygon at height `z` [m] over the counter-clockwise `ring`, shape [K, 2]."""
    return TriangleMesh(np.column_stack([ring, np.full(len(ring), float(z))]), triangulate(ring))


def stacked(rings: Sequence[tuple[np.ndarray, float]], inward: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return points [N, 3] and quadrilaterals [Q, 4] between successive rings [K, 2], each at a height [m].

    They look outward where counter-clockwise rings rise, or inward.
    """
    count = len(rings[0][0])
    points = np.concatenate([np.column_stack([ring, np.full(count, float(z))]) for ring, z in rings])
    first, second = np.arange(count), np.roll(np.arange(count), -1)
    first, second = (second, first) if inward else (first, second)
    strip = np.column_stack([first, second, second + count, first + count])
    return points, np.concatenate([strip + count * k for k in range(len(rings) - 1)])


def prism(ring: np.ndarray, z0: float, z1: float, bottom: bool = True) -> TriangleMesh:
    """Return the counter-clockwise `ring`, shape [K, 2], extruded from `z0` to `z1` [m]."""
    points, sides = stacked([(ring, z0), (ring, z1)])
    caps, count = triangulate(ring), len(ring)
    parts = [quads(points, sides), TriangleMesh(points[count:], caps)]
    return merge([*parts, TriangleMesh(points[:count], caps[:, ::-1])] if bottom else parts)


def circle(radius: float, sides: int, turn: float = 0.0) -> np.ndarray:
    """Return a regular counter-clockwise polygon on a circle of `radius` [m] about the origin, shape [sides, 2]."""
    angle = turn + 2 * np.pi * np.arange(sides) / sides
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def lathe(profile: Sequence[tuple[float, float]], sides: int, center: Sequence[float] = (0.0, 0.0)) -> TriangleMesh:
    """Return a solid of revolution about a vertical axis.

    Args:
        profile: (radius, z) from the bottom up [m]; a radius of 0 closes to a point, any other end is capped.
        sides: Number of sides, >= 3.
        center: Position (x, y) of the axis [m].
    """
    points: list[np.ndarray] = []
    rings: list[np.ndarray] = []
    for radius, z in profile:
        start = sum(len(p) for p in points)
        ring = circle(radius, sides) if radius > 0 else np.zeros((1, 2))
        points.append(np.column_stack([ring + np.asarray(center), np.full(len(ring), float(z))]))
        rings.append(start + np.arange(len(ring)))
    faces: list[np.ndarray] = []
    for low, high in itertools.pairwise(rings):
        if len(low) == 1:
            faces.append(np.column_stack([np.roll(high, -1), high, np.full(sides, low[0])]))
        elif len(high) == 1:
            faces.append(np.column_stack([low, np.roll(low, -1), np.full(sides, high[0])]))
        else:
            faces.append(np.column_stack([low, np.roll(low, -1), np.roll(high, -1)]))
            faces.append(np.column_stack([low, np.roll(high, -1), high]))
    fan = np.column_stack([np.zeros(sides - 2, int), np.arange(1, sides - 1), np.arange(2, sides)])
    if len(rings[0]) > 1:
        faces.append(rings[0][fan[:, ::-1]])
    if len(rings[-1]) > 1:
        faces.append(rings[-1][fan])
    return TriangleMesh(np.concatenate(points), np.concatenate(faces).astype(np.int32))


def ball(radii: Sequence[float], center: Sequence[float], sides: int = 7, rows: int = 4) -> TriangleMesh:
    """Return an ellipsoid of few faces with half-axes `radii` [m] around `center` [m]."""
    angle = np.pi * np.arange(rows + 1) / rows
    radius = np.sin(angle)
    radius[[0, -1]] = 0.0
    mesh = lathe(list(zip(radius, -np.cos(angle), strict=True)), sides)
    return TriangleMesh(mesh.points * np.asarray(radii) + np.asarray(center), mesh.faces)


def beam(start: Sequence[float], end: Sequence[float], thickness: float) -> TriangleMesh:
    """Return a square bar of `thickness` [m] from `start` to `end` [m], capped at both ends."""
    a, b = np.asarray(start, float), np.asarray(end, float)
    along = (b - a) / np.linalg.norm(b - a)
    side = np.cross(along, [0.0, 0.0, 1.0] if abs(along[2]) < 0.9 else [1.0, 0.0, 0.0])
    side *= 0.5 * thickness / np.linalg.norm(side)
    up = np.cross(along, side)
    ring = [side + up, -side + up, -side - up, side - up]
    points = np.array([a + c for c in ring] + [b + c for c in ring])
    return quads(points, [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [3, 2, 1, 0], [4, 5, 6, 7]])


def wall_cells(
    start: Sequence[float] | np.ndarray,
    end: Sequence[float] | np.ndarray,
    across: np.ndarray,
    heights: np.ndarray,
    kinds: np.ndarray,
    is_plain: bool = False,
) -> dict[int, TriangleMesh]:
    """Return a vertical wall cut into a grid of cells, one mesh for each kind of cell.

    The cells lie in one plane and share their edges, so their areas add up to the wall and no seam is left open.

    Args:
        start: Foot (x, y) of the left end, seen from outside [m].
        end: Foot (x, y) of the right end, seen from outside [m].
        across: Cell borders along the wall as fractions, increasing from 0 to 1, shape [C + 1].
        heights: Cell borders upward [m], increasing, shape [H + 1].
        kinds: Kind of every cell, shape [H, C]; negative cells are left out.
        is_plain: Whether the border of the wall has no vertices but its four corners, if all outer cells are of one
            kind: for a wall that shares no edge of cells with another mesh.

    Returns:
        Kind -> mesh, with the vertices that it uses.
    """
    left, right = np.asarray(start, float), np.asarray(end, float)
    feet = left + across[:, None] * (right - left)
    feet[-1] = right
    columns = len(across)
    points = np.column_stack([np.tile(feet, (len(heights), 1)), np.repeat(heights, columns)])
    row, column = np.meshgrid(np.arange(len(heights) - 1), np.arange(columns - 1), indexing="ij")
    corner = row * columns + column
    corners = np.stack([corner, corner + 1, corner + columns + 1, corner + columns], axis=-1)
    is_ring = np.ones(kinds.shape, bool)
    is_ring[1:-1, 1:-1] = False
    ring = np.zeros((0, 3), int)
    frame = int(kinds[0, 0])
    if is_plain and min(kinds.shape) > 2 and frame >= 0 and (kinds[is_ring] == frame).all():
        ring = _ring(np.arange(len(points)).reshape(-1, columns))
    meshes = {}
    for kind in np.unique(kinds[kinds >= 0]).tolist():
        cells = corners[(kinds == kind) & ~(is_ring & (len(ring) > 0))]
        pairs = np.stack([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
        meshes[kind] = compact(points, np.concatenate([pairs, ring if kind == frame else ring[:0]]))
    return meshes


def _ring(index: np.ndarray) -> np.ndarray:
    """Return triangles between the corners of a grid of vertices [H, C] and all vertices next to its border, [N, 3]."""
    inner = index[1:-1, 1:-1]
    sides = (inner[0], inner[:, -1], inner[-1, ::-1], inner[::-1, 0])  # counter-clockwise, from the foot
    ends = (index[0, 0], index[0, -1], index[-1, -1], index[-1, 0])
    faces = []
    for side, first, last in zip(sides, ends, (*ends[1:], ends[0]), strict=True):
        middle = len(side) // 2
        faces += [(side[k], first, side[k + 1]) for k in range(middle)]
        faces += [(side[middle], first, last)]
        faces += [(side[k], last, side[k + 1]) for k in range(middle, len(side) - 1)]
    return np.array(faces)
