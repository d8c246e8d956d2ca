"""Cut polygons into triangles: fans for convex ones, ear clipping for the rest."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmw.core.errors import InputError

MIN_SLIMNESS = 1e-9
"""Height of a triangle over its length below which it has no area [-]: a hundredth of the step of float32."""


@dataclass(frozen=True)
class Polygons:
    """A mesh prim as its file has it."""

    where: str
    """Prim path, for messages."""
    points: np.ndarray
    """Vertices, shape [N, 3]."""
    counts: np.ndarray
    """Corners of each polygon, shape [P]."""
    indices: np.ndarray
    """Vertex of each corner, polygon after polygon, shape [C]."""
    holes: np.ndarray
    """Polygons that are no geometry."""
    is_left_handed: bool
    """Whether polygons wind clockwise seen from the front."""


@dataclass(frozen=True)
class Triangles:
    """A mesh prim as triangles, in its own space and the stage's units."""

    points: np.ndarray
    """Vertices, shape [N, 3], float64."""
    faces: np.ndarray
    """Triangles, counter-clockwise seen from the front, shape [M, 3], int32."""
    polygon: np.ndarray
    """Polygon of the prim that each triangle is cut from, shape [M], int32."""
    corners: np.ndarray
    """Row of `faceVertexIndices` of each corner, shape [M, 3], int32; a shape's corners are merely counted."""


def cut_meshes(meshes: Sequence[Polygons], *, keeps_flat: bool = False) -> list[Triangles]:
    """Return meshes as triangles; all at once, as a town has thousands of small ones.

    Args:
        meshes: The meshes.
        keeps_flat: Keep triangles without area.

    Raises:
        InputError: If the topology of one is broken, or a point is not finite.
    """
    if not meshes:
        return []
    points = np.concatenate([mesh.points for mesh in meshes]).astype(np.float64)
    counts = np.concatenate([mesh.counts for mesh in meshes]).astype(np.int64)
    indices = np.concatenate([mesh.indices for mesh in meshes]).astype(np.int64)
    first_point, first_polygon, first_corner = (
        np.cumsum([0] + [len(getattr(mesh, name)) for mesh in meshes]) for name in ("points", "counts", "indices")
    )
    start = np.repeat(first_point[:-1], np.diff(first_corner))  # first point of the mesh of each corner
    end = np.repeat(first_point[1:], np.diff(first_corner))
    is_broken = np.diff(np.append(0, np.cumsum(counts))[first_polygon]) != np.diff(first_corner)
    is_broken |= np.array([bool((mesh.counts < 0).any()) for mesh in meshes])
    is_outside = (indices < 0) | (indices >= end - start)
    if is_broken.any() or is_outside.any() or not np.isfinite(points).all():
        for mesh in meshes:
            _check(mesh)
    holes = [
        mesh.holes[(mesh.holes >= 0) & (mesh.holes < len(mesh.counts))] + first
        for mesh, first in zip(meshes, first_polygon[:-1], strict=True)
        if len(mesh.holes)
    ]
    corners, polygon = triangulate(points, counts, indices + start, np.concatenate([np.zeros(0, np.int64), *holes]))
    faces = (indices + start).take(corners)
    if not keeps_flat:  # a triangle without area has no normal where a ray hits it
        edge = points.take(faces[:, 1:], axis=0) - points.take(faces[:, :1], axis=0)
        area = np.linalg.norm(np.cross(edge[:, 0], edge[:, 1]), axis=1)
        has_area = area > MIN_SLIMNESS * np.einsum("mkx,mkx->m", edge, edge)
        corners, polygon = corners[has_area], polygon[has_area]
    first = np.searchsorted(polygon, first_polygon)
    mesh_of = np.repeat(np.arange(len(meshes)), np.diff(first))
    turned = np.array([mesh.is_left_handed for mesh in meshes])[mesh_of]
    corners[turned] = corners[turned, ::-1]
    faces = indices.take(corners).astype(np.int32)
    corners = (corners - first_corner[mesh_of][:, None]).astype(np.int32)
    polygon = (polygon - first_polygon[mesh_of]).astype(np.int32)
    ends = np.stack([first_point[:-1], first_point[1:], first[:-1], first[1:]], axis=1).tolist()
    return [Triangles(points[a:b], faces[c:d], polygon[c:d], corners[c:d]) for a, b, c, d in ends]


def _check(mesh: Polygons) -> None:
    """Raise the error of a mesh whose topology is broken, or of which a point is not finite."""
    indices, corner_count, point_count = mesh.indices, mesh.counts.sum(), len(mesh.points)
    if (mesh.counts < 0).any():
        raise InputError(f"{mesh.where}: a face has {mesh.counts.min()} corners; repair it in the tool that made it")
    if corner_count != len(indices) or (len(indices) and not 0 <= indices.min() <= indices.max() < point_count):
        raise InputError(
            f"{mesh.where}: {len(mesh.counts)} faces need {corner_count} corners, {len(indices)} are given, over "
            f"{point_count} points; repair the mesh in the tool that made it"
        )
    if not np.isfinite(mesh.points).all():
        raise InputError(f"{mesh.where}: a point is not finite; repair the mesh in the tool that made it")


def triangulate(
    points: np.ndarray, counts: np.ndarray, indices: np.ndarray, holes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Cut every polygon of a mesh into triangles of the same winding, whose corners are corners of the polygons.

    Args:
        points: Vertices, shape [N, 3].
        counts: Corners of each polygon, shape [P].
        indices: Vertex of each corner, polygon after polygon.
        holes: Polygons that are no geometry.

    Returns:
        Triangles as rows of `indices`, shape [M, 3] (their vertices are `indices[triangles]`), and the polygon of each,
        shape [M], in the order of the polygons.
    """
    if len(holes) == 0 and (counts == 3).all():
        return np.arange(len(indices)).reshape(-1, 3), np.arange(len(counts))
    starts = np.concatenate([[0], np.cumsum(counts)])[:-1]
    is_hole = np.zeros(len(counts), dtype=bool)
    is_hole[holes[(holes >= 0) & (holes < len(counts))]] = True
    faces, polygons = [np.zeros((0, 3), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for count in np.unique(counts[counts >= 3]):
        polygon = np.flatnonzero((counts == count) & ~is_hole)
        corner = starts[polygon][:, None] + np.arange(count)
        convex = _is_convex(points[indices[corner]]) if count > 3 else np.ones(len(polygon), dtype=bool)
        k = np.arange(1, count - 1)
        fan = np.stack(np.broadcast_arrays(corner[convex, :1], corner[convex][:, k], corner[convex][:, k + 1]), axis=2)
        faces.append(fan.reshape(-1, 3))
        polygons.append(np.repeat(polygon[convex], count - 2))
        for row in np.flatnonzero(~convex):
            ears = _clip_ears(points[indices[corner[row]]])
            faces.append(corner[row][ears])
            polygons.append(np.full(len(ears), polygon[row]))
    polygon = np.concatenate(polygons)
    order = np.argsort(polygon, kind="stable")
    return np.concatenate(faces)[order], polygon[order]


def _area_normal(corners: np.ndarray) -> np.ndarray:
    """Return the sum of the fan's cross products of polygons [..., n, 3]: twice the area along the normal."""
    return np.cross(corners - corners[..., :1, :], np.roll(corners, -1, axis=-2) - corners[..., :1, :]).sum(axis=-2)


def _is_convex(corners: np.ndarray) -> np.ndarray:
    """Return whether each polygon [P, n, 3] has no inward corner and winds once."""
    normal = _area_normal(corners)
    fan = np.cross(corners[:, 1:-1] - corners[:, :1], corners[:, 2:] - corners[:, :1])
    bend = np.cross(corners - np.roll(corners, 1, axis=1), np.roll(corners, -1, axis=1) - corners)
    slack = -1e-9 * np.einsum("px,px->p", normal, normal)[:, None]
    turns = np.einsum("pnx,px->pn", np.concatenate([fan, bend], axis=1), normal)
    return (turns >= slack).all(axis=1)


def _clip_ears(corners: np.ndarray) -> np.ndarray:
    """Return triangles [n - 2, 3] of one simple polygon [n, 3], as corner numbers of the same winding.

    An ear is a corner that bends outward and whose triangle holds no other corner. Where rounding leaves no ear, the
    most outward corner is cut.

    Source: G. H. Meisters, "Polygons have ears", American Mathematical Monthly 82(6), 1975.
    """
    normal = _area_normal(corners)
    drop = int(np.argmax(np.abs(normal)))
    flat = np.delete(corners, drop, axis=1)
    if (normal[drop] < 0.0) != (drop == 1):  # a projection along y mirrors
        flat = flat * np.array([-1.0, 1.0])
    left = list(range(len(corners)))
    faces = []
    while len(left) > 3:
        ring = np.array(left)
        a, b, c = flat[np.roll(ring, 1)], flat[ring], flat[np.roll(ring, -1)]
        bend = _cross(b - a, c - b)
        order = np.argsort(-bend, kind="stable")
        chosen = int(order[0])
        for k in order:
            if bend[k] <= 0.0:
                break
            others = np.delete(flat[ring], [k - 1, k, (k + 1) % len(ring)], axis=0)
            outside = np.minimum(
                np.minimum(_cross(b[k] - a[k], others - a[k]), _cross(c[k] - b[k], others - b[k])),
                _cross(a[k] - c[k], others - c[k]),
            )
            if (outside < 0.0).all():
                chosen = int(k)
                break
        faces.append((left[chosen - 1], left[chosen], left[(chosen + 1) % len(left)]))
        del left[chosen]
    faces.append(tuple(left))
    return np.array(faces)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the z component of the cross product of plane vectors [..., 2]."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
