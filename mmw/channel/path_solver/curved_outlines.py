"""Find where curved surfaces end, and where one material of them ends and another begins."""

from dataclasses import dataclass

import numpy as np

from mmw.physics.em.vectors import dot
from mmw.scene.mesh_edges import MeshEdges


@dataclass(frozen=True)
class Pieces:
    """Pieces of the curved surfaces that have several materials, of one material each; M of them."""

    of_surface: np.ndarray
    """Piece of each flat surface, -1 for none, shape [S]."""
    group: np.ndarray
    """Curved surface of each piece, growing, shape [M]."""
    material: np.ndarray
    """Material of each piece, shape [M]."""


def find_pieces(group: np.ndarray, material: np.ndarray) -> Pieces:
    """Return the pieces of curved surfaces.

    Args:
        group: Curved surface of each flat surface, -1 for none, shape [S].
        material: Material of each, shape [S].
    """
    rows = np.flatnonzero(group >= 0)
    pair, piece = np.unique(np.column_stack([group[rows], material[rows]]), axis=0, return_inverse=True)
    several = np.bincount(pair[:, 0], minlength=1)[pair[:, 0]] > 1
    of_surface = np.full(len(group), -1)
    of_surface[rows] = np.where(several, np.cumsum(several) - 1, -1)[piece.reshape(-1)]
    return Pieces(of_surface, *pair[several].T)


def outline_edges(mesh: MeshEdges, of_face: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the half-edges at which groups of faces end, shape [E], their groups, growing, and the vertices at their
    ends, shape [E, 2], counter-clockwise seen from outside.

    Args:
        mesh: Edges of the mesh.
        of_face: Group of each face, -1 for none, shape [F].
    """
    edge = np.repeat(np.arange(len(mesh.size)), mesh.size)
    half = (
        np.repeat(mesh.first, mesh.size) + np.arange(len(edge)) - np.repeat(np.cumsum(mesh.size) - mesh.size, mesh.size)
    )
    group = of_face[mesh.face[half]]
    _, at, times = np.unique(np.column_stack([edge, group]), axis=0, return_index=True, return_counts=True)
    keep = (times == 1) & (group[at] >= 0)
    half, group = half[at[keep]], group[at[keep]]
    order = np.argsort(group, kind="stable")
    half, group = half[order], group[order]
    vertex = mesh.vertex[half]
    inward = np.cross(mesh.normal[mesh.face[half]], mesh.points[vertex[:, 1]] - mesh.points[vertex[:, 0]])
    is_turned = dot(inward, mesh.points[mesh.opposite[half]] - mesh.points[vertex[:, 0]]) < 0.0
    return half, group, np.where(is_turned[:, None], vertex[:, ::-1], vertex)
