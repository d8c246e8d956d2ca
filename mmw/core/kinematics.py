"""Compute velocity, acceleration and angular rate of moving bodies by central differences of their float64 poses.

At frame k, with p the position, R the rotation, dt the time between frames and u_k = log(R_k^-1 R_(k+1)) / dt the mean
body rate of the interval after k:

    velocity      v_k = (p_(k+1) - p_(k-1)) / (2 dt)
    acceleration  a_k = (p_(k+1) - 2 p_k + p_(k-1)) / dt^2
    body rate     w_k = (u_(k-1) + u_k) / 2

so that `p_(k+1) = p_k + v_k dt + a_k dt^2 / 2` and `v_(k+1) = v_k + (a_k + a_(k+1)) dt / 2` hold exactly (velocity
Verlet). u_(k-1) and u_k are both given in the body frame of frame k, because a rotation does not change its own axis.

The frames at both ends of a recording have one neighbor. The missing one is extrapolated: positions by the cubic
through the nearest four (lower for shorter recordings), rotations by a constant angular
acceleration. The formulas above and both identities then hold there too. A body with one frame is at rest.
`mmw.kernels.core.body_motion` computes them body by body, so that nothing depends on the other bodies, nor on the
other frames of a body than the few about it.

Source: L. Verlet, Phys. Rev. 159 (1967); rotation vectors as in J. Solà (2017), section 4.
"""

import math
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.core.constants import FRAME_DT
from mmw.core.packed_arrays import borrow_arrays
from mmw.core.repeated_launch import launch_again
from mmw.kernels.core.body_motion import differences_kernel


@dataclass(frozen=True)
class Motion:
    """Derivatives of a series of poses, shape [F, ..., 3]; NaN where the body is absent."""

    velocity: np.ndarray
    """Velocity in the world frame [m/s]."""
    acceleration: np.ndarray
    """Acceleration in the world frame, without gravity [m/s^2]."""
    body_rate: np.ndarray
    """Angular velocity in the body's own frame [rad/s]: the reading of a gyroscope fixed to it."""
    world_rate: np.ndarray
    """The same angular velocity in the world frame [rad/s]."""


def differentiate(poses: np.ndarray, dt: float = FRAME_DT) -> Motion:
    """Return the derivatives of poses at every frame.

    Args:
        poses: Body-to-world (x, y, z, qx, qy, qz, qw) in consecutive frames, shape [F, ..., 7]; NaN where absent.
        dt: Time between frames [s].

    Returns:
        Derivatives, shape [F, ..., 3]. Each interval of presence of a body is differentiated separately.

    Raises:
        ValueError: If a quaternion is zero.
    """
    poses = np.asarray(poses, dtype=np.float64)
    return _derivatives(poses, 0, len(poses), dt)


def differentiate_row(poses: np.ndarray, row: int, dt: float = FRAME_DT) -> Motion:
    """Return the derivatives at one frame, bit for bit those of `differentiate`, which looks at all of them.

    Args:
        poses: Body-to-world in consecutive frames, shape [F, ..., 7], float64; NaN where absent.
        row: Row of `poses`.
        dt: Time between frames [s].

    Returns:
        Derivatives, shape [..., 3].
    """
    start = max(row - REACH_FRAMES, 0)
    motion = _derivatives(poses[start : row + REACH_FRAMES + 1], row - start, 1, dt)
    return Motion(motion.velocity[0], motion.acceleration[0], motion.body_rate[0], motion.world_rate[0])


def _derivatives(poses: np.ndarray, first: int, count: int, dt: float) -> Motion:
    """Return the derivatives at some rows of poses [F, ..., 7], shape [count, ..., 3]."""
    bodies = poses.reshape(len(poses), math.prod(poses.shape[1:-1]), 7)
    shape = count, bodies.shape[1]
    block = borrow_arrays("cpu", (bodies.shape, wp.float64), ((4, *shape), wp.vec3d), ((1,), wp.int32))
    values, found, zero = block.host
    values[...], zero[0] = bodies, 0
    launch_again(differences_kernel, shape, [block.arrays[0], first, dt, *block.arrays[1:]], "cpu")
    out, is_zero = found.reshape(4, count, *poses.shape[1:-1], 3).copy(), bool(zero[0])
    block.release()
    if is_zero:
        raise ValueError("differentiate: a quaternion is zero; a rotation needs a length above zero; check the poses")
    return Motion(*out)


def placed(motion: Motion, rows: int | slice, count: int) -> Motion:
    """Return derivatives of shape [count, ..., 3] with given ones in some rows; NaN in the others."""
    given = (motion.velocity, motion.acceleration, motion.body_rate, motion.world_rate)
    out = np.full((len(given), count, *given[0].shape[-2:]), np.nan)
    out[:, rows] = given
    return Motion(*out)


REACH_FRAMES = 4
"""Frames on either side on which the derivatives of a frame may depend: an open end uses the nearest four."""


def window(rows: np.ndarray) -> slice:
    """Return the part of a recording on which the derivatives of some of its rows depend."""
    listed = rows.tolist() or [0]
    return slice(max(min(listed) - REACH_FRAMES, 0), max(listed) + REACH_FRAMES + 1)


def differentiate_rows(
    poses: np.ndarray, rows: np.ndarray, dt: float = FRAME_DT, known: Motion | None = None
) -> Motion:
    """Return the derivatives at some frames of a recording, bit for bit those of `differentiate`.

    Args:
        poses: Body-to-world in consecutive frames, shape [F, ..., 7], float64; NaN where absent.
        rows: Rows of `poses`, in any order, shape [S].
        dt: Time between frames [s].
        known: `differentiate` of all poses, if there is one; it serves where the rows depend on the whole recording.

    Returns:
        Derivatives, shape [S, ..., 3].
    """
    motion, at, _ = motion_at(poses, rows, dt, known)
    return Motion(motion.velocity[at], motion.acceleration[at], motion.body_rate[at], motion.world_rate[at])


def motion_at(
    poses: np.ndarray, rows: np.ndarray, dt: float = FRAME_DT, known: Motion | None = None
) -> tuple[Motion, np.ndarray, slice]:
    """Return derivatives of frames around some rows, where each of the rows is among them, shape [S], and the rows of
    `poses` that they are of.

    Those at the rows are the ones of `differentiate_rows`, whose arguments these are.
    """
    part = window(rows)
    is_whole = part.start == 0 and part.stop >= len(poses)
    motion = known if is_whole and known is not None else differentiate(poses[part], dt)
    return motion, rows - part.start, part


EXTRAPOLATION = {
    count: np.array([weights])
    for count, weights in {1: (1.0,), 2: (2.0, -1.0), 3: (3.0, -3.0, 1.0), 4: (4.0, -6.0, 4.0, -1.0)}.items()
}
"""Weights of the first n samples that extrapolate their polynomial (degree n - 1) one step backward, shape [1, n]."""


def extend(series: np.ndarray) -> np.ndarray:
    """Return a series with one more value at both ends, by the cubic through the nearest four (lower for fewer)."""
    return np.concatenate([_one_before(series)[None], series, _one_before(series[::-1])[None]])


def _one_before(series: np.ndarray) -> np.ndarray:
    first, count = series[0], min(len(series), 4)
    # The weights sum to one; with differences to the first sample, a body at rest is exactly at rest.
    return first + np.dot(EXTRAPOLATION[count], (series[:count] - first).reshape(count, -1)).reshape(first.shape)
