"""Compute the transition function of the uniform theory of diffraction, and the Fresnel integral that it holds."""

import numpy as np

SERIES_BELOW = 6.0
"""Below this argument the complementary error function is summed by its series, above by its continued fraction."""


def scaled_tail(x: np.ndarray) -> np.ndarray:
    """Return erfcx(sqrt(x) e^{j pi/4}) for real x >= 0, any shape, complex128: 1 at 0, toward 0 for large x.

    exp(-j x) / 2 times it is e^{j pi/4} / sqrt(pi) times the integral of exp(-j t^2) from sqrt(x) on.

    Source: Abramowitz and Stegun 7.1.6 (series) and 7.1.14 (continued fraction).
    """
    z = np.sqrt(x) * np.exp(0.25j * np.pi)
    small = np.where(x < SERIES_BELOW, z, 0.0)
    term, total = small.copy(), small.copy()
    for n in range(1, 70):
        term = term * 2.0 * small**2 / (2 * n + 1)
        total = total + term
    series = np.exp(small**2) - 2.0 / np.sqrt(np.pi) * total
    large = np.where(x < SERIES_BELOW, 3.0 + 0j, z)
    fraction = large
    for n in range(120, 0, -1):
        fraction = large + 0.5 * n / fraction
    return np.where(x < SERIES_BELOW, series, 1.0 / (np.sqrt(np.pi) * fraction))


def transition(x: np.ndarray) -> np.ndarray:
    """Return the transition function F(x) = 2j sqrt(x) e^{jx} times the integral of e^{-j t^2} from sqrt(x) on.

    Args:
        x: Real arguments >= 0, any shape.

    Returns:
        complex128; 0 at 0, and toward 1 for large x.

    Source: Kouyoumjian and Pathak 1974, equation 28, written as j sqrt(pi x) e^{-j pi/4} erfcx(sqrt(x) e^{j pi/4}).
    """
    return 1j * np.sqrt(np.pi * x) * np.exp(-0.25j * np.pi) * scaled_tail(x)
