"""Bodies that are pulled by their front bumpers: closed forms of the path, exact rest, wheels on the road."""

import numpy as np
import pytest

from mmw.traffic.ground_height import Ground
from mmw.traffic.live.causal import ROWS_PER_STEP
from mmw.traffic.sumo.bodies import REACH, PulledBodies, step_weights
from tests.fixtures.traffic_towns import SEDAN, height_field


def plane(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return a tilted plane."""
    return 0.05 * x - 0.02 * y + 3.0


def pulled(bumper: np.ndarray, heading: float, height=lambda x, y: 0.0 * x) -> np.ndarray:
    """Return the columns of a sedan whose front bumper is moved, shape [N, 6]."""
    side = np.arange(-80.0, 81.0, 4.0)
    bodies = PulledBodies([SEDAN], Ground(*height_field(side, side, height)))
    start = bumper[:1]
    first = bodies.place(start, height(*start.T), np.array([heading]))
    return np.concatenate([first, *(bodies.pull(place[None]) for place in bumper[1:])])


def test_weights_are_a_low_pass_of_the_steps_that_keeps_straight_lines():
    weights = step_weights()
    assert weights.sum(axis=1) == pytest.approx(1.0, abs=1e-14) and weights.min() >= 0.0
    for phase, own in enumerate(weights):
        step = np.arange(len(own)) + (phase - REACH) // ROWS_PER_STEP
        assert own @ step == pytest.approx(phase / ROWS_PER_STEP, abs=1e-12)
    # speeds that alternate from step to step leave hardly a trace: knots are an even number of steps apart
    station, count = np.cumsum(np.tile([1.0, 2.0], 20)), weights.shape[1]
    rows = [weights[row % ROWS_PER_STEP] @ station[(row - REACH) // ROWS_PER_STEP :][:count] for row in range(40, 60)]
    assert np.diff(rows) == pytest.approx(1.5 / ROWS_PER_STEP, abs=1e-6)


def test_rear_follows_the_circle_of_the_bumper_inside_it():
    """Steady state of a tractrix: the pulled end is on the radius sqrt(R^2 - b^2); twice, for both links."""
    radius = 20.0
    angle = np.arange(0.0, 8.0, 0.4 / radius)
    bumper = radius * np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    columns = pulled(bumper, 0.0)[-40:]
    rear = columns[:, :2] - 0.5 * SEDAN.wheelbase * np.stack([np.cos(columns[:, 2]), np.sin(columns[:, 2])], axis=1)
    expected = np.sqrt(radius**2 - SEDAN.front**2 - SEDAN.wheelbase**2)
    assert np.hypot(*rear.T) == pytest.approx(expected, abs=0.004)  # chords of 0.4 m: sagitta 1 mm, and as much twice
    assert np.diff(columns[:, 2]) == pytest.approx(0.4 / radius, abs=1e-4)


def test_body_at_rest_is_at_rest_bit_for_bit_and_stands_on_the_plane():
    walk = np.stack([np.linspace(0.0, 20.0, 60), np.linspace(0.0, 2.0, 60)], axis=1)
    columns = pulled(np.concatenate([walk, np.repeat(walk[-1:], 5, axis=0)]), np.arctan2(2.0, 20.0), plane)
    assert (columns[-6:] == columns[-1]).all()
    x, y, heading, height, forward, left = columns[-1]
    assert height == pytest.approx(plane(x, y), abs=1e-5)
    c, s = np.cos(heading), np.sin(heading)
    assert (forward, left) == pytest.approx((0.05 * c - 0.02 * s, -0.05 * s - 0.02 * c), abs=1e-5)


def test_body_that_leaves_the_road_keeps_its_level():
    walk = np.stack([np.linspace(60.0, 100.0, 100), np.zeros(100)], axis=1)
    columns = pulled(walk, 0.0, plane)
    assert np.isfinite(columns).all()
    assert columns[-1, 3] == columns[-2, 3] and columns[-1, 0] > columns[-2, 0]
