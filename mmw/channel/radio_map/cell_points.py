"""Draw points in the cells of a measurement surface, and find the cells of points."""

import numpy as np

from mmw.channel.radio_map.measurement_surface import MeasurementSurface

PAIRS_AT_ONCE = 2**20
"""Maximum number of pairs of a point and a triangle that are looked at together."""


def sample_in_cells(surface: MeasurementSurface, cells: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Return points that are uniform over the area of some cells, world frame [m], shape [count, 3].

    Args:
        surface: The cells.
        cells: Whether a cell is one of them, shape [C], bool; at least one is.
        count: Number of points.
        seed: Seed of NumPy's default generator.
    """
    mesh, rng = surface.mesh, np.random.default_rng(seed)
    faces = np.flatnonzero(cells[surface.cell_of_face])
    share = np.cumsum(mesh.areas[faces])
    drawn = np.searchsorted(share, rng.random(count) * share[-1], side="right")
    corners = mesh.corners[faces[np.minimum(drawn, len(faces) - 1)]]
    u, v = rng.random((2, count))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    edges = corners[:, 1:] - corners[:, :1]
    return corners[:, 0] + u[:, None] * edges[:, 0] + v[:, None] * edges[:, 1]


def grid_in_cells(surface: MeasurementSurface, count: int) -> np.ndarray:
    """Return points at the middles of a regular division of each cell into parts of equal area.

    A cell of four corners is divided into sqrt(count) x sqrt(count) parallelograms if it is one, a triangle into as
    many triangles.

    Args:
        surface: The C cells.
        count: Number of points of each, the square of a whole number; 1 gives the middle.

    Returns:
        Points, cell by cell, world frame [m], shape [C * count, 3].
    """
    if count == 1:
        return surface.center
    sides, steps = surface.corners.shape[1], round(count**0.5)
    at = (np.arange(steps) + 0.5) / steps
    u, v = (k.ravel() for k in np.meshgrid(at, at))
    if sides == 4:
        share = np.stack([(1.0 - u) * (1.0 - v), u * (1.0 - v), u * v, (1.0 - u) * v], axis=1)
    else:
        i, j, turned = (k.ravel() for k in np.indices((steps, steps, 2)))
        inside = i + j + turned < steps
        first = (i + (1 + turned) / 3.0)[inside] / steps
        second = (j + (1 + turned) / 3.0)[inside] / steps
        share = np.stack([1.0 - first - second, first, second], axis=1)
    return np.einsum("ks,csx->ckx", share, surface.corners).reshape(-1, 3)


def find_cells(surface: MeasurementSurface, positions: np.ndarray, max_distance_m: float) -> np.ndarray:
    """Return the cell that each point is over: of those in whose outline the foot of its perpendicular is, the nearest.

    Args:
        surface: The cells.
        positions: Points, world frame [m], shape [N, 3].
        max_distance_m: Points farther from a cell than this are not over it [m].

    Returns:
        Cell, shape [N], int32; -1 for a point that is over none. Of cells equally near, the one with the lowest number.
    """
    corners, normals = surface.mesh.corners, surface.mesh.normals
    low, high = corners.min(axis=1), corners.max(axis=1)
    order = np.argsort(low[:, 0], kind="stable")
    # A triangle that reaches a point begins at most the widest one's width before it.
    ends = low[order, 0]
    widest = (high[:, 0] - low[:, 0]).max()
    first = np.searchsorted(ends, positions[:, 0] - max_distance_m - widest)
    count = np.searchsorted(ends, positions[:, 0] + max_distance_m, side="right") - first
    found = np.full(len(positions), -1, dtype=np.int32)
    portions = np.cumsum(count) // PAIRS_AT_ONCE
    for portion in np.unique(portions):
        rows = np.flatnonzero(portions == portion)
        point = np.repeat(rows, count[rows])
        number = np.arange(len(point)) - np.repeat(np.cumsum(count[rows]) - count[rows], count[rows])
        face = order[first[point] + number]
        reach = (
            (positions[point] >= low[face] - max_distance_m) & (positions[point] <= high[face] + max_distance_m)
        ).all(axis=1)
        point, face = point[reach], face[reach]
        distance = np.abs(np.einsum("kx,kx->k", positions[point] - corners[face, 0], normals[face]))
        inside = distance <= max_distance_m
        for k in range(3):
            edge = corners[face, (k + 1) % 3] - corners[face, k]
            turn = np.einsum("kx,kx->k", np.cross(edge, positions[point] - corners[face, k]), normals[face])
            inside &= turn >= -1e-9 * np.linalg.norm(edge, axis=1)
        point, cell, distance = point[inside], surface.cell_of_face[face[inside]], distance[inside]
        best = np.lexsort((cell, distance, point))[::-1]  # of one point, the last that is written is the nearest
        found[point[best]] = cell[best]
    return found
