"""Height of the ground below any point of a town."""

import numpy as np

from mmw.core.mesh import merge
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.plan_geometry import PlanFaces


class Ground:
    """All upward faces of some meshes, looked up in plan."""

    def __init__(self, parts: list[MeshPart]) -> None:
        mesh = merge(part.mesh for part in parts)
        self._faces = PlanFaces(mesh.corners[mesh.crosses[:, 2] > 1e-9])

    def height(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the height of the highest face at every point [m], of the shape of `x`; NaN where there is none."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        query, _, heights = self._faces.hits(np.stack([x.ravel(), y.ravel()], axis=1))
        z = np.full(x.size, -np.inf)
        np.maximum.at(z, query, heights)
        z[~np.isfinite(z)] = np.nan
        return z.reshape(x.shape)
