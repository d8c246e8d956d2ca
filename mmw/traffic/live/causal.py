"""Filters of live traffic that need little or nothing of the future, in place of those of `mmw.traffic.idm.simulation`.

A recorded drive is smoothed with a Gaussian of 0.12 s on the stations, which looks 0.6 s ahead, and one of 0.15 s on
the accelerations that lean the body. Live, a control has to show sooner:

stations        weights of a uniform cubic B-spline with knots an engine step apart: standard deviation 0.029 s, and
                nothing beyond 80 ms. The acceleration of the engine is linear between its steps, so its jerk has jumps;
                smoothed, jerk and its derivative are continuous.
lean            two low passes of first order in a row with the variance of the Gaussian: the step response of a
                critically damped body on springs of 1.5 Hz. It lags, as a real body does.

Source: B-splines as repeated moving averages, M. Unser, IEEE Signal Process. Mag. 16 (1999), 22-38.
"""

import numpy as np

from mmw.core.constants import FRAME_DT, FRAME_RATE_HZ
from mmw.traffic.idm.driver import STEP
from mmw.traffic.vehicle_pose import LEAN_SIGMA

ROWS_PER_STEP = round(STEP * FRAME_RATE_HZ)
"""Poses at 100 Hz in a step of the engine."""


def _spline_weights() -> np.ndarray:
    box = np.full(ROWS_PER_STEP, 1.0 / ROWS_PER_STEP)
    weights = box
    for _ in range(3):
        weights = np.convolve(weights, box)
    return weights / weights.sum()


WEIGHTS = _spline_weights()
"""Weights of neighboring stations, symmetric, shape [2 REACH + 1]."""

REACH = len(WEIGHTS) // 2
"""Rows before and after a pose that its station depends on."""

LEAN_SHARE = -np.expm1(-FRAME_DT / (LEAN_SIGMA / np.sqrt(2.0)))
"""Share of a step that a low pass of the lean takes in a row."""

AT_REST = 1e-6
"""A body that does not accelerate and leans less than under this is upright [m/s^2], so that it comes to exact rest,
about two seconds after it stopped; 1e-9 rad."""


def hermite_rows(station: np.ndarray, speed: np.ndarray, first: int, count: int) -> np.ndarray:
    """Return stations at 100 Hz between steps of the engine: the cubic through stations and speeds.

    Args:
        station: Stations at the steps [m], shape [N, V].
        speed: Speeds there [m/s], shape [N, V].
        first: First row; row 0 is the first step.
        count: Rows.

    Returns:
        Shape [count, V].
    """
    row = np.arange(first, first + count)
    step = np.minimum(row // ROWS_PER_STEP, len(station) - 2)
    t = ((row - step * ROWS_PER_STEP) / ROWS_PER_STEP)[:, None]
    s0, s1, v0, v1 = station[step], station[step + 1], STEP * speed[step], STEP * speed[step + 1]
    return s0 + t * v0 + t**2 * (3 * (s1 - s0) - 2 * v0 - v1) + t**3 * (2 * (s0 - s1) + v0 + v1)


def smooth_station(rows: np.ndarray) -> np.ndarray:
    """Return the smoothed stations in the middle of `2 REACH + 1` rows, shape [V]; at rest exactly at rest."""
    return rows[REACH] + WEIGHTS @ (rows - rows[REACH])


class LeanFilter:
    """Low pass of the accelerations that lean the bodies."""

    def __init__(self, count: int) -> None:
        """Start `count` bodies at rest."""
        self._first, self._second = np.zeros((count, 2)), np.zeros((count, 2))

    def take(self, acceleration: np.ndarray) -> np.ndarray:
        """Return the acceleration that leans each body after one more row of accelerations, shape [V, 2] [m/s^2]."""
        self._first += LEAN_SHARE * (acceleration - self._first)
        self._second += LEAN_SHARE * (self._first - self._second)
        for state in (self._first, self._second):
            state[(acceleration == 0.0) & (np.abs(state) < AT_REST)] = 0.0
        return self._second
