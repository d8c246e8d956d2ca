"""Triangulate polygons in space, with holes, so that neighbors that share vertices share edges."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

MIN_AREA = 1e-8
"""Polygons of less have no plane [m^2]; design value, a tenth of a millimeter squared."""


@dataclass(frozen=True)
class Triangulation:
    """Triangles of many polygons."""

    corners: np.ndarray
    """Corners, counter-clockwise as the outer ring is [m], shape [M, 3, 3]."""
    owner: np.ndarray
    """Index of the polygon of each triangle, rising, shape [M]."""
    degenerate: int
    """Polygons without an area, which have no triangles."""
    repaired: int
    """Polygons that crossed themselves, or could not be filled; their valid part is filled."""


def normal_of(ring: np.ndarray) -> np.ndarray:
    """Return twice the vector area of a ring [m^2], shape [3].

    Args:
        ring: Corners, the first one not repeated [m], shape [N, 3].

    Source: M. E. Newell's method, I. Sutherland et al., A Characterization of Ten Hidden-Surface Algorithms, ACM
    Computing Surveys 6 (1974), appendix.
    """
    near = ring - ring[:1]
    return np.cross(near, np.roll(near, -1, axis=0)).sum(axis=0)


def triangulate(polygons: Sequence[Sequence[np.ndarray]]) -> Triangulation:
    """Fill polygons; the triangles use all of their vertices, also those of polygons that are not quite plane.

    Args:
        polygons: Rings of each polygon, the outer one first; corners [m], shape [N, 3], the first not repeated.
    """
    flat, frames, rows, degenerate = [], [], [], 0
    for index, rings in enumerate(polygons):
        rings = [ring for ring in rings if len(ring) > 2]
        area = normal_of(rings[0]) if rings else np.zeros(3)
        size = float(np.linalg.norm(area))
        if size < 2.0 * MIN_AREA:
            degenerate += 1
            continue
        axes = _axes(area / size)
        plans = [(ring - rings[0][0]) @ axes.T for ring in rings]
        known = {
            tuple(uv): xyz
            for plan, ring in zip(plans, rings, strict=True)
            for uv, xyz in zip(plan.tolist(), ring.tolist(), strict=True)
        }
        flat.append(shapely.Polygon(plans[0], plans[1:]))
        frames.append((rings[0][0], axes, known))
        rows.append(index)
    plan = np.array(flat, object)
    is_valid = shapely.is_valid(plan) if len(plan) else np.zeros(0, bool)
    plan[~is_valid] = shapely.make_valid(plan[~is_valid])
    triangles, piece = _fill(plan)
    corners = np.array([_lift(frames[k], uv) for k, uv in zip(piece.tolist(), triangles.tolist(), strict=True)])
    owner = np.array(rows, np.int64)[piece] if len(rows) else np.zeros(0, np.int64)
    return Triangulation(corners.reshape(-1, 3, 3), owner, degenerate, int((~is_valid).sum()))


def _axes(normal: np.ndarray) -> np.ndarray:
    """Return two unit vectors that span the plane of a normal and turn about it, shape [2, 3]."""
    u = np.cross(np.eye(3)[np.argmin(np.abs(normal))], normal)
    u /= np.linalg.norm(u)
    return np.stack([u, np.cross(normal, u)])


def _fill(plan: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return triangles in plan, counter-clockwise, shape [M, 3, 2], and the polygon of each, shape [M]."""
    areas, owner = shapely.get_parts(plan, return_index=True)
    inner, place = shapely.get_parts(areas, return_index=True)  # of collections that make_valid returns
    owner = owner[place]
    is_area = (shapely.get_type_id(inner) == 3) & ~shapely.is_empty(inner)
    split, piece = shapely.get_parts(shapely.constrained_delaunay_triangles(inner[is_area]), return_index=True)
    uv = shapely.get_coordinates(split).reshape(-1, 4, 2)[:, :3]
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    turned = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] < 0.0
    return np.where(turned[:, None, None], uv[:, ::-1], uv), owner[is_area][piece]


def _lift(frame: tuple[np.ndarray, np.ndarray, dict], triangle: list[list[float]]) -> list[list[float]]:
    """Return a triangle in space: known vertices as they are, those of a repair in the plane."""
    start, axes, known = frame
    return [known.get(tuple(uv)) or (start + np.array(uv) @ axes).tolist() for uv in triangle]
