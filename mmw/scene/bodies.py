"""Place sensors, points and boxes on actors by their poses, in one launch on the host for all of them."""

import numpy as np
import warp as wp

from mmw.core.packed_arrays import borrow_arrays
from mmw.core.repeated_launch import launch_again
from mmw.kernels.core import bodies as kernels


def mounted_poses(bodies: np.ndarray, mounts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return poses of sensors, and which are there.

    Args:
        bodies: Actor of each sensor to world in some frames, NaN where absent, shape [F, n, 7]; quaternions need not
            be unit ones.
        mounts: Sensors to actors, shape [n, 7].

    Returns:
        Sensors to world, shape [F, n, 7], float64, and which actors are there, shape [F, n], bool.

    Raises:
        ValueError: If a quaternion is zero.
    """
    shape, count = bodies.shape[:2], bodies.shape[0] * bodies.shape[1]
    poses = ((count, 7), wp.float64)
    block = borrow_arrays("cpu", poses, ((len(mounts), 7), wp.float64), poses, ((count,), wp.bool), ((1,), wp.int32))
    held, own, pose, is_present, zeros = block.host
    held.reshape(bodies.shape)[:], own[:], zeros[0] = bodies, mounts, 0
    launch_again(kernels.mounted_poses_kernel, (count,), block.arrays, "cpu")
    made, found, has_zero = pose.reshape(*shape, 7).copy(), is_present.reshape(shape).copy(), zeros[0]
    block.release()
    if has_zero:
        raise ValueError("mounted_poses: a quaternion is zero; a rotation needs a length above zero; check the poses")
    return made, found


def points_on(bodies: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Return points on actors in the world [m], shape [N, 3], float64.

    Args:
        bodies: Actor of each point to world, shape [N, 7]; quaternions need not be unit ones.
        local: Points in the actors' frames [m], shape [N, 3].
    """
    points = ((len(bodies),), wp.vec3d)
    block = borrow_arrays("cpu", ((len(bodies), 7), wp.float64), points, points)
    block.host[0][:], block.host[1][:] = bodies, local
    launch_again(kernels.points_kernel, points[0], block.arrays, "cpu")
    made = block.host[-1].copy()
    block.release()
    return made
