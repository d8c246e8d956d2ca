"""Polygons to triangles: fans for convex ones, ear clipping for the rest."""

import numpy as np


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
