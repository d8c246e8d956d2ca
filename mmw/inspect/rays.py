"""Rays on a mesh in float64 coordinates: the host side of `kernels/rays.py`."""

import numpy as np
import warp as wp

from mmw.kernels.rays import rays_kernel


class RayMesh:
    """Triangles on the CPU, moved to their own middle so that float32 keeps a hundredth of a millimetre.

    Attributes:
        normal: Unit normal of each face after its winding, shape [M, 3]; zero where a face has no area.
    """

    def __init__(self, points: np.ndarray, faces: np.ndarray, normal: np.ndarray) -> None:
        """Build the tree.

        Args:
            points: Vertices in the world frame [m], shape [N, 3].
            faces: Triangles, shape [M, 3], at least one.
            normal: See the attribute.
        """
        self.normal = normal
        self._origin = 0.5 * (points.min(axis=0) + points.max(axis=0))
        self._mesh = wp.Mesh(
            points=wp.array((points - self._origin).astype(np.float32), dtype=wp.vec3, device="cpu"),
            indices=wp.array(faces.astype(np.int32).ravel(), dtype=wp.int32, device="cpu"),
            bvh_constructor="sah",
        )

    def cast(self, origin: np.ndarray, direction: np.ndarray, t_max: float) -> tuple[np.ndarray, np.ndarray]:
        """Return what rays meet first.

        Args:
            origin: Starts [m], shape [R, 3].
            direction: Unit directions, shape [R, 3] or [3].
            t_max: Length of the rays [m].

        Returns:
            Distance [m], shape [R], inf for a miss; face, shape [R], -1 for a miss.
        """
        count = len(origin)
        starts = wp.array((origin - self._origin).astype(np.float32), dtype=wp.vec3, device="cpu")
        ways = np.ascontiguousarray(np.broadcast_to(direction, (count, 3)), dtype=np.float32)
        t, face = wp.empty(count, dtype=float, device="cpu"), wp.empty(count, dtype=int, device="cpu")
        wp.launch(
            rays_kernel,
            dim=count,
            inputs=[self._mesh.id, starts, wp.array(ways, dtype=wp.vec3, device="cpu"), t_max],
            outputs=[t, face],
            block_dim=64,
            device="cpu",
        )
        return t.numpy().astype(np.float64), face.numpy()
