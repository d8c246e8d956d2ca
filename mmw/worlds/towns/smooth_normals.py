"""Normals of round bodies, so that few faces look round: poles, trunks, crowns of trees, piers of bridges."""

import numpy as np

from mmw.core.mesh import TriangleMesh
from mmw.worlds.crease_normals import crease_normals
from mmw.worlds.towns.mesh_part import MeshPart

CREASE_DEG = {
    "bark": 75.0, "metal_pole": 75.0, "plastic": 50.0,
    "marble_facade": 50.0, "brick_facade": 40.0, "concrete_structure": 50.0, "metal_fascia": 50.0,
    "traffic_light_metal": 50.0, "wood": 40.0,
}  # fmt: skip
"""Material of a prop -> angle between neighboring faces up to which their edge looks round [deg]; design values.

A pole of five sides turns by 72 degrees at each edge, a box by 90."""

CROWN_CREASE_DEG = 110.0
"""The same for crowns of trees and shrubs [deg]; the rims of a conifer turn by more."""

GROUPS, PIERS = ("Props",), "/piers"
"""Groups whose meshes may be round, and how the paths of other meshes end that may."""


def part_normals(part: MeshPart) -> np.ndarray | None:
    """Return the normals of a mesh that is not flat everywhere.

    Returns:
        One a vertex, shape [N, 3], where all corners at a vertex agree; else one a corner, shape [M, 3, 3]; None if all
        faces look flat.
    """
    crease = CROWN_CREASE_DEG if part.path.endswith("/crown") else CREASE_DEG.get(part.material)
    if crease is None or not (part.path.split("/")[0] in GROUPS or part.path.endswith(PIERS)):
        return None
    corners = corner_normals(part.mesh, crease)
    if corners is None:
        return None
    at_vertex = np.zeros_like(part.points)
    at_vertex[part.faces] = corners
    return at_vertex if np.abs(at_vertex[part.faces] - corners).max() < 1e-3 else corners


def corner_normals(mesh: TriangleMesh, crease_deg: float) -> np.ndarray | None:
    """Return the normal of every corner: the mean of the faces around it that lie less than an angle from its own.

    A face counts by its angle at the corner.

    Args:
        mesh: The mesh; vertices closer than 0.1 mm count as one.
        crease_deg: The angle [deg].

    Returns:
        Unit normals, shape [M, 3, 3]; None if each is that of its face.
    """
    corners, normal = mesh.corners, mesh.normals
    ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    lengths = np.linalg.norm(ahead, axis=2) * np.linalg.norm(behind, axis=2)
    angle = np.arccos(np.clip(np.einsum("fcx,fcx->fc", ahead, behind) / np.maximum(lengths, 1e-300), -1.0, 1.0))
    vertex = np.unique(np.round(mesh.points * 1e4).astype(np.int64), axis=0, return_inverse=True)[1]
    weighted = (normal[:, None] * angle[..., None]).reshape(-1, 3)
    smooth = crease_normals(vertex.reshape(-1)[mesh.faces], normal, weighted, np.cos(np.radians(crease_deg)))
    is_round = np.einsum("fcx,fx->fc", smooth, normal).min(initial=1.0) < 1.0 - 1e-8
    return np.round(smooth, 4) if is_round else None
