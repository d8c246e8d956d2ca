"""Find the edges of a mesh with the faces that share them, and which of its bodies are inside out or open."""

from dataclasses import dataclass

import numpy as np

from mmw.core.planar_surfaces import components, weld
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
    edges = vertex[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    face, opposite = np.repeat(np.arange(len(faces)), 3), faces[:, [2, 0, 1]].reshape(-1)
    low, high = edges.min(axis=1), edges.max(axis=1)
    order = np.lexsort((high, low))
    order = order[low[order] != high[order]]
    low, high, edges, face, opposite = low[order], high[order], edges[order], face[order], opposite[order]
    first = np.flatnonzero(np.append(True, (low[1:] != low[:-1]) | (high[1:] != high[:-1]))[: len(order)])
    size = np.diff(np.append(first, len(order)))
    corner = points[faces].astype(np.float64)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = norm(normal)
    normal /= np.where(length > 0.0, length, 1.0)[:, None]
    body, is_open, is_turned = _bodies(corner, face, edges[:, 0] < edges[:, 1], first, size)
    normal[is_turned] *= -1.0
    return MeshEdges(
        points=points.astype(np.float64),
        corner=corner,
        normal=normal,
        has_area=length > 0.0,
        body=body,
        is_open=is_open,
        is_turned=is_turned,
        welded=vertex,
        vertex=edges,
        face=face,
        opposite=opposite,
        first=first,
        size=size,
    )


def _bodies(
    corner: np.ndarray, face: np.ndarray, is_forward: np.ndarray, first: np.ndarray, size: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the body of each face, whether that does not close, and whether it closes and is inside out, [M] each.

    A body is the faces that edges of two faces connect. It closes if its faces run through every edge as often in one
    direction as in the other, and is inside out if its volume is negative.

    Args:
        corner: Corners of the faces [m], shape [M, 3, 3].
        face: Face of each half-edge, those of one edge together, shape [H].
        is_forward: Whether the half-edge runs from its lower to its higher vertex, shape [H].
        first: First half-edge of each edge, shape [E].
        size: Half-edges of each edge, shape [E].

    Source: volume by the divergence theorem, sum of (p0 - c) . ((p1 - c) x (p2 - c)) / 6 over the faces.
    """
    seam = first[size == 2]
    body = components(len(corner), face[seam], face[seam + 1])
    edge = np.repeat(np.arange(len(size)), size)
    own = np.unique(edge * len(corner) + body[face], return_inverse=True)[1].reshape(-1)  # edge of one body
    is_uneven = np.bincount(own, weights=np.where(is_forward, 1.0, -1.0)) != 0.0
    is_open = np.bincount(body[face], weights=is_uneven[own], minlength=len(corner)) > 0.0
    arm = corner - corner[body][:, :1]
    volume = np.bincount(body, weights=np.einsum("fk,fk->f", arm[:, 0], np.cross(arm[:, 1], arm[:, 2])) / 6.0)
    extent = np.bincount(body, weights=np.linalg.norm(arm, axis=2).max(axis=1) ** 3)
    is_turned = ~is_open[: len(volume)] & (volume < -1e-12 * extent)  # a body without thickness has no inside
    return body, is_open[body], is_turned[body]
