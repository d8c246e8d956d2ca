"""Shading normals of meshes: smooth where faces meet at a small angle, with hard edges elsewhere."""

import numpy as np


def crease_normals(vertex: np.ndarray, normal: np.ndarray, weighted: np.ndarray, crease_cos: float) -> np.ndarray:
    """Return the normal of every corner: the mean of the faces around it that lie less than an angle from its own.

    Args:
        vertex: Vertex of each corner, shape [M, 3].
        normal: Unit normal of each face, shape [M, 3].
        weighted: Normal of the face of each corner, times its weight in the mean, shape [3 M, 3].
        crease_cos: Cosine of the angle.

    Returns:
        Unit normals, shape [M, 3, 3].
    """
    order = np.argsort(vertex.reshape(-1), kind="stable")
    result = np.empty_like(weighted)
    for group in np.split(order, np.flatnonzero(np.diff(vertex.reshape(-1)[order])) + 1):
        own = normal[group // 3]
        total = (own @ own.T > crease_cos) @ weighted[group]
        result[group] = total / np.linalg.norm(total, axis=1, keepdims=True)
    return result.reshape(-1, 3, 3)
