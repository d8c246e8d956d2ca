"""Do float64 vector algebra on rows, written out by component so that a row's bits never depend on its neighbors."""

import numpy as np


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the scalar product over the last axis, shape [..., 3] -> [...]."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def norm(a: np.ndarray) -> np.ndarray:
    """Return the length over the last axis, shape [..., 3] -> [...]."""
    return np.sqrt(dot(a, a))


def stacked(x: np.ndarray, y: np.ndarray, z: np.ndarray | float) -> np.ndarray:
    """Return vectors of three components of one shape, or a number for the last, shape [...] -> [..., 3]."""
    out = np.empty((*np.shape(x), 3))
    out[..., 0], out[..., 1], out[..., 2] = x, y, z
    return out


def rotate(rotation: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return `rotation` times `vector`, shapes [..., 3, 3] and [..., 3]."""
    x, y, z = vector[..., None, 0], vector[..., None, 1], vector[..., None, 2]
    return rotation[..., :, 0] * x + rotation[..., :, 1] * y + rotation[..., :, 2] * z


def unrotate(rotation: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return the transpose of `rotation` times `vector`, shapes [..., 3, 3] and [..., 3]."""
    x, y, z = vector[..., None, 0], vector[..., None, 1], vector[..., None, 2]
    return rotation[..., 0, :] * x + rotation[..., 1, :] * y + rotation[..., 2, :] * z


def direction_angles(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return zenith from +z in [0, pi] and azimuth from +x in (-pi, pi] of directions, shape [..., 3] -> [...].

    The azimuth of a direction within 1e-9 of the z axis is 0.
    """
    across = np.sqrt(direction[..., 0] ** 2 + direction[..., 1] ** 2)
    theta = np.arctan2(across, direction[..., 2])
    phi = np.where(across < 1e-9, 0.0, np.arctan2(direction[..., 1], direction[..., 0]))
    return theta, phi


def unit_vector(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Return the directions of zenith and azimuth angles [rad], shape [...] -> [..., 3]."""
    return stacked(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta))


def spherical_basis(theta: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the unit vectors of growing zenith and growing azimuth, shape [...] -> [..., 3] each."""
    sin_t, cos_t, sin_p, cos_p = np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi)
    return stacked(cos_t * cos_p, cos_t * sin_p, -sin_t), stacked(-sin_p, cos_p, 0.0)


def times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the products of 2x2 matrices, shape [..., 2, 2] each, written out so that rows do not depend on others."""
    return a[..., :, 0, None] * b[..., None, 0, :] + a[..., :, 1, None] * b[..., None, 1, :]
