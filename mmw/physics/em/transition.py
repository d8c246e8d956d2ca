"""Compute the transition function of the uniform theory of diffraction, and the Fresnel integral that it holds."""

from collections.abc import Sequence

import numpy as np

SERIES_BELOW = 6.0
"""Below this argument the complementary error function is summed by its series, above by its continued fraction."""

FRACTION_TERMS = ((6.0, 120), (40.0, 24), (400.0, 8))
"""Terms of the continued fraction from an argument on: enough for 1e-13."""


def scaled_tail(x: np.ndarray) -> np.ndarray:
    """Return erfcx(sqrt(x) e^{j pi/4}) for real x >= 0, any shape, complex128: 1 at 0, toward 0 for large x.

    exp(-j x) / 2 times it is e^{j pi/4} / sqrt(pi) times the integral of exp(-j t^2) from sqrt(x) on.

    Source: Abramowitz and Stegun 7.1.6 (series) and 7.1.14 (continued fraction).
    """
    z = np.sqrt(x) * np.exp(0.25j * np.pi)
    out = np.full(np.shape(x), np.nan + 0j)
    is_small = x < SERIES_BELOW
    if is_small.any():
        out[is_small] = _series(z[is_small])
    ends = [*(begin for begin, _ in FRACTION_TERMS[1:]), np.inf]
    groups = [(x >= begin) & (x < end) for (begin, _), end in zip(FRACTION_TERMS, ends, strict=True)]
    groups[-1] = x >= FRACTION_TERMS[-1][0]
    for group, values in zip(groups, _fractions([z[group] for group in groups]), strict=True):
        out[group] = values
    return out


def _series(z: np.ndarray) -> np.ndarray:
    term, total, square = z, z.copy(), z**2
    double = 2.0 * square
    for n in range(1, 70):
        term = term * double / (2 * n + 1)
        total += term
    return np.exp(square) - 2.0 / np.sqrt(np.pi) * total


def _fractions(groups: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return the continued fractions of arguments, one array for each of `FRACTION_TERMS`; all share the last terms."""
    z = np.concatenate(groups)
    ends = np.cumsum([len(group) for group in groups]).tolist()
    fraction = z.copy()
    counts = [terms for _, terms in FRACTION_TERMS]
    for end, most, stop in zip(ends, counts, [*counts[1:], 0], strict=True):
        if end:
            given, own = z[:end], fraction[:end]
            for n in range(most, stop, -1):
                np.divide(0.5 * n, own, out=own)
                np.add(given, own, out=own)
    return np.split(1.0 / (np.sqrt(np.pi) * fraction), ends[:-1])


def transition(x: np.ndarray) -> np.ndarray:
    """Return the transition function F(x) = 2j sqrt(x) e^{jx} times the integral of e^{-j t^2} from sqrt(x) on.

    Args:
        x: Real arguments >= 0, any shape.

    Returns:
        complex128; 0 at 0, and toward 1 for large x.

    Source: Kouyoumjian and Pathak 1974, equation 28, written as j sqrt(pi x) e^{-j pi/4} erfcx(sqrt(x) e^{j pi/4}).
    """
    return 1j * np.sqrt(np.pi * x) * np.exp(-0.25j * np.pi) * scaled_tail(x)
