"""The smoothest path through points: SciPy's spline of degree 7, rest at both ends, hovering between equal points."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from mmw.core.minimum_snap import minimum_snap

TIMES = np.array([0.5, 2.0, 2.7, 6.0, 7.5])
POINTS = np.random.default_rng(3).normal(size=(5, 3)) * 20.0


def test_equals_the_spline_at_rest_at_both_ends() -> None:
    rest = [(order, np.zeros(3)) for order in (1, 2, 3)]
    spline = make_interp_spline(TIMES, POINTS, k=7, bc_type=(rest, rest))
    at = np.linspace(0.5, 7.5, 301)
    for order, found in enumerate(minimum_snap(TIMES, POINTS, at)):
        np.testing.assert_allclose(found, spline(at, nu=order), atol=1e-6)


def test_two_points_are_the_published_polynomial() -> None:
    """From rest to rest with no acceleration and jerk at the ends: 35 s^4 - 84 s^5 + 70 s^6 - 20 s^7."""
    s = np.linspace(0.0, 1.0, 21)
    position, velocity, _ = minimum_snap(np.array([1.0, 5.0]), np.array([[2.0], [10.0]]), 1.0 + 4.0 * s)
    np.testing.assert_allclose(position[:, 0], 2.0 + 8.0 * (35 * s**4 - 84 * s**5 + 70 * s**6 - 20 * s**7), atol=1e-12)
    assert velocity.max() == pytest.approx(35 / 16 * 8.0 / 4.0)  # in the middle


def test_rests_before_after_and_between_equal_points() -> None:
    points = POINTS[[0, 1, 1, 2, 3]]
    position, velocity, acceleration = minimum_snap(TIMES, points, np.array([0.0, 2.0, 2.3, 2.7, 9.0]))
    np.testing.assert_allclose(position, points[[0, 1, 1, 1, 4]], atol=1e-9)
    assert np.abs(velocity).max() < 1e-9 and np.abs(acceleration).max() < 1e-9
