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
    out = np.zeros((len(position), *np.shape(values)[1:]))
    steps = range(1 - SPLINE_REACH, SPLINE_REACH + 1)
    for step, weight in zip(steps, spline_weights(position - first), strict=True):
        out += weight.reshape(-1, *[1] * (out.ndim - 1)) * values[first + step]
    return out


def spline_weights(fraction: np.ndarray) -> np.ndarray:
    """Return the weights of samples -2 to 3 about positions that are a fraction behind sample 0, shape [6, M].

    Only the polynomial that holds is evaluated for each sample: powers are most of the cost.
    """
    x = np.abs(fraction - np.arange(1 - SPLINE_REACH, SPLINE_REACH + 1)[:, None])
    weight = np.empty_like(x)
    for rows, polynomial in zip((slice(2, 4), slice(1, 5, 3), slice(0, 6, 5)), _PIECES, strict=True):
        weight[rows] = polynomial(x[rows].copy())
    for row, piece, end in ((3, 1, 1.0), (1, 2, 2.0), (4, 2, 2.0)):  # where rounding, or a fraction of 0, ends a piece
        at = np.flatnonzero(x[row] >= end)
        if len(at):
            weight[row, at] = _PIECES[piece](x[row, at])
    return weight / 120


def _inner(x: np.ndarray) -> np.ndarray:
    return 66 - 60 * x**2 + 30 * x**4 - 10 * x**5


def _middle(x: np.ndarray) -> np.ndarray:
    return 51 + 75 * x - 210 * x**2 + 150 * x**3 - 45 * x**4 + 5 * x**5


def _outer(x: np.ndarray) -> np.ndarray:
    return np.clip(3 - x, 0, None) ** 5


_PIECES = _inner, _middle, _outer
"""Polynomials of the spline at distances below 1, 2 and 3, times 120."""
