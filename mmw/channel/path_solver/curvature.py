"""Estimate the curvature of the surface that a mesh shows as facets, at the corners of its faces."""

import numpy as np
import warp as wp

from mmw.core.planar_surfaces import sums_by_row
from mmw.kernels.channel.curvature import smooth_curvature_kernel
from mmw.physics.em.vectors import dot, norm
from mmw.scene.mesh_edges import MeshEdges

MIN_HEIGHT_M = 1e-3
"""Faces with a smaller height over their longest edge say nothing about curvature: points of meshes are rounded [m]."""

SMOOTHING_M = 0.03
"""Distance within which curvatures are averaged [m]: waves average over a Fresnel zone, 0.05 m across where the radius
is 0.2 m at 28 GHz, and do not see the seams of a mesh. Design value."""

GRID_CELLS = 128
"""Cells of the hash grid along each axis."""


def corner_curvatures(
    mesh: MeshEdges, own: np.ndarray, meeting: np.ndarray, group: np.ndarray, normal: np.ndarray
) -> np.ndarray:
    """Return the curvature at the corners of faces of curved surfaces [1/m], shape [n, 3, 3, 3].

    The curvature of a face is the change of the normals between its corners over their distances. At a corner it is the
    mean, weighted by area, of the faces that meet there and close by, each turned to the normal of the corner. Hollows
    count as flat.

    Args:
        mesh: Edges of the mesh.
        own: The faces, shape [n].
        meeting: Vertex of a curved surface at their corners, from 0 on, shape [n, 3].
        group: Curved surface of each, shape [n].
        normal: Unit normals at their corners, shape [n, 3, 3].

    Source: S. Rusinkiewicz, Estimating curvatures and their derivatives on triangle meshes, 3DPVT 2004.
    """
    a, b, c = mesh.corner[own].swapaxes(0, 1)
    x = (b - a) / norm(b - a)[:, None]
    up = mesh.normal[own]
    y = np.cross(up, x)
    run, rise = (
        np.stack([np.stack([dot(v, x), dot(v, y)], axis=1) for v in pair], axis=2)  # [n, axis, edge]
        for pair in ((b - a, c - a), (normal[:, 1] - normal[:, 0], normal[:, 2] - normal[:, 0]))
    )
    doubled = norm(np.cross(b - a, c - a))
    is_wide = doubled > MIN_HEIGHT_M * np.maximum(np.maximum(norm(b - a), norm(c - a)), norm(c - b))
    bend = np.where(is_wide[:, None, None], rise @ np.linalg.inv(np.where(is_wide[:, None, None], run, np.eye(2))), 0.0)
    plane = np.stack([x, y], axis=2)
    of_faces = plane @ (0.5 * (bend + bend.swapaxes(1, 2))) @ plane.swapaxes(1, 2)
    at = np.unique(meeting, return_index=True)[1]  # a corner at each vertex
    area = np.repeat(np.where(is_wide, 0.5 * doubled, 0.0), 3)
    turned = turn_curvature(np.repeat(of_faces, 3, axis=0), np.repeat(up, 3, axis=0), normal.reshape(-1, 3))
    of_corner = meeting.reshape(-1)
    total = sums_by_row(of_corner, area[:, None] * turned.reshape(-1, 9), len(at)).reshape(-1, 3, 3)
    point, unit = mesh.corner[own].reshape(-1, 3)[at], normal.reshape(-1, 3)[at]
    mean = _smoothed(point, unit, np.repeat(group, 3)[at], np.bincount(of_corner, area, len(at)), total)
    share, direction = np.linalg.eigh(0.5 * (mean + mean.swapaxes(1, 2)))
    mean = (direction * np.maximum(share, 0.0)[:, None]) @ direction.swapaxes(1, 2)
    return mean[meeting]


def _smoothed(
    point: np.ndarray, normal: np.ndarray, group: np.ndarray, area: np.ndarray, total: np.ndarray
) -> np.ndarray:
    """Return the mean curvature around points of curved surfaces, weighted by area and closeness, shape [V, 3, 3].

    Args:
        point: The points [m], shape [V, 3].
        normal: Unit normals there, shape [V, 3].
        group: Curved surface of each, shape [V].
        area: Area of the faces that meet at each [m^2], shape [V].
        total: Sum of area times curvature over these, shape [V, 3, 3].
    """
    out = wp.empty(len(point), dtype=wp.mat33d, device="cpu")
    grid = wp.HashGrid(GRID_CELLS, GRID_CELLS, GRID_CELLS, device="cpu")
    near = wp.array(point - point.mean(axis=0), dtype=wp.vec3, device="cpu")
    grid.build(near, SMOOTHING_M)
    given = ((normal, wp.vec3d), (group, wp.int32), (area, wp.float64), (total, wp.mat33d))
    inputs = [grid.id, near, *(wp.array(values, dtype=dtype, device="cpu") for values, dtype in given), SMOOTHING_M]
    wp.launch(smooth_curvature_kernel, dim=len(point), inputs=inputs, outputs=[out], device="cpu")
    return out.numpy()


def turn_curvature(matrix: np.ndarray, normal: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return matrices over the planes across normals, turned with them to other normals the shortest way, [N, 3, 3]."""
    middle = normal + other
    turn = np.eye(3) - middle[:, :, None] * middle[:, None] / (1.0 + dot(normal, other))[:, None, None]
    turn = turn + 2.0 * other[:, :, None] * normal[:, None]
    return turn @ matrix @ turn.swapaxes(1, 2)
