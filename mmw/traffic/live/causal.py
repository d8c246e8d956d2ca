"""Filters of live traffic that need little or nothing of the future, in place of those of `mmw.traffic.idm.simulation`.

A recorded drive is smoothed with a Gaussian of 0.12 s on the stations, which looks 0.6 s ahead, and one of 0.15 s on
the accelerations that lean the body. Live, a control has to show sooner:

stations        a moving average with the variance of the Gaussian, and two over an engine step: nothing beyond 240 ms.
                Of all symmetric kernels that do not rise away from their middle, the moving average has the shortest
                reach for its variance, so that places, accelerations and jerk are those of a recording. The
                acceleration of the engine is linear between its steps, so its jerk has jumps; smoothed, jerk and its
                derivative are continuous.
lean            two low passes of first order in a row with the variance of the Gaussian: the step response of a
                critically damped body on springs of 1.5 Hz. It lags, as a real body does.

Source: repeated moving averages as kernels with compact support, M. Unser, IEEE Signal Process. Mag. 16 (1999), 22-38.
"""

from collections.abc import Sequence

import numpy as np

from mmw.core.constants import FRAME_DT, FRAME_RATE_HZ
from mmw.traffic.idm.driver import STEP
from mmw.traffic.idm.simulation import STATION_SIGMA
from mmw.traffic.vehicle_pose import LEAN_SIGMA, Shape, lean_per_acceleration, tilted_poses

ROWS_PER_STEP = round(STEP * FRAME_RATE_HZ)
"""Poses at 100 Hz in a step of the engine."""


AVERAGE_ROWS = round(np.sqrt(12 * (STATION_SIGMA * FRAME_RATE_HZ) ** 2 + 1 - 2 * (ROWS_PER_STEP**2 - 1)))
"""Length of the long moving average. Averages over n rows have a variance of (n^2 - 1) / 12 rows^2, so those of all
three add up to the Gaussian's."""


def _moving_averages(*lengths: int) -> np.ndarray:
    weights = np.ones(1)
    for length in lengths:
        weights = np.convolve(weights, np.full(length, 1.0 / length))
    return weights / weights.sum()


WEIGHTS = _moving_averages(ROWS_PER_STEP, ROWS_PER_STEP, AVERAGE_ROWS)
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

    @staticmethod
    def joined(parts: Sequence["LeanFilter"]) -> "LeanFilter":
        """Return the filter of the bodies of all parts, one part after the other."""
        out = LeanFilter(0)
        out._first = np.concatenate([part._first for part in parts])
        out._second = np.concatenate([part._second for part in parts])
        return out

    def give(self, parts: Sequence["LeanFilter"]) -> None:
        """Give parts that were joined the state of their bodies."""
        start = 0
        for part in parts:
            own = slice(start, start + len(part._first))
            part._first, part._second = self._first[own].copy(), self._second[own].copy()
            start = own.stop

    def take(self, acceleration: np.ndarray) -> np.ndarray:
        """Return the acceleration that leans each body after one more row of accelerations, shape [V, 2] [m/s^2]."""
        self._first += LEAN_SHARE * (acceleration - self._first)
        self._second += LEAN_SHARE * (self._first - self._second)
        for state in (self._first, self._second):
            state[(acceleration == 0.0) & (np.abs(state) < AT_REST)] = 0.0
        return self._second

    def rest(self, body: int) -> None:
        """Put a body at rest."""
        self._first[body] = self._second[body] = 0.0


class LeaningBodies:
    """Bodies that lean under the accelerations of their places so far."""

    def __init__(self, shapes: Sequence[Shape]) -> None:
        """Start bodies of some dimensions at rest."""
        lifts = [lean_per_acceleration(shape) for shape in shapes]
        self._lift = np.array(lifts, dtype=np.float64).reshape(-1, 2)
        self._lean = LeanFilter(len(shapes))
        self._before: list[np.ndarray] = []

    @staticmethod
    def joined(parts: Sequence["LeaningBodies"]) -> "LeaningBodies":
        """Return the bodies of all parts, one part after the other; all have had as many rows, or two and more."""
        out = LeaningBodies(())
        out._lift = np.concatenate([part._lift for part in parts])
        out._lean = LeanFilter.joined([part._lean for part in parts])
        out._before = [np.concatenate(rows) for rows in zip(*(part._before for part in parts), strict=True)]
        return out

    def give(self, parts: Sequence["LeaningBodies"]) -> None:
        """Give parts that were joined the state of their bodies."""
        self._lean.give([part._lean for part in parts])
        start = 0
        for part in parts:
            own = slice(start, start + len(part._lift))
            part._before = [row[own].copy() for row in self._before]
            start = own.stop

    def poses(self, columns: np.ndarray) -> np.ndarray:
        """Return the poses of the next rows, shape [n, V, 7].

        Args:
            columns: Middle x, y, heading, height [m, m, rad, m], slopes forward and to the left, shape [n, V, 6].
        """
        x, y, heading, height, slope_x, slope_y = np.moveaxis(columns, 2, 0)
        lean = self._leans(np.stack([x, y], axis=2))
        c, s = np.cos(heading), np.sin(heading)
        slope_x = slope_x + self._lift[:, 0] * (lean[..., 0] * c + lean[..., 1] * s)
        slope_y = slope_y + self._lift[:, 1] * (lean[..., 1] * c - lean[..., 0] * s)
        flat = (values.reshape(-1) for values in (x, y, height, heading, slope_x, slope_y))
        return tilted_poses(*flat).reshape(*x.shape, 7)

    def rest(self, body: int, columns: np.ndarray) -> np.ndarray:
        """Put a body upright and at rest at columns as of `poses`, shape [6]; return its pose, shape [7]."""
        for places in self._before:
            places[body] = columns[:2]
        self._lean.rest(body)
        x, y, heading, height, slope_x, slope_y = (np.array([value]) for value in columns)
        return tilted_poses(x, y, height, heading, slope_x, slope_y)[0]

    def _leans(self, places: np.ndarray) -> np.ndarray:
        """Return the acceleration that leans each body in rows of places, shape [n, V, 2] both [m], [m/s^2]."""
        known = [*self._before, *places]
        self._before = known[-2:]
        leans = [np.zeros_like(places[0])] * (len(places) - max(len(known) - 2, 0))
        for before, here, after in zip(known, known[1:], known[2:], strict=False):
            leans.append(self._lean.take((after - 2 * here + before) / FRAME_DT**2).copy())
        return np.stack(leans)
