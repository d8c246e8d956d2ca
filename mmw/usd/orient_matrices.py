"""Make the matrices that USD makes of quaternions, many at once, to the bit."""

import math
from collections.abc import Callable
from functools import cache

import numpy as np
from pxr import Gf, Vt

MIN_LENGTH = 1.0e-10
"""Length of the vector part below which a quaternion is no turn: `GF_MIN_VECTOR_LENGTH` of `pxr/base/gf/limits.h`."""

DEGREES = 180.0 / math.pi
"""Degrees in a radian, and `RADIANS` the other way round: one product each, as in `pxr/base/gf/math.h`."""

RADIANS = math.pi / 180.0


def orient_matrices(q: np.ndarray) -> np.ndarray:
    """Return the matrices of an operation `xformOp:orient` of double precision.

    USD makes an axis and an angle in degrees of a quaternion, and these a matrix.

    Args:
        q: Unit quaternions (x, y, z, w), shape [N, 4], float64.

    Returns:
        Matrices of row vectors, shape [N, 3, 3].
    """
    return _matrices(q) if _rounds_as_usd() else _matrices_by_usd(q)


@cache
def _rounds_as_usd() -> bool:
    """Return whether NumPy rounds as the installed USD, which a build with fused products and sums does not."""
    q = np.random.default_rng(0).normal(size=(64, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    return bool((_matrices(q) == _matrices_by_usd(q)).all())


def _matrices_by_usd(q: np.ndarray) -> np.ndarray:
    """Return the matrices that USD itself makes, one after the other, as `UsdGeomXformOp` does."""
    rotations, origin = map(Gf.Rotation, Vt.QuatdArray.FromNumpy(np.ascontiguousarray(q))), Gf.Vec3d(0.0)
    matrices = Vt.Matrix4dArray([Gf.Matrix4d(rotation, origin) for rotation in rotations])
    return np.array(matrices).reshape(-1, 4, 4)[:, :3, :3]


def _matrices(q: np.ndarray) -> np.ndarray:
    """Return the matrices with the operations of USD in their order.

    Source: `GfRotation::SetQuat` and `GetQuat` of `pxr/base/gf/rotation.cpp`, `GfMatrix4d::_SetRotateFromQuat` of
    `matrix4d.cpp`; sines are those of the C library, not of NumPy.
    """
    x, y, z, w = (np.ascontiguousarray(part) for part in q.T)
    length = np.sqrt(x * x + y * y + z * z)
    is_turned = length > MIN_LENGTH
    scale = 1.0 / np.where(is_turned, length, 1.0)
    degrees = 2.0 * (_of_each(math.acos, np.clip(w, -1.0, 1.0)) * DEGREES)
    half = degrees * RADIANS / 2.0
    sine, cosine = _of_each(math.sin, half), _of_each(math.cos, half)
    x, y, z = x * scale * sine, y * scale * sine, z * scale * sine
    length = np.sqrt(cosine * cosine + (x * x + y * y + z * z))
    scale = 1.0 / length
    x, y, z, w = x * scale, y * scale, z * scale, cosine / length
    out = np.empty((len(q), 3, 3))
    out[:, 0, 0], out[:, 0, 1], out[:, 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (z * x - y * w)
    out[:, 1, 0], out[:, 1, 1], out[:, 1, 2] = 2 * (x * y - z * w), 1 - 2 * (z * z + x * x), 2 * (y * z + x * w)
    out[:, 2, 0], out[:, 2, 1], out[:, 2, 2] = 2 * (z * x + y * w), 2 * (y * z - x * w), 1 - 2 * (y * y + x * x)
    if not is_turned.all():
        out[~is_turned] = np.eye(3)
    return out


def _of_each(function: Callable[[float], float], values: np.ndarray) -> np.ndarray:
    return np.array(list(map(function, values.tolist())))
