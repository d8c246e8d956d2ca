"""Bodies of SUMO's vehicles within limits of acceleration and jerk: on the same path, a little later or earlier."""

import numpy as np
import pytest

from mmw.core.constants import FRAME_DT
from mmw.traffic.sumo import motion_limits
from mmw.traffic.sumo.bodies import _weights
from mmw.traffic.sumo.motion_limits import (
    DECELERATION_LIMIT,
    HELD_ROWS,
    JERK_LIMIT,
    LEAD_ROWS,
    MAX_BRAKING,
    MAX_JERK,
    POLE,
    MotionLimits,
)


def smoothed(acceleration: np.ndarray, speed: float) -> np.ndarray:
    """Return stations at 100 Hz of a vehicle, smoothed as those of SUMO are; a vehicle does not go back."""
    speeds = np.maximum(speed + np.cumsum(acceleration) * FRAME_DT, 0.0)
    station = np.cumsum(speeds) * FRAME_DT
    weights = _weights()
    return np.convolve(station - station[0], weights, mode="valid")


def phases(*parts: tuple[float, float]) -> np.ndarray:
    """Return accelerations at 100 Hz of parts (duration [s], acceleration [m/s^2])."""
    return np.concatenate([np.full(round(duration / FRAME_DT), value) for duration, value in parts])


def circle(station: np.ndarray, radius: float) -> np.ndarray:
    """Return columns of a body on a circle about (0, `radius`), which climbs by 5 %, shape [N, 6]."""
    angle = station / radius
    return np.column_stack([
        radius * np.sin(angle), radius * (1 - np.cos(angle)), angle, 0.05 * station,
        np.full(len(station), 0.05), np.zeros(len(station)),
    ])  # fmt: skip


def limited(columns: np.ndarray, limits: MotionLimits | None = None) -> np.ndarray:
    """Return what the limits make of the columns of one body, shape [N - LEAD_ROWS - 2, 6]."""
    limits = MotionLimits(1) if limits is None else limits
    rows = [limits.take(row[None]) for row in columns]
    return np.concatenate([row for row in rows if row is not None])


def along(columns: np.ndarray, order: int) -> np.ndarray:
    """Return a difference of the way over time: 1 speed, 2 acceleration, 3 jerk."""
    return np.diff(np.cumsum(np.hypot(*np.diff(columns[:, :2], axis=0).T)), n=order) / FRAME_DT**order


CUT_IN = phases(
    (3, 0.0),
    (0.2, 0.9),
    (0.2, 1.7),
    (0.15, -6.0),
    (0.05, -5.0),
    (0.05, -4.1),
    (0.05, -3.4),
    (0.1, -2.7),
    (0.1, -2.1),
    (0.2, -1.7),
    (0.3, -1.3),
    (1, -0.9),
    (14, 0.0),
)
"""Accelerations of SUMO behind one that cuts in (`town03_roundabout`, seed 42): 0.15 s of the hardest braking."""


def test_gains_are_those_of_the_triple_pole():
    """In continuous time, (s + p)^3 has the gains p^3, 3 p^2 and 3 p; at 100 Hz 3/2 p dt less, 4 %, to first order."""
    gain, preview = motion_limits._tracker()
    np.testing.assert_allclose(gain, [POLE**3, 3 * POLE**2, 3 * POLE], rtol=0.06)
    assert len(preview) == LEAD_ROWS and (preview > 0.0).all()


def test_motion_within_the_limits_is_returned_bit_for_bit():
    station = smoothed(phases((4, 1.0), (1, 0.0), (1, -1.0), (2, -2.0), (0.5, -1.0), (4, 0.5)), 5.0)
    columns = circle(station, 30.0)
    found = limited(columns)
    np.testing.assert_array_equal(found, columns[2 : len(found) + 2])


def test_hard_braking_is_spread_before_and_after_it_on_the_same_path():
    columns = circle(smoothed(CUT_IN, 4.0), 25.0)
    found = limited(columns)
    raw, own = columns[2 : len(found) + 2], found
    assert along(raw, 2).min() < -4.0 and np.abs(along(raw, 3)).max() > 15.0
    assert along(own, 2).min() > -DECELERATION_LIMIT - 0.01
    assert np.abs(along(own, 3)).max() < JERK_LIMIT + 0.1  # and what a cubic between rows adds
    apart = np.linalg.norm(own[:, :2] - raw[:, :2], axis=1)
    assert 0.01 < apart.max() < 0.3 and apart[-1] == 0.0
    np.testing.assert_allclose(np.hypot(own[:, 0], own[:, 1] - 25.0), 25.0, atol=1e-6)
    np.testing.assert_allclose(own[:, 3], 0.05 * 25.0 * own[:, 2], atol=1e-6)
    first = int(np.argmax(apart > 1e-4))
    hard = int(np.argmax(along(raw, 2) < -DECELERATION_LIMIT))
    assert 0 < hard - first <= LEAD_ROWS + 10, "it brakes before SUMO's vehicle does"


def test_control_may_brake_harder():
    ramp = [(0.1, -0.5 * k) for k in range(13)]
    columns = circle(smoothed(phases((3, 0.0), *ramp, (0.5, -6.0), *ramp[::-1], (4, 0.0)), 14.0), 1e4)
    limits = MotionLimits(1)
    limits.lift(0)
    np.testing.assert_array_equal(limited(columns, limits), columns[2 : len(columns) - LEAD_ROWS])


@pytest.mark.parametrize("speed", [3.0, 8.0, 14.0])
def test_stop_beyond_the_limits_ends_a_little_ahead_and_off_again_without_a_jump(speed: float):
    """SUMO stops at once and stands; the body stops in front of it, waits, and drives on, in a bend."""
    stop = phases((2, 0.0), (speed / 6.0, -6.0), (9, 0.0), (4, 1.5), (15, 0.0))
    columns = circle(smoothed(stop, speed), 60.0)
    found = limited(columns)
    assert len(found) > 2 * HELD_ROWS, "held rows are dropped"
    ahead = np.cumsum(np.hypot(*np.diff(found[:, :2], axis=0).T)) - np.cumsum(
        np.hypot(*np.diff(columns[2 : len(found) + 2, :2], axis=0).T)
    )
    assert ahead.min() > -0.15 and 0.1 < ahead.max() < 1.0, "SUMO keeps 2 m"
    assert along(found, 1).min() >= 0.0 and along(found, 2).min() > -MAX_BRAKING - 0.01
    jerk = np.abs(np.diff(found, n=3, axis=0)[:, :2]).max() / FRAME_DT**3
    assert jerk < MAX_JERK + speed**3 / 60.0**2  # and that of the circle
    moves = along(found[-1000:], 1).min() > 1.0
    assert moves and np.linalg.norm(found[-1] - columns[len(found) + 1]) < 1e-6


def test_bodies_do_not_depend_on_each_other():
    one, other = circle(smoothed(CUT_IN, 4.0), 25.0), circle(smoothed(np.zeros(len(CUT_IN)), 4.0), 25.0)
    limits = MotionLimits(2)
    rows = [limits.take(np.stack(pair)) for pair in zip(one, other, strict=True)]
    both = np.stack([row for row in rows if row is not None], axis=1)
    np.testing.assert_array_equal(both[0], limited(one))
    np.testing.assert_array_equal(both[1], limited(other))
