"""Smoothing that leaves no step in acceleration or jerk: a Gaussian on samples, a quintic B-spline between them."""

import math

import numpy as np

from mmw.core.errors import InputError

SUPPORT_SIGMAS = 5.0
"""The Gaussian is cut here; what is left out is below 6e-7 of its weight."""

SPLINE_REACH = 3
"""Samples on either side of a position that the quintic B-spline reads."""


def gaussian_smooth(values: np.ndarray, sigma: float) -> np.ndarray:
    """Return equally spaced samples convolved with a Gaussian; straight lines are kept, up to both ends.

    Args:
        values: Samples, shape [N] or [N, K], N >= 2. Beyond the ends they go on along the first and the last step.
        sigma: Standard deviation in samples, > 0.

    Returns:
        Smoothed samples, same shape, float64.
    """
    radius = math.ceil(SUPPORT_SIGMAS * sigma)
    offset = np.arange(-radius, radius + 1)
    weight = np.exp(-0.5 * (offset / sigma) ** 2)
    weight /= weight.sum()
    columns = np.asarray(values, np.float64).reshape(len(values), -1)
    reach = np.arange(radius, 0, -1)[:, None]
    before = columns[0] - reach * (columns[1] - columns[0])
    after = columns[-1] + reach[::-1] * (columns[-1] - columns[-2])
    padded = np.concatenate([before, columns, after])
    out = np.stack([np.convolve(column, weight, mode="valid") for column in padded.T], axis=1)
    return out.reshape(np.shape(values))


def spline_at(values: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return the uniform quintic B-spline with these coefficients, four times continuously differentiable.

    The samples serve as coefficients as they are, which smooths them once more with a variance of half a sample spacing
    squared: 0.3 mm on a bend of 8 m radius sampled every 0.1 m.

    Args:
        values: Coefficients, shape [N] or [N, K].
        position: Where to evaluate, in samples, shape [M]; at least 3 samples inside both ends.

    Returns:
        Values, shape [M] or [M, K].

    Raises:
        InputError: If a position is nearer than 3 samples to an end.

    Source: uniform B-spline of degree 5, I. J. Schoenberg, Quart. Appl. Math. 4 (1946), 45-99.
    """
    position = np.asarray(position, np.float64)
    first = np.floor(position).astype(np.int64)
    if len(position) and (first.min() < SPLINE_REACH - 1 or first.max() > len(values) - SPLINE_REACH - 1):
        raise InputError(
            f"spline: positions {position.min():.2f}..{position.max():.2f} of {len(values)} samples; "
            f"they must stay {SPLINE_REACH} samples inside; lengthen the samples"
        )
    fraction = position - first
    out = np.zeros((len(position), *np.shape(values)[1:]))
    for step in range(1 - SPLINE_REACH, SPLINE_REACH + 1):
        x = np.abs(fraction - step)
        inner = 66 - 60 * x**2 + 30 * x**4 - 10 * x**5
        middle = 51 + 75 * x - 210 * x**2 + 150 * x**3 - 45 * x**4 + 5 * x**5
        outer = np.clip(3 - x, 0, None) ** 5
        weight = np.where(x < 1, inner, np.where(x < 2, middle, outer)) / 120
        out += weight.reshape(-1, *[1] * (out.ndim - 1)) * values[first + step]
    return out
