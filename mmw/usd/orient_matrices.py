"""Make the matrices that USD makes of quaternions, many at once, to the bit."""

from functools import cache

import numpy as np
import warp as wp
from pxr import Gf, Vt

from mmw.core.packed_arrays import borrow_arrays
from mmw.core.repeated_launch import launch_again
from mmw.kernels.core.stage_poses import orient_kernel


def orient_matrices(q: np.ndarray) -> np.ndarray:
    """Return the matrices of an operation `xformOp:orient` of double precision.

    USD makes an axis and an angle in degrees of a quaternion, and these a matrix.

    Args:
        q: Unit quaternions (x, y, z, w), shape [N, 4], float64.

    Returns:
        Matrices of row vectors, shape [N, 3, 3].
    """
    return _matrices(q) if rounds_as_usd() else _matrices_by_usd(q)


@cache
def rounds_as_usd() -> bool:
    """Return whether our kernel rounds as the installed USD, which a build with fused products and sums does not."""
    q = np.random.default_rng(0).normal(size=(64, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    return bool((_matrices(q) == _matrices_by_usd(q)).all())


def _matrices_by_usd(q: np.ndarray) -> np.ndarray:
    """Return the matrices that USD itself makes, one after the other, as `UsdGeomXformOp` does."""
    rotations, origin = map(Gf.Rotation, Vt.QuatdArray.FromNumpy(np.ascontiguousarray(q))), Gf.Vec3d(0.0)
    matrices = Vt.Matrix4dArray([Gf.Matrix4d(rotation, origin) for rotation in rotations])
    return np.array(matrices).reshape(-1, 4, 4)[:, :3, :3]


def _matrices(q: np.ndarray) -> np.ndarray:
    """Return the matrices that our kernel makes, with the operations of USD in their order."""
    block = borrow_arrays("cpu", ((len(q),), wp.vec4d), ((len(q),), wp.mat33d))
    block.host[0][...] = q
    launch_again(orient_kernel, (len(q),), block.arrays, "cpu")
    found = block.host[1].copy()
    block.release()
    return found
