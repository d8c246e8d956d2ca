"""Positions from pseudo-ranges: exact ones, weights against the normal equations, dilution of known skies."""

import numpy as np
import pytest

from mmw.sensors.gnss.position_fix import dilution, range_variance, solve_position

RADIUS_M = 2.2e7


def sky(count: int, seed: int = 0) -> np.ndarray:
    """Return directions above the horizon, shape [count, 3]."""
    rng = np.random.default_rng(seed)
    up, turn = rng.uniform(0.1, 1.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
    across = np.sqrt(1.0 - up**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), up], axis=1)


def test_exact_ranges_give_the_place() -> None:
    satellites, place = sky(8) * RADIUS_M, np.array([812.0, -433.0, 21.0])
    ranges = np.linalg.norm(satellites - place, axis=1) + 1234.5
    fix = solve_position(satellites, ranges, np.ones(8), np.zeros(3))
    np.testing.assert_allclose(fix.position, place, atol=1e-6)
    assert fix.clock == pytest.approx(1234.5, abs=1e-6) and fix.is_fix


def test_errors_move_the_place_by_the_weighted_normal_equations() -> None:
    rng = np.random.default_rng(1)
    direction = sky(9, 1)
    variance, error = rng.uniform(0.5, 20.0, 9), rng.normal(size=9)
    fix = solve_position(RADIUS_M * direction, RADIUS_M + error, variance, np.array([50.0, 20.0, -3.0]))
    design = np.column_stack([-direction, np.ones(9)])
    weight = np.diag(1.0 / variance)
    linear = np.linalg.solve(design.T @ weight @ design, design.T @ weight @ error)
    # Ranges are not linear: an error of some meters bends by its square over the distance.
    np.testing.assert_allclose([*fix.position, fix.clock], linear, atol=1e-5)


def test_dilution_of_a_tetrahedron() -> None:
    """The normal matrix of a regular tetrahedron is diag(4/3, 4/3, 4/3, 4)."""
    turn = np.radians([0.0, 120.0, 240.0])
    low, across = -1.0 / 3.0, np.sqrt(8.0) / 3.0
    direction = np.vstack([[0, 0, 1], np.column_stack([across * np.cos(turn), across * np.sin(turn), np.full(3, low)])])
    assert dilution(direction) == pytest.approx((np.sqrt(1.5), np.sqrt(0.75)))


def test_no_fix_where_satellites_do_not_give_one() -> None:
    few = sky(3)
    fix = solve_position(RADIUS_M * few, np.full(3, RADIUS_M), np.ones(3), np.zeros(3))
    assert not fix.is_fix and np.isnan(fix.hdop)
    # All at one elevation: height and clock are the same.
    turn = np.arange(5) * 1.3
    ring = np.column_stack([0.6 * np.cos(turn), 0.6 * np.sin(turn), np.full(5, 0.8)])
    assert not solve_position(RADIUS_M * ring, np.full(5, RADIUS_M), np.ones(5), np.zeros(3)).is_fix


def test_weights_follow_the_carrier() -> None:
    """Source: constants of the module; 1.1e4 m^2 Hz at 40 dB Hz is 1.1 m^2."""
    assert range_variance(np.array([40.0]), 2.0)[0] == pytest.approx(4.0 + 1.1)
