"""The drivable surface as wheels feel it: heights under points, found by rays that fall on the mesh."""

import numpy as np
import warp as wp

from mmw.kernels.drop import drop_kernel

DROP_ABOVE = 1.0
"""Drops start this far above the height hint [m]: low enough to stay below a deck over the road."""

DROP_BELOW = 1.0
"""Drops end this far below the height hint [m]."""

EDGE_STEP = 1e-3
"""A drop that meets nothing is tried again this far aside [m], in case it fell exactly between two triangles."""


class Ground:
    """The drivable mesh of a town on a device, with float64 heights outside."""

    def __init__(self, points: np.ndarray, faces: np.ndarray, device: str = "cpu") -> None:
        """Upload the mesh, moved to its own middle so that float32 keeps a hundredth of a millimetre.

        Args:
            points: Vertices in the world frame [m], shape [N, 3].
            faces: Triangles, shape [M, 3].
            device: Warp device.

        Raises:
            ValueError: If there is no face.
        """
        points = np.asarray(points, np.float64)
        faces = np.asarray(faces, np.int32)
        if not len(faces):
            raise ValueError("drivable mesh: 0 faces; vehicles need a surface; label the roads `road` or `road_line`")
        self.origin = 0.5 * (points.min(axis=0) + points.max(axis=0))
        self.device = device
        self.mesh = wp.Mesh(
            points=wp.array((points - self.origin).astype(np.float32), dtype=wp.vec3, device=device),
            indices=wp.array(faces.reshape(-1), dtype=int, device=device),
        )

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
        start = (points - self.origin + [0.0, 0.0, DROP_ABOVE]).astype(np.float32)
        fall = wp.empty(len(start), dtype=float, device=self.device)
        origin = wp.array(start, dtype=wp.vec3, device=self.device)
        wp.launch(
            drop_kernel,
            dim=len(start),
            inputs=[self.mesh.id, origin, DROP_ABOVE + DROP_BELOW],
            outputs=[fall],
            block_dim=64,
            device=self.device,
        )
        fell = fall.numpy().astype(np.float64)
        height = start[:, 2].astype(np.float64) - fell + self.origin[2]
        return np.where(np.isfinite(fell), height, np.nan)
