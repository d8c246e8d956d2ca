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

Source: L. Verlet, Phys. Rev. 159 (1967); rotation vectors as in J. Solà (2017), section 4.
"""

import math
from dataclasses import dataclass

import numpy as np

from mmw.core.constants import FRAME_DT
from mmw.core.transforms import conjugate, multiply, normalize, quaternion_log, rotate


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
    """
    poses = np.asarray(poses, dtype=np.float64)
    is_present = np.isfinite(poses).all(axis=-1)
    if poses.size and is_present.all():
        return _differentiate_interval(poses, dt)
    bodies = poses.reshape(len(poses), math.prod(poses.shape[1:-1]), 7)
    out = np.full((4, len(poses), bodies.shape[1], 3), np.nan)
    for body, presence in enumerate(is_present.reshape(bodies.shape[:2]).T):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], presence, [False]])))
        for start, stop in edges.reshape(-1, 2):
            motion = _differentiate_interval(bodies[start:stop, body], dt)
            out[:, start:stop, body] = motion.velocity, motion.acceleration, motion.body_rate, motion.world_rate
    return Motion(*out.reshape(4, *poses.shape[:-1], 3))


REACH_FRAMES = 4
"""Frames on either side on which the derivatives of a frame may depend: an open end uses the nearest four."""


def window(rows: np.ndarray) -> slice:
    """Return the part of a recording on which the derivatives of some of its rows depend."""
    first, last = (int(rows.min()), int(rows.max())) if len(rows) else (0, 0)
    return slice(max(first - REACH_FRAMES, 0), last + REACH_FRAMES + 1)


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
    part = window(rows)
    is_whole = part.start == 0 and part.stop >= len(poses)
    motion = known if is_whole and known is not None else differentiate(poses[part], dt)
    at = rows - part.start
    return Motion(motion.velocity[at], motion.acceleration[at], motion.body_rate[at], motion.world_rate[at])


def _differentiate_interval(poses: np.ndarray, dt: float) -> Motion:
    q = normalize(poses[..., 3:])
    position = extend(poses[..., :3])
    velocity = (position[2:] - position[:-2]) / (2.0 * dt)
    acceleration = (position[2:] - 2.0 * position[1:-1] + position[:-2]) / dt**2
    interval_rate = quaternion_log(multiply(conjugate(q[:-1]), q[1:])) / dt
    if len(interval_rate) == 0:
        body_rate = np.zeros_like(velocity)
    else:
        second = min(1, len(interval_rate) - 1)
        before = 2.0 * interval_rate[0] - interval_rate[second]
        after = 2.0 * interval_rate[-1] - interval_rate[-1 - second]
        interval_rate = np.concatenate([before[None], interval_rate, after[None]])
        body_rate = 0.5 * (interval_rate[:-1] + interval_rate[1:])
    return Motion(velocity, acceleration, body_rate, rotate(q, body_rate))


EXTRAPOLATION = {1: (1.0,), 2: (2.0, -1.0), 3: (3.0, -3.0, 1.0), 4: (4.0, -6.0, 4.0, -1.0)}
"""Weights of the first n samples that extrapolate their polynomial (degree n - 1) one step backward."""


def extend(series: np.ndarray) -> np.ndarray:
    """Return a series with one more value at both ends, by the cubic through the nearest four (lower for fewer)."""
    return np.concatenate([_one_before(series)[None], series, _one_before(series[::-1])[None]])


def _one_before(series: np.ndarray) -> np.ndarray:
    count = min(len(series), 4)
    # The weights sum to one; with differences to the first sample, a body at rest is exactly at rest.
    return series[0] + np.tensordot(np.array(EXTRAPOLATION[count]), series[:count] - series[0], axes=1)
