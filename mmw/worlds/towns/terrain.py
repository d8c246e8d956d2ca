"""Terrain: a height field between the roads that ends exactly at the outer vertices of their verges."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import scipy.spatial
import shapely

from mmw.core.errors import InputError
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.plan_geometry import harmonic_heights, triangular_lattice, twice_areas

ROW_PITCH = 0.5 * np.sqrt(3.0)
"""Distance of the rows of a triangular lattice, by its spacing [-]."""


def mesh_terrain(
    loops: list[np.ndarray], spacing: float, margin: float, cover: Sequence[shapely.Geometry] = ()
) -> list[MeshPart]:
    """Return the ground outside closed road edges.

    Args:
        loops: Outer edges of the verges, the roads on their left: blocks clockwise, the edge of the town
            counter-clockwise [m], each [N, 3].
        spacing: Size of the grid [m].
        margin: How far the ground reaches beyond the outermost road [m].
        cover: Plans of bridges, which the ground reaches beyond as well.
    """
    outer = [loop for loop in loops if shapely.LinearRing(loop[:, :2]).is_ccw]
    parts = []
    for k, loop in enumerate(outer):
        reach = [loop[:, :2], *(shapely.get_coordinates(plan) for plan in cover)]
        frame = _frame(np.concatenate(reach), spacing, margin)
        parts.append(_mesh_block(f"Terrain/surroundings_{k:02d}", loop, frame, spacing))
    blocks = [loop for loop in loops if not shapely.LinearRing(loop[:, :2]).is_ccw]
    order = sorted(blocks, key=lambda loop: tuple(np.round(loop[:, :2].mean(axis=0), 3)))
    for k, loop in enumerate(order):
        parts.append(_mesh_block(f"Terrain/block_{k:02d}", loop, None, spacing))
    return parts


def _frame(inside: np.ndarray, spacing: float, margin: float) -> np.ndarray:
    """Return points on the rectangle round the town, counter-clockwise [m], shape [N, 2]."""
    low, high = inside.min(axis=0) - margin, inside.max(axis=0) + margin
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]], low])
    sides = []
    for a, b in pairwise(corners):
        count = int(np.ceil(np.linalg.norm(b - a) / spacing))
        sides.append(a + (b - a) * (np.arange(count) / count)[:, None])
    return np.concatenate(sides)


def _mesh_block(path: str, loop: np.ndarray, frame: np.ndarray | None, spacing: float) -> MeshPart:
    """Return the ground inside a clockwise loop, or between a counter-clockwise one and the frame around it."""
    border = loop[:, :2]
    polygon = shapely.Polygon(border) if frame is None else shapely.Polygon(frame, [border])
    if not polygon.is_valid:
        raise InputError(f"{path}: {shapely.is_valid_reason(polygon)}; the roads around this block overlap; move them")
    low, high = np.array(polygon.bounds[:2]), np.array(polygon.bounds[2:])
    count = np.maximum(np.round((high - low) / (spacing * np.array([1.0, ROW_PITCH]))).astype(int), 1)
    grid = triangular_lattice(low, high, count)
    shapely.prepare(polygon)
    grid = grid[shapely.contains_xy(polygon, grid[:, 0], grid[:, 1])]
    grid = grid[np.asarray(shapely.distance(polygon.boundary, np.array(shapely.points(grid)))) > 0.55 * spacing]
    fixed = border if frame is None else np.concatenate([border, frame])
    own = np.arange(len(border))
    edges = np.stack([own, np.roll(own, -1)], axis=1)
    if frame is not None:
        outer = len(border) + np.arange(len(frame))
        edges = np.concatenate([edges, np.stack([outer, np.roll(outer, -1)], axis=1)])
    faces, xy = _triangulate(polygon, fixed, edges, grid)
    z = harmonic_heights(faces, len(xy), loop[:, 2])
    return MeshPart(path, np.column_stack([xy, z]), faces, "grass", "terrain")


def _triangulate(
    polygon: shapely.Polygon, fixed: np.ndarray, edges: np.ndarray, inner: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return faces [M, 3] and points [N, 2] with every border edge among the edges, and no other vertex on it."""
    for _ in range(6):
        xy = np.concatenate([fixed, inner])
        faces = scipy.spatial.Delaunay(xy).simplices.astype(np.int64)
        sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        present = {tuple(side) for side in sides.tolist()}
        missing = [edge for edge in np.sort(edges, axis=1).tolist() if tuple(edge) not in present]
        if not missing:
            middle = xy[faces].mean(axis=1)
            faces = faces[shapely.contains_xy(polygon, middle[:, 0], middle[:, 1])]
            return _face_up(faces, xy), xy
        a, b = xy[np.array(missing)[:, 0]], xy[np.array(missing)[:, 1]]
        centre, radius = 0.5 * (a + b), 0.5 * np.linalg.norm(b - a, axis=1)
        near = np.linalg.norm(inner[:, None] - centre[None], axis=2) < 1.5 * radius[None]
        if not np.any(near):
            break
        inner = inner[~np.any(near, axis=1)]
    index = {tuple(point): k for k, point in enumerate(fixed.tolist())}  # no grid: the border alone
    corners = shapely.get_coordinates(shapely.get_parts(shapely.constrained_delaunay_triangles(polygon)))
    faces = np.array([index[tuple(point)] for point in corners.tolist()]).reshape(-1, 4)[:, :3]
    return _face_up(faces, fixed), fixed


def _face_up(faces: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Return triangles counter-clockwise from above, in the order of their vertices: Qhull's hangs on last bits."""
    area = twice_areas(xy[faces])
    faces = np.where((area < 0)[:, None], faces[:, ::-1], faces)
    faces = faces[np.abs(area) > 1e-9].astype(np.int32)
    turns = (np.argmin(faces, axis=1)[:, None] + np.arange(3)) % 3  # the same triangle, from its first vertex on
    faces = np.take_along_axis(faces, turns, axis=1)
    return faces[np.lexsort(faces.T[::-1])]
