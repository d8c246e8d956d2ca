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
from collections.abc import Callable, Iterator
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
    for start, stop, alike in _intervals(is_present.reshape(bodies.shape[:2])):
        motion = _differentiate_interval(bodies[start:stop, alike], dt, extend_each)
        out[:, start:stop, alike] = motion.velocity, motion.acceleration, motion.body_rate, motion.world_rate
    return Motion(*out.reshape(4, *poses.shape[:-1], 3))


def _intervals(presence: np.ndarray) -> Iterator[tuple[int, int, list[int]]]:
    """Yield intervals of presence, shape [F, N]: first frame, one past the last, and the bodies that have it."""
    alike: dict[bytes, list[int]] = {}
    for body, own in enumerate(presence.T):
        alike.setdefault(own.tobytes(), []).append(body)
    for bodies in alike.values():
        edges = np.flatnonzero(np.diff(np.concatenate([[False], presence[:, bodies[0]], [False]])))
        for start, stop in edges.reshape(-1, 2).tolist():
            yield start, stop, bodies


def differentiate_row(poses: np.ndarray, row: int, dt: float = FRAME_DT) -> Motion:
    """Return the derivatives at one frame, bit for bit those of `differentiate`, which looks at all of them.

    Args:
        poses: Body-to-world in consecutive frames, shape [F, ..., 7], float64; NaN where absent.
        row: Row of `poses`, neither the first nor the last.
        dt: Time between frames [s].

    Returns:
        Derivatives, shape [..., 3].
    """
    around = poses[row - 1 : row + 2]
    is_present = np.asarray(np.isfinite(around).all(axis=-1))
    if (is_present == is_present[1]).all():
        q = normalize(around[..., 3:])
        motion, row = _central(around[..., :3], q[1:2], _interval_rates(q, dt), dt), 0
    else:
        motion = differentiate(poses, dt)
    return Motion(motion.velocity[row], motion.acceleration[row], motion.body_rate[row], motion.world_rate[row])


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


def _differentiate_interval(
    poses: np.ndarray, dt: float, extended: Callable[[np.ndarray], np.ndarray] | None = None
) -> Motion:
    q = normalize(poses[..., 3:])
    rates = _interval_rates(q, dt)
    if len(rates) == 0:
        rates = np.zeros((2, *q.shape[1:-1], 3))
    else:
        second = min(1, len(rates) - 1)
        before = 2.0 * rates[0] - rates[second]
        after = 2.0 * rates[-1] - rates[-1 - second]
        rates = np.concatenate([before[None], rates, after[None]])
    return _central((extended or extend)(poses[..., :3]), q, rates, dt)


def _interval_rates(q: np.ndarray, dt: float) -> np.ndarray:
    """Return the mean body rate between neighboring frames, shape [F - 1, ..., 3]."""
    return quaternion_log(multiply(conjugate(q[:-1]), q[1:])) / dt


def _central(position: np.ndarray, q: np.ndarray, interval_rate: np.ndarray, dt: float) -> Motion:
    """Return the derivatives at F frames: positions of F + 2, attitudes of F, rates of the F + 1 intervals between."""
    velocity = (position[2:] - position[:-2]) / (2.0 * dt)
    acceleration = (position[2:] - 2.0 * position[1:-1] + position[:-2]) / dt**2
    body_rate = 0.5 * (interval_rate[:-1] + interval_rate[1:])
    return Motion(velocity, acceleration, body_rate, rotate(q, body_rate))


EXTRAPOLATION = {
    count: np.array([weights])
    for count, weights in {1: (1.0,), 2: (2.0, -1.0), 3: (3.0, -3.0, 1.0), 4: (4.0, -6.0, 4.0, -1.0)}.items()
}
"""Weights of the first n samples that extrapolate their polynomial (degree n - 1) one step backward, shape [1, n]."""


def extend(series: np.ndarray) -> np.ndarray:
    """Return a series with one more value at both ends, by the cubic through the nearest four (lower for fewer)."""
    return np.concatenate([_one_before(series)[None], series, _one_before(series[::-1])[None]])


def extend_each(series: np.ndarray) -> np.ndarray:
    """Return `extend` of a series [F, N, 3] body by body: sums of all bodies at once may round otherwise."""
    bodies = [series[:, body] for body in range(series.shape[1])]
    ends = [[_one_before(own) for own in bodies], [_one_before(own[::-1]) for own in bodies]]
    return np.concatenate([ends[:1], series, ends[1:]])


def _one_before(series: np.ndarray) -> np.ndarray:
    first, count = series[0], min(len(series), 4)
    # The weights sum to one; with differences to the first sample, a body at rest is exactly at rest.
    return first + np.dot(EXTRAPOLATION[count], (series[:count] - first).reshape(count, -1)).reshape(first.shape)
