"""Pass points at given times along the path of least snap, the fourth derivative, at rest at both ends.

The path is a polynomial of degree 7 in each leg, with continuous derivatives up to the sixth, so that the attitude of a
quadrotor that flies it is continuous with its rate. Between two equal points it rests.

Source: D. Mellinger, V. Kumar, Minimum snap trajectory generation and control for quadrotors, ICRA 2011.
"""

from math import perm

import numpy as np

ORDER = 4
"""Derivative whose square is least; those below it are zero at rest."""

TERMS = 2 * ORDER
"""Coefficients of a leg."""


def minimum_snap(times: np.ndarray, points: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return position, velocity and acceleration at instants; at rest before the first time and after the last.

    Args:
        times: Growing times [s], shape [N], N >= 2.
        points: Point at each time, shape [N, D].
        at: Instants [s], shape [T].

    Returns:
        Three arrays of shape [T, D], float64.
    """
    times, points = np.asarray(times, np.float64), np.asarray(points, np.float64)
    at = np.clip(np.asarray(at, np.float64), times[0], times[-1])
    knots = np.concatenate([points[:, None], _knot_derivatives(times, points)], axis=1)
    span = np.diff(times)
    legs = np.stack([_leg_matrix(span[k]) @ knots[k : k + 2].reshape(TERMS, -1) for k in range(len(span))])
    leg = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(span) - 1)
    share = (at - times[leg]) / span[leg]
    position, velocity, acceleration = (
        np.einsum("tk,tkd->td", _powers(order, share) / span[leg, None] ** order, legs[leg]) for order in range(3)
    )
    return position, velocity, acceleration


def _powers(order: int, share: np.ndarray | float) -> np.ndarray:
    """Return a derivative of s**0, s**1... at shares s of a leg, shape [..., TERMS]."""
    share = np.asarray(share, np.float64)
    return np.stack([perm(k, order) * share ** max(k - order, 0) for k in range(TERMS)], axis=-1)


def _leg_matrix(span: float) -> np.ndarray:
    """Return the matrix from the derivatives below `ORDER` at both ends of a leg of `span` [s] to its coefficients in
    shares of it, shape [TERMS, TERMS]."""
    unit = np.stack([_powers(order, end) for end in (0.0, 1.0) for order in range(ORDER)])
    return np.linalg.inv(unit) * np.tile(span ** np.arange(ORDER), 2)


def _knot_derivatives(times: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return velocity, acceleration and jerk at every time, shape [N, 3, D]: zero at rest, else such that the next
    three derivatives are continuous."""
    count, unknowns = len(points), ORDER - 1
    rests = (points[1:] == points[:-1]).all(axis=1)
    is_free = np.concatenate([[False], ~(rests[1:] | rests[:-1]), [False]])
    found = np.zeros((count, unknowns, points.shape[1]))
    free = np.flatnonzero(is_free).tolist()
    if not free:
        return found
    first = {knot: unknowns * k for k, knot in enumerate(free)}
    system = np.zeros((unknowns * len(free), unknowns * len(free)))
    right = np.zeros((unknowns * len(free), points.shape[1]))
    for knot in free:
        rows = slice(first[knot], first[knot] + unknowns)
        for leg, share, sign in ((knot - 1, 1.0, 1.0), (knot, 0.0, -1.0)):  # the end of one leg, the start of the next
            span = times[leg + 1] - times[leg]
            orders = np.stack([_powers(order, share) / span**order for order in range(ORDER, ORDER + unknowns)])
            matrix = sign * orders @ _leg_matrix(span)
            for end in (leg, leg + 1):
                part = matrix[:, ORDER * (end - leg) : ORDER * (end - leg + 1)]
                right[rows] -= part[:, :1] * points[end]
                if end in first:
                    system[rows, first[end] : first[end] + unknowns] += part[:, 1:]
    found[free] = np.linalg.solve(system, right).reshape(len(free), unknowns, -1)
    return found
