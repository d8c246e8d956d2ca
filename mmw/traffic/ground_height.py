"""Find the height of the drivable surface under points by rays that fall on the mesh."""

import numpy as np

from mmw.core.bvh import RayMesh
from mmw.core.errors import InputError

UP = np.array([0.0, 0.0, 1.0])

DROP_ABOVE = 1.0
"""Drops start this far above the height hint [m]: low enough to stay below a deck over the road."""

DROP_BELOW = 1.0
"""Drops end this far below the height hint [m]."""

EDGE_STEP = 1e-3
"""A drop that hits nothing is repeated this far aside [m], in case it fell exactly between two triangles."""


class Ground:
    """The drivable mesh of a town on a device, with float64 heights outside."""

    def __init__(self, points: np.ndarray, faces: np.ndarray, device: str = "cpu") -> None:
        """Build the BVH of vertices in the world frame [m], shape [N, 3], and triangles, shape [M, 3].

        Raises:
            InputError: If there is no face.
        """
        if not len(faces):
            raise InputError("drivable mesh: 0 faces; vehicles need a surface; label the roads `road` or `road_line`")
        self._rays = RayMesh(np.asarray(points, np.float64), np.asarray(faces, np.int32), device)

    def heights(self, points: np.ndarray) -> np.ndarray:
        """Return the height of the surface under points.

        Args:
            points: Horizontal position and height hint, world frame [m], shape [R, 3]; the surface is looked for from
                1 m above to 1 m below the hint.

        Returns:
            Heights in the world frame [m], shape [R], float64; NaN where there is no surface.
        """
        points = np.asarray(points, np.float64)
        out = self._drop(points)
        missing = np.flatnonzero(np.isnan(out))
        if len(missing):
            out[missing] = self._drop(points[missing] + [EDGE_STEP, EDGE_STEP, 0.0])
        return out

    def _drop(self, points: np.ndarray) -> np.ndarray:
        start = points + DROP_ABOVE * UP
        fall, face = self._rays.cast(start, -UP, DROP_ABOVE + DROP_BELOW)
        return np.where(face >= 0, start[:, 2] - fall, np.nan)
