"""Find the edges of a mesh with the faces that share them, and which of its bodies are inside out or open."""

from dataclasses import dataclass

import numpy as np

from mmw.core.closed_bodies import find_bodies, find_half_edges
from mmw.core.planar_surfaces import weld
from mmw.physics.em.vectors import dot, norm


@dataclass(frozen=True)
class MeshEdges:
    """Edges between welded vertices; each has a half-edge of every face that it bounds, side by side."""

    points: np.ndarray
    """Vertices [m], shape [N, 3], float64."""
    corner: np.ndarray
    """Corners of the faces [m], shape [M, 3, 3], float64."""
    normal: np.ndarray
    """Outward unit normal of each face, shape [M, 3], 0 for a face without area."""
    has_area: np.ndarray
    """True for a face with an area, shape [M]."""
    body: np.ndarray
    """Body of each face: the lowest of the faces that edges of two faces connect it to, or itself, shape [M]."""
    is_open: np.ndarray
    """True for a face of a body that does not close or whose faces disagree about the outside, shape [M]."""
    is_turned: np.ndarray
    """True for a face of a closed body that is inside out: `normal` is that of the reversed face, shape [M]."""
    welded: np.ndarray
    """Welded vertex at each corner of the faces, shape [M, 3]."""
    vertex: np.ndarray
    """Both ends of each half-edge in the order of its face, shape [H, 2]."""
    face: np.ndarray
    """Face of each half-edge, shape [H]."""
    opposite: np.ndarray
    """Third vertex of that face, shape [H]."""
    first: np.ndarray
    """First half-edge of each edge, shape [E]."""
    size: np.ndarray
    """Number of half-edges of each edge, shape [E]."""

    def out_of_face(self, half: np.ndarray) -> np.ndarray:
        """Return the unit vector across a half-edge, in the plane of its face and away from it, shape [..., 3]."""
        begin = self.points[self.vertex[half, 0]]
        out = np.cross(self.points[self.vertex[half, 1]] - begin, self.normal[self.face[half]])
        out /= np.maximum(norm(out), 1e-300)[:, None]
        inward = dot(out, self.points[self.opposite[half]] - begin) > 0.0
        return np.where(inward[:, None], -out, out)


def find_edges(points: np.ndarray, faces: np.ndarray) -> MeshEdges:
    """Return the edges of a mesh, sorted by their welded vertices.

    Args:
        points: Vertices [m], shape [N, 3].
        faces: Vertex indices, counter-clockwise from outside, shape [M, 3].
    """
    vertex = weld(points)[faces]
    half = find_half_edges(vertex)
    corner = points[faces].astype(np.float64)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = norm(normal)
    normal /= np.where(length > 0.0, length, 1.0)[:, None]
    found = find_bodies(corner, half)
    normal[found.is_turned] *= -1.0
    return MeshEdges(
        points=points.astype(np.float64),
        corner=corner,
        normal=normal,
        has_area=length > 0.0,
        body=found.body,
        is_open=found.is_open,
        is_turned=found.is_turned,
        welded=vertex,
        vertex=half.vertex,
        face=half.face,
        opposite=faces[half.face, (half.corner + 2) % 3],
        first=half.first,
        size=half.size,
    )
