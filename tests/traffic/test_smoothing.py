"""Weights of the quintic B-spline: those of the textbook on every piece and at its ends."""

import numpy as np

from mmw.traffic.smoothing import spline_weights


def test_weights_are_the_spline_of_all_pieces() -> None:
    """The oracle evaluates all three polynomials everywhere, and takes one by the distance."""
    tiny = np.finfo(float).eps / 2
    fraction = np.array([0.0, tiny, 1e-17, 0.25, 0.5, 1.0 - tiny, *np.random.default_rng(1).random(200)])
    for step, weight in zip(range(-2, 4), spline_weights(fraction), strict=True):
        x = np.abs(fraction - step)
        inner = 66 - 60 * x**2 + 30 * x**4 - 10 * x**5
        middle = 51 + 75 * x - 210 * x**2 + 150 * x**3 - 45 * x**4 + 5 * x**5
        outer = np.clip(3 - x, 0, None) ** 5
        assert np.array_equal(weight, np.where(x < 1, inner, np.where(x < 2, middle, outer)) / 120)
    assert np.abs(spline_weights(fraction).sum(axis=0) - 1.0).max() < 1e-14  # a partition of unity; twelve roundings
