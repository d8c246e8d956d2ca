"""Represent triangle meshes as vertices and faces, with areas, normals and bounds computed on first use."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles over shared vertices."""

    points: np.ndarray
    """Vertices [m], shape [N, 3], float64."""
    faces: np.ndarray
    """Triangles, counter-clockwise seen from outside, shape [M, 3], int32."""

    @cached_property
    def corners(self) -> np.ndarray:
        """Corners of each triangle [m], shape [M, 3, 3]."""
        return self.points[self.faces]

    @cached_property
    def crosses(self) -> np.ndarray:
        """Cross products of two edges, twice the area along the normal [m^2], shape [M, 3]."""
        return np.cross(self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0])

    @cached_property
    def areas(self) -> np.ndarray:
        """Area of each triangle [m^2], shape [M]."""
        return 0.5 * np.linalg.norm(self.crosses, axis=1)

    @cached_property
    def normals(self) -> np.ndarray:
        """Unit normal of each triangle, zero where it has no area, shape [M, 3]."""
        has_area = (self.areas > 0.0)[:, None]
        return np.where(has_area, self.crosses / np.where(has_area, 2.0 * self.areas[:, None], 1.0), 0.0)

    @cached_property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner of the box around all vertices [m], shape [2, 3]."""
        return np.stack([self.points.min(axis=0), self.points.max(axis=0)])

    def select(self, faces: np.ndarray) -> "TriangleMesh":
        """Return triangles, by row numbers [K] or a mask [M], with only the vertices that they use."""
        return compact(self.points, self.faces[faces])


EMPTY = TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
"""A mesh of no triangle."""


def compact(points: np.ndarray, faces: np.ndarray) -> TriangleMesh:
    """Return triangles [M, 3] with only those of the points [m], shape [N, 3], that they use, in their order."""
    used, index = np.unique(faces, return_inverse=True)
    return TriangleMesh(points[used], index.reshape(-1, 3).astype(np.int32))


def merge(meshes: Iterable[TriangleMesh]) -> TriangleMesh:
    """Return the triangles of all meshes in one, in order; vertices are not welded."""
    meshes = [mesh for mesh in meshes if len(mesh.faces)]
    if not meshes:
        return EMPTY
    offsets = np.cumsum([0] + [len(mesh.points) for mesh in meshes[:-1]])
    faces = [mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=True)]
    return TriangleMesh(np.concatenate([mesh.points for mesh in meshes]), np.concatenate(faces).astype(np.int32))


def separate(corners: np.ndarray) -> TriangleMesh:
    """Return triangles that share no vertices, of their corners [m], shape [M, 3, 3]."""
    points = corners.reshape(-1, 3)
    return TriangleMesh(points, np.arange(len(points), dtype=np.int32).reshape(-1, 3))
