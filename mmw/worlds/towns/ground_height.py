"""Height of the ground below any point of a town."""

import numpy as np
import shapely

from mmw.worlds.towns.mesh_part import MeshPart


class Ground:
    """All upward faces of some meshes, looked up in plan."""

    def __init__(self, parts: list[MeshPart]) -> None:
        corners = np.concatenate([part.points[part.faces] for part in parts])
        a, b, c = (corners[:, k] for k in range(3))
        normal = np.cross(b - a, c - a)
        self._corners = corners[normal[:, 2] > 1e-9]
        rings = self._corners[:, [0, 1, 2, 0], :2]
        self._tree = shapely.STRtree(np.asarray(shapely.polygons(rings)))

    def height(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the height of the highest face at every point [m], of the shape of `x`; NaN where there is none."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        xy = np.stack([x.ravel(), y.ravel()], axis=1)
        z = np.full(len(xy), -np.inf)
        query, face = self._tree.query(shapely.points(xy), predicate="intersects")
        a, b, c = (self._corners[face, k] for k in range(3))
        p = xy[query]
        u, v, w = b[:, :2] - a[:, :2], c[:, :2] - a[:, :2], p - a[:, :2]
        area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        s = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / area
        t = (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / area
        np.maximum.at(z, query, a[:, 2] + s * (b[:, 2] - a[:, 2]) + t * (c[:, 2] - a[:, 2]))
        z[~np.isfinite(z)] = np.nan
        return z.reshape(x.shape)
