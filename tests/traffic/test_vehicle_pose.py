"""Smoothing, bicycle, wheel drops and poses against closed forms."""

import numpy as np
import pytest

from mmw.core.transforms import quaternion_to_matrix
from mmw.traffic.ground_height import Ground
from mmw.traffic.roads.lane_graph import Lane
from mmw.traffic.route import join_lanes
from mmw.traffic.smoothing import gaussian_smooth, spline_at
from mmw.traffic.vehicle_pose import (
    EXTENSION,
    MAX_FLOAT,
    PATH_SIGMA,
    PATH_STEP,
    Stance,
    follow_line,
    place_on_ground,
    sample_poses,
)
from tests.fixtures.traffic_measures import wheel_points
from tests.fixtures.traffic_towns import SEDAN, height_field


def straight(length: float = 80.0, slope: float = 0.0) -> Lane:
    """Return a lane along x that rises with a slope."""
    x = np.arange(0.0, length + 0.5, 1.0)
    return Lane("straight", np.column_stack([x, np.zeros_like(x), slope * x]), 3.5, 10.0)


def bend(radius: float, angle: np.ndarray) -> Lane:
    """Return a level lane to the left on a circle, from the origin eastward."""
    points = [radius * np.sin(angle), radius - radius * np.cos(angle), np.zeros_like(angle)]
    return Lane("bend", np.column_stack(points), 3.5, 10.0)


def stance_on(lane: Lane, *slopes: float) -> Stance:
    """Return a sedan on a lane of a tilted plane."""
    ground = Ground(*plane(*slopes or (0.0, 0.0)))
    stance, _, why = place_on_ground(follow_line(join_lanes([lane]), SEDAN), ground, 10.0)
    assert stance is not None, why
    return stance


def plane(slope_x: float, slope_y: float, half: float = 120.0) -> tuple[np.ndarray, np.ndarray]:
    """Return a tilted square of two triangles around the origin."""
    return height_field((-half, half), (-half, half), lambda x, y: slope_x * x + slope_y * y)


def test_gaussian_keeps_lines_and_shrinks_a_wave_as_theory_says():
    n = np.arange(400.0)
    line = np.stack([3.0 + 0.25 * n, -n], axis=1)
    np.testing.assert_allclose(gaussian_smooth(line, 7.0), line, atol=1e-10)
    wave = np.sin(2 * np.pi * n / 40.0)
    expected = np.exp(-2 * np.pi**2 * 36.0 / 1600.0) * wave
    np.testing.assert_allclose(gaussian_smooth(wave, 6.0)[60:-60], expected[60:-60], atol=1e-6)


def test_spline_reproduces_cubics_up_to_its_own_variance():
    n = np.arange(60.0)
    at = np.linspace(5.0, 50.0, 333)
    cubic = n**3 - 4 * n**2 + n - 7
    # a symmetric kernel of variance 1/2 adds half of it times the second derivative, and nothing else to a cubic
    expected = at**3 - 4 * at**2 + at - 7 + 0.25 * (6 * at - 8)
    np.testing.assert_allclose(spline_at(cubic, at), expected, rtol=1e-12)


def test_spline_has_four_continuous_derivatives():
    values = np.random.Generator(np.random.PCG64(3)).normal(size=30)
    h = 1e-3
    at = 12.0 + h * np.arange(-20, 21)
    fourth = np.diff(spline_at(values, at), 4) / h**4
    assert np.abs(np.diff(fourth)).max() < 0.1 * np.abs(values).max()


def test_spline_refuses_positions_outside():
    with pytest.raises(ValueError, match="3 samples inside"):
        spline_at(np.zeros(20), np.array([1.0]))


def test_rear_axle_cuts_the_corner_by_the_tractrix():
    radius = 20.0
    track = follow_line(join_lanes([bend(radius, np.arange(0, 2 * np.pi * 0.99, 0.5 / radius))]), SEDAN)
    settled = (track.line.station > 40) & (track.line.station < 100)
    middle = np.array([0.0, radius])
    front = np.linalg.norm(track.front[settled] - middle, axis=1)
    center = np.linalg.norm(track.center[settled] - middle, axis=1)
    shrunk = radius * np.exp(-0.5 * (PATH_SIGMA / radius) ** 2)
    np.testing.assert_allclose(front, shrunk, atol=4e-3)  # the polyline's chords lie up to 1.6 mm inside
    rear = np.sqrt(shrunk**2 - SEDAN.wheelbase**2)
    np.testing.assert_allclose(center, np.hypot(rear, 0.5 * SEDAN.wheelbase), atol=4e-3)
    np.testing.assert_allclose(track.steer[settled], np.arcsin(SEDAN.wheelbase / shrunk), atol=2e-3)


def test_drops_meet_the_plane_below_the_hint_and_no_deck_above():
    points, faces = plane(0.1, -0.05)
    deck, deck_faces = plane(0.1, -0.05)
    deck[:, 2] += 1.5
    ground = Ground(np.concatenate([points, deck]), np.concatenate([faces, deck_faces + 4]))
    xy = np.random.Generator(np.random.PCG64(1)).uniform(-100, 100, (500, 2))
    z = 0.1 * xy[:, 0] - 0.05 * xy[:, 1]
    np.testing.assert_allclose(ground.heights(np.column_stack([xy, z + 0.3])), z, atol=3e-5)
    outside = ground.heights(np.array([[500.0, 0.0, 50.0], [0.0, 0.0, -5.0]]))
    assert np.isnan(outside).all()


def test_ground_needs_faces():
    with pytest.raises(ValueError, match="0 faces"):
        Ground(np.zeros((3, 3)), np.zeros((0, 3)))


@pytest.mark.parametrize(("slope_x", "slope_y"), [(0.0, 0.0), (0.15, 0.0), (-0.1, 0.04)])
def test_constant_speed_on_a_plane_lies_in_the_plane(slope_x, slope_y):
    poses = sample_poses(stance_on(straight(80.0, slope_x), slope_x, slope_y), 20.0 + 0.05 * np.arange(400))
    normal = np.array([-slope_x, -slope_y, 1.0]) / np.sqrt(1 + slope_x**2 + slope_y**2)
    for pose in poses[::80]:
        matrix = quaternion_to_matrix(pose[3:])
        np.testing.assert_allclose(matrix[:, 2], normal, atol=1e-5)
        assert matrix[0, 0] > 0 and abs(matrix[1, 0]) < 1e-6
    wheels = wheel_points(poses, SEDAN)
    assert np.abs(wheels[..., 2] - slope_x * wheels[..., 0] - slope_y * wheels[..., 1]).max() < 5e-5
    along = wheels[0, 0] - wheels[0, 2]
    assert np.linalg.norm(along) == pytest.approx(SEDAN.wheelbase, abs=1e-9)
    np.testing.assert_allclose(np.linalg.norm(poses[:, 3:], axis=1), 1.0, atol=1e-12)


def test_rest_is_exactly_rest():
    poses = sample_poses(stance_on(straight(80.0, 0.1), 0.1, 0.0), np.full(300, 30.0))
    assert (poses == poses[0]).all()


def test_body_leans_back_when_it_speeds_up():
    t = 0.01 * np.arange(300)
    poses = sample_poses(stance_on(straight()), 20.0 + t**2)  # 2 m/s^2
    lift = wheel_points(poses, SEDAN)[150, 0, 2] - poses[150, 2]
    assert lift == pytest.approx(2 * 0.015 * (2 / 9.81) * 0.38 * SEDAN.height / SEDAN.wheelbase, rel=1e-3)


def test_body_leans_out_of_a_bend():
    stance = stance_on(bend(25.0, np.arange(0, 3.0, 0.02)))
    wheels = wheel_points(sample_poses(stance, 20.0 + 0.07 * np.arange(500)), SEDAN)[250]
    assert 5e-4 < wheels[0, 2] < MAX_FLOAT and -MAX_FLOAT < wheels[1, 2] < -5e-4


def test_quaternion_never_changes_sign_over_a_full_circle():
    stance = stance_on(bend(25.0, np.arange(0, 4.5 * np.pi, 0.02)))
    poses = sample_poses(stance, 12.0 + 0.08 * np.arange(4000))
    assert (poses[1:, 3:] * poses[:-1, 3:]).sum(axis=1).min() > 0.99999


def test_missing_road_is_reported_where_it_begins():
    points, faces = plane(0.0, 0.0, half=40.0)
    stance, where, why = place_on_ground(follow_line(join_lanes([straight()]), SEDAN), Ground(points, faces), 10.0)
    assert stance is None and why == "a wheel leaves the drivable surface"
    assert where == pytest.approx(40.0, abs=2 * PATH_STEP)


def test_a_step_in_the_road_is_refused():
    low, faces = plane(0.0, 0.0)
    high = low + np.array([0.0, 0.0, 0.1])
    low[:, 0] = np.clip(low[:, 0], None, 40.0)
    high[:, 0] = np.clip(high[:, 0], 40.0, None)
    ground = Ground(np.concatenate([low, high]), np.concatenate([faces, faces + 4]))
    stance, where, why = place_on_ground(follow_line(join_lanes([straight()]), SEDAN), ground, 10.0)
    assert stance is None and "uneven" in why and 36.0 < where < 44.0


def test_line_runs_straight_beyond_its_lanes():
    line = join_lanes([straight()])
    assert line.station[0] == pytest.approx(-EXTENSION)
    np.testing.assert_allclose(line.points[:, 0], line.station, atol=1e-9)
    np.testing.assert_allclose(line.ends, [80.0])
