"""Derivatives of poses in plain NumPy: the formulas of `mmw.core.kinematics` on whole recordings, float64."""

import numpy as np

from mmw.core.kinematics import Motion
from mmw.core.transforms import conjugate, multiply, normalize, quaternion_log, rotate


def differentiate_plainly(poses: np.ndarray, dt: float) -> Motion:
    """Return the derivatives of poses [F, N, 7], NaN where absent, body by body and interval by interval."""
    out = np.full((4, *poses.shape[:2], 3), np.nan)
    for body in range(poses.shape[1]):
        presence = np.isfinite(poses[:, body]).all(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], presence, [False]])))
        for start, stop in edges.reshape(-1, 2).tolist():
            out[:, start:stop, body] = _of_interval(poses[start:stop, body], dt)
    return Motion(*out)


def _of_interval(poses: np.ndarray, dt: float) -> tuple[np.ndarray, ...]:
    q = normalize(poses[:, 3:])
    rates = quaternion_log(multiply(conjugate(q[:-1]), q[1:])) / dt
    if len(rates) == 0:
        rates = np.zeros((2, 3))
    else:
        second = min(1, len(rates) - 1)
        rates = np.concatenate([[2.0 * rates[0] - rates[second]], rates, [2.0 * rates[-1] - rates[-1 - second]]])
    position = np.concatenate([[_before(poses[:, :3])], poses[:, :3], [_before(poses[::-1, :3])]])
    body_rate = 0.5 * (rates[:-1] + rates[1:])
    return (
        (position[2:] - position[:-2]) / (2.0 * dt),
        (position[2:] - 2.0 * position[1:-1] + position[:-2]) / dt**2,
        body_rate,
        rotate(q, body_rate),
    )


def _before(series: np.ndarray) -> np.ndarray:
    """Return the value before a series, by the polynomial through its first four values or fewer (Lagrange)."""
    some = series[:4]
    weights = [np.prod([(-1.0 - j) / (k - j) for j in range(len(some)) if j != k]) for k in range(len(some))]
    return np.array(weights) @ some
