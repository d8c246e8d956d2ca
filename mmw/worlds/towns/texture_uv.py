"""Texture coordinates of town meshes: meters along the surface, upright on walls, on the map on level ground."""

import numpy as np

from mmw.core.mesh import TriangleMesh

LEVEL = 0.9
"""A face whose normal's vertical share exceeds this takes its coordinates from the map."""

GRID_M = 1.0e-3
"""Coordinates are rounded to this [m]."""

PICTURE_GRID = 1.0 / 4096.0
"""Coordinates of pictures are rounded to this."""


def texture_coordinates(mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray | None]:
    """Return texture coordinates in meters, the same scale on every face, without a seam inside a plane.

    On level faces they are x and y. On all others s runs horizontally, to the right seen from the front, and t up the
    slope.

    Args:
        mesh: The mesh.

    Returns:
        Coordinates (s, t) [m], float32: one a vertex, shape [N, 2], and None; or, where a vertex needs several, the
        different ones, shape [K, 2], and the index of each corner into them, shape [3 M], int32.
    """
    normal = np.round(mesh.normals, 5)  # neighboring faces of one plane agree
    flat = (np.abs(normal[:, 2]) > LEVEL) | ~normal.any(axis=1)  # a face without area has no slope
    across = np.stack([-normal[:, 1], normal[:, 0], np.zeros(len(normal))], axis=1)
    across = np.where(flat[:, None], (1.0, 0.0, 0.0), across)
    across = across / np.linalg.norm(across, axis=1, keepdims=True)
    upward = np.where(flat[:, None], (0.0, 1.0, 0.0), np.cross(normal, across))
    st = np.stack([np.einsum("fcx,fx->fc", mesh.corners, axis) for axis in (across, upward)], axis=-1)
    steps = np.round(st.reshape(-1, 2) / GRID_M).astype(np.int64)
    vertex = mesh.faces.reshape(-1).astype(np.int64)
    keyed, first, inverse = np.unique(np.column_stack([vertex, steps]), axis=0, return_index=True, return_inverse=True)
    if len(keyed) == len(mesh.points) and np.array_equal(keyed[:, 0], np.arange(len(mesh.points))):
        return (keyed[:, 1:] * GRID_M).astype(np.float32), None
    return _by_first_use(keyed[:, 1:] * GRID_M, first, inverse)


def indexed(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the different ones of the coordinates of all corners [C, 2], shape [K, 2], float32, and an index [C]."""
    steps = np.round(corners / PICTURE_GRID).astype(np.int64)
    keyed, first, inverse = np.unique(steps, axis=0, return_index=True, return_inverse=True)
    return _by_first_use(keyed * PICTURE_GRID, first, inverse)


def _by_first_use(values: np.ndarray, first: np.ndarray, inverse: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values in the order of their first use, float32, and the index of each use, int32."""
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return values[order].astype(np.float32), rank[inverse.reshape(-1)].astype(np.int32)
