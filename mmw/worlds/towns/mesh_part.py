"""The unit of town geometry: a triangle mesh with one material that becomes a USD prim."""

from dataclasses import dataclass

import numpy as np

from mmw.core.mesh import TriangleMesh


@dataclass(frozen=True)
class MeshPart:
    """One Mesh prim of a town."""

    path: str
    """Prim path below the town's root, such as `Buildings/b_012/facade`; the first element is the group."""
    points: np.ndarray
    """Vertices in the town frame (x east, y north, z up) [m], shape [N, 3], float64."""
    faces: np.ndarray
    """Triangles, counter-clockwise seen from the front, shape [M, 3], int32."""
    material: str
    """Name of a material of `assets/usd/materials/materials.usda`."""
    label: str
    """Semantic class, a key of `mmw.usd.semantics.CARLA_TAG`."""

    @classmethod
    def of(cls, path: str, mesh: TriangleMesh, material: str, label: str) -> "MeshPart":
        """Return a mesh as a part."""
        return cls(path, mesh.points, mesh.faces, material, label)

    @property
    def mesh(self) -> TriangleMesh:
        """Points and faces alone."""
        return TriangleMesh(self.points, self.faces)
