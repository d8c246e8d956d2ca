"""Solve the position of a receiver from pseudo-ranges, by weighted least squares of one instant.

Source: E. D. Kaplan and C. J. Hegarty (eds.), "Understanding GPS: Principles and Applications", 2nd ed. (2006),
sections 2.4 and 7.3; weights by H. Hartinger and F. K. Brunner, "Variances of GPS phase observations: the SIGMA-epsilon
model", GPS Solutions 2 (1999).
"""

from dataclasses import dataclass

import numpy as np

FEWEST = 4
"""Satellites that a fix needs: three coordinates and the receiver's clock."""

MAX_PDOP = 20.0
"""Dilution of precision above which a receiver gives no fix. Design value."""

CODE_NOISE_M2_HZ = 1.1e4
"""Constant of the SIGMA-epsilon model for code [m^2 Hz]: 0.6 m at 45 dB Hz, 5.9 m at 25. As it is used for weights by
C/N0; the paper itself gives it for phases and was not seen."""

STEPS = 10
"""Newton steps at most; five reach 1e-6 m from anywhere in a town."""


@dataclass(frozen=True)
class PositionFix:
    """Position of one instant; NaN where there is none."""

    position: np.ndarray
    """In the frame of the satellites [m], shape [3]."""
    clock: float
    """Offset of the receiver's clock times the speed of light [m]."""
    hdop: float
    """Horizontal dilution of precision [-]."""
    vdop: float
    """Vertical dilution of precision [-]."""

    @property
    def is_fix(self) -> bool:
        """True if there is a position."""
        return bool(np.isfinite(self.position).all())


NO_FIX = PositionFix(np.full(3, np.nan), np.nan, np.nan, np.nan)
"""Result where too few satellites are tracked, or they stand badly."""


def range_variance(cn0_db_hz: np.ndarray, residual_std_m: float) -> np.ndarray:
    """Return the variance that the receiver takes for each pseudo-range [m^2]: a constant, and noise by C/N0."""
    return residual_std_m**2 + CODE_NOISE_M2_HZ * 10.0 ** (-np.asarray(cn0_db_hz) / 10.0)


def dilution(direction: np.ndarray) -> tuple[float, float]:
    """Return horizontal and vertical dilution of precision of satellites.

    Args:
        direction: Unit vectors to the satellites, z up, shape [S, 3], S of 4 or more.

    Returns:
        HDOP and VDOP [-]; infinite where the satellites do not fix a position.
    """
    design = np.column_stack([-direction, np.ones(len(direction))])
    normal = design.T @ design
    if not np.linalg.cond(normal) < 1e12:
        return np.inf, np.inf
    east, north, up, _ = np.diag(np.linalg.inv(normal))
    return float(np.sqrt(east + north)), float(np.sqrt(up))


def solve_position(
    satellites: np.ndarray, pseudorange: np.ndarray, variance: np.ndarray, start: np.ndarray
) -> PositionFix:
    """Return the position that fits pseudo-ranges best, in the frame of the satellites, z up at the receiver.

    Args:
        satellites: Places of the tracked satellites [m], shape [S, 3].
        pseudorange: Distance to each, with the clock's offset and errors [m], shape [S].
        variance: Variance of each [m^2], shape [S].
        start: Where Newton's method begins [m], shape [3].
    """
    if len(satellites) < FEWEST:
        return NO_FIX
    state, root = np.append(start, 0.0).astype(np.float64), 1.0 / np.sqrt(variance)
    for _ in range(STEPS):
        span = satellites - state[:3]
        distance = np.linalg.norm(span, axis=1)
        direction = span / distance[:, None]
        hdop, vdop = dilution(direction)
        if not np.hypot(hdop, vdop) < MAX_PDOP:
            return NO_FIX
        design = np.column_stack([-direction, np.ones(len(span))])
        step = np.linalg.lstsq(design * root[:, None], (pseudorange - distance - state[3]) * root, rcond=None)[0]
        state += step
        if np.abs(step).max() < 1e-6:
            return PositionFix(state[:3], float(state[3]), hdop, vdop)
    return NO_FIX
