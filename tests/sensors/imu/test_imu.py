"""IMU and kinematics: analytic motions, the inverse integrator, CARLA's axes and habits."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from mmw.config import MountConfig
from mmw.core.constants import FRAME_DT, GRAVITY
from mmw.core.kinematics import differentiate, differentiate_rows
from mmw.core.transforms import (
    IDENTITY_POSE,
    angle_between,
    compose,
    conjugate,
    make_pose,
    pose_from_mount,
    pose_from_ypr,
    quaternion_to_matrix,
    quaternion_to_ypr,
    rotate,
)
from mmw.sensors import Imu
from mmw.sensors.imu.simulate import integrate_imu, make_imu, measure
from tests.fixtures.driving_agents import assert_batches_do_not_matter, driving, rows_of, sampled
from tests.fixtures.imu_errors import imu_errors
from tests.fixtures.scenes import ABSENT, two_cars

G = np.array([0.0, 0.0, GRAVITY])

imu_samples = partial(sampled, make_imu)


def times(count: int = 1001) -> np.ndarray:
    return FRAME_DT * np.arange(count)


def circle(radius: float, speed: float, count: int = 1001) -> np.ndarray:
    angle = speed / radius * times(count)
    position = np.stack([radius * np.sin(angle), radius * (1 - np.cos(angle)), np.full(count, 3.0)], axis=1)
    return pose_from_ypr(position, angle)


def drive(count: int = 1001) -> np.ndarray:
    """Return a hard drive: turns, braking, hills, nodding and rolling, with angular accelerations above 1 rad/s^2."""
    t = times(count)
    yaw = 1.2 * np.sin(0.7 * t) + 0.1 * t
    pitch = 0.05 * np.sin(1.1 * t) + 0.03 * np.sin(7.0 * t + 1.0)
    roll = 0.04 * np.sin(1.9 * t + 0.5) + 0.02 * np.cos(8.0 * t)
    position = np.stack(
        [300.0 + 12.0 * t + 4.0 * np.sin(0.9 * t), -250.0 + 20.0 * np.sin(0.5 * t), 8.0 + 1.5 * np.sin(0.4 * t)], axis=1
    )
    return pose_from_ypr(position, yaw, pitch, roll)


def test_rest_reads_gravity_upwards_exactly() -> None:
    for yaw in (0.0, 1.0, -2.5):
        accel, gyro = measure(np.tile(pose_from_ypr((250.3, -17.7, 4.1), yaw), (20, 1)), IDENTITY_POSE)
        np.testing.assert_array_equal(accel, np.tile(G, (20, 1)))
        np.testing.assert_array_equal(gyro, 0.0)


def test_rest_on_a_slope() -> None:
    slope = np.radians(8.0)
    accel, gyro = measure(np.tile(pose_from_ypr((1.0, 2.0, 3.0), 0.7, -slope), (10, 1)), IDENTITY_POSE)
    # Nose up: gravity presses the body backwards, so the specific force has a forward part.
    np.testing.assert_allclose(
        accel, np.tile([GRAVITY * np.sin(slope), 0.0, GRAVITY * np.cos(slope)], (10, 1)), atol=1e-12
    )
    np.testing.assert_allclose(gyro, 0.0, atol=1e-12)


def test_constant_acceleration_is_exact_at_every_frame() -> None:
    t = times(300)
    heading = 0.6
    along = 5.0 * t + 0.5 * 2.0 * t**2
    position = np.stack([along * np.cos(heading), along * np.sin(heading), np.zeros_like(t)], axis=1)
    poses = pose_from_ypr(position, np.full_like(t, heading))
    accel, _ = measure(poses, IDENTITY_POSE)
    np.testing.assert_allclose(accel, np.tile([2.0, 0.0, GRAVITY], (300, 1)), atol=1e-7)
    speed = np.linalg.norm(differentiate(poses).velocity, axis=1)
    np.testing.assert_allclose(speed, 5.0 + 2.0 * t, atol=1e-9)


def test_circle_at_constant_speed() -> None:
    radius, speed = 15.0, 9.0
    accel, gyro = measure(circle(radius, speed), IDENTITY_POSE)
    # The chord of a step is a little shorter than its arc: relative error (w dt)^2 / 12 = 3e-6.
    np.testing.assert_allclose(accel[1:-1], np.tile([0.0, speed**2 / radius, GRAVITY], (999, 1)), atol=1e-4)
    np.testing.assert_allclose(accel[[0, -1]], np.tile([0.0, speed**2 / radius, GRAVITY], (2, 1)), atol=1e-2)
    np.testing.assert_allclose(gyro, np.tile([0.0, 0.0, speed / radius], (1001, 1)), atol=1e-10)
    motion = differentiate(circle(radius, speed))
    np.testing.assert_allclose(np.linalg.norm(motion.velocity, axis=1), speed, rtol=1e-5)


def test_lever_arm_and_mount_rotation() -> None:
    radius, speed = 20.0, 8.0
    rate = speed / radius
    mount = pose_from_mount((1.5, 0.5, 2.0), yaw_deg=90.0)
    accel, gyro = measure(circle(radius, speed), mount)
    # In the body: v^2/r to the left and w x (w x l) = -w^2 (lx, ly, 0).
    # The sensor's x is the body's left, its y the body's rear.
    body = np.array([-(rate**2) * 1.5, speed**2 / radius - rate**2 * 0.5, GRAVITY])
    np.testing.assert_allclose(accel[5:-5], np.tile([body[1], -body[0], body[2]], (991, 1)), atol=1e-4)
    np.testing.assert_allclose(gyro, np.tile([0.0, 0.0, rate], (1001, 1)), atol=1e-10)


def test_rates_of_a_tilting_body() -> None:
    t = times(400)
    roll = 0.3 * np.sin(2.0 * t)
    motion = differentiate(pose_from_ypr(np.zeros((400, 3)), np.full_like(t, np.pi / 2), 0.0 * t, roll))
    expected = 0.6 * np.cos(2.0 * t)
    np.testing.assert_allclose(motion.body_rate[1:-1, 0], expected[1:-1], atol=1e-4)
    # The body looks along +y, so rolling about its nose is a rate about world y.
    np.testing.assert_allclose(motion.world_rate[:, 1], motion.body_rate[:, 0], atol=1e-12)
    np.testing.assert_allclose(motion.world_rate[:, [0, 2]], 0.0, atol=1e-12)


@pytest.mark.parametrize("mount", [IDENTITY_POSE, pose_from_mount((1.2, -0.4, 1.6), 30.0, 5.0, -3.0)])
@pytest.mark.parametrize("stored", [np.float64, np.float32])
def test_integrating_ten_seconds_returns_to_the_pose(mount: np.ndarray, stored: type) -> None:
    poses = drive()
    # USD keeps orientations in float32; the recording that is differentiated has been through that.
    poses[:, 3:] = poses[:, 3:].astype(np.float32)
    accel, gyro = (values.astype(stored).astype(float) for values in measure(poses, mount))
    sensor = compose(poses, mount)
    found, velocity = integrate_imu(accel, gyro, sensor[0], differentiate(sensor).velocity[0])
    assert np.linalg.norm(found[:, :3] - sensor[:, :3], axis=1).max() < 0.01
    assert np.degrees(angle_between(found[:, 3:], sensor[:, 3:])).max() < 0.01
    assert np.abs(velocity - differentiate(sensor).velocity).max() < 0.01
    if stored is np.float64:
        assert np.linalg.norm(found[:, :3] - sensor[:, :3], axis=1).max() < 2e-4


def test_integrating_part_of_a_recording_works_too() -> None:
    poses = drive()
    accel, gyro = measure(poses, IDENTITY_POSE)
    velocity = differentiate(poses).velocity
    part = slice(137, 760)
    found, _ = integrate_imu(accel[part], gyro[part], poses[137], velocity[137])
    assert np.linalg.norm(found[:, :3] - poses[part, :3], axis=1).max() < 1e-3


def test_verlet_identities_hold_at_every_frame_but_the_open_ends() -> None:
    poses = drive(50)
    m = differentiate(poses)
    step = poses[:-1, :3] + FRAME_DT * m.velocity[:-1] + 0.5 * FRAME_DT**2 * m.acceleration[:-1]
    np.testing.assert_allclose(poses[1:, :3], step, atol=1e-11)
    change = 0.5 * FRAME_DT * (m.acceleration[:-1] + m.acceleration[1:])
    np.testing.assert_allclose(m.velocity[1:], m.velocity[:-1] + change, atol=1e-9)


def test_motion_against_derivatives_known_in_closed_form() -> None:
    t = times(200)
    position = np.stack([np.sin(2 * t), np.cos(3 * t), t**2], axis=1)
    m = differentiate(make_pose(position, [0, 0, 0, 1.0]))
    velocity = np.stack([2 * np.cos(2 * t), -3 * np.sin(3 * t), 2 * t], axis=1)
    acceleration = np.stack([-4 * np.sin(2 * t), -9 * np.cos(3 * t), np.full_like(t, 2)], axis=1)
    np.testing.assert_allclose(m.velocity, velocity, atol=2e-3)
    np.testing.assert_allclose(m.acceleration[1:-1], acceleration[1:-1], atol=2e-3)
    np.testing.assert_allclose(m.acceleration, acceleration, atol=2e-2)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_short_recordings_have_a_motion(count: int) -> None:
    poses = pose_from_ypr(
        np.stack([3.0 * times(count), 0 * times(count), 0 * times(count)], axis=1), 2.0 * times(count)
    )
    m = differentiate(poses)
    np.testing.assert_allclose(m.velocity[:, 0], 3.0 if count > 1 else 0.0, atol=1e-9)
    np.testing.assert_allclose(m.body_rate[:, 2], 2.0 if count > 1 else 0.0, atol=1e-9)
    np.testing.assert_allclose(m.acceleration, 0.0, atol=1e-9)


def test_every_stay_is_differentiated_alone() -> None:
    poses = np.stack([drive(40), drive(40)], axis=1)
    poses[:10, 1] = poses[25:30, 1] = ABSENT
    m = differentiate(poses)
    np.testing.assert_array_equal(np.isnan(m.velocity[:, 1, 0]), np.isnan(poses[:, 1, 0]))
    for stay in (slice(10, 25), slice(30, 40)):
        alone = differentiate(drive(40)[stay])
        for name in ("velocity", "acceleration", "body_rate", "world_rate"):
            np.testing.assert_array_equal(getattr(m, name)[stay, 1], getattr(alone, name))
    np.testing.assert_array_equal(m.velocity[:, 0], differentiate(drive(40)).velocity)


@pytest.mark.parametrize("rows", [[0], [400], [3, 1], [398, 200, 203], [0, 400], []])
def test_derivatives_of_some_rows_are_those_of_the_whole(rows: list[int]) -> None:
    poses = np.stack([drive(401), drive(401)], axis=1)
    poses[:199, 1] = poses[204:, 1] = np.nan
    at = np.array(rows, dtype=np.int64)
    whole, some = differentiate(poses), differentiate_rows(poses, at)
    for name in ("velocity", "acceleration", "body_rate", "world_rate"):
        np.testing.assert_array_equal(getattr(some, name), getattr(whole, name)[at])


def test_recording_without_frames_has_no_derivatives() -> None:
    assert differentiate(np.zeros((0, 2, 7))).velocity.shape == (0, 2, 3)


def test_batch_rows_order_truth_and_errors() -> None:
    arrays = two_cars(8)
    config = Imu(mount={"cav": MountConfig(position_m=(0.5, 0.0, 1.0))})
    whole = imu_samples(arrays, range(8), config, 42, "canyon")
    assert len(whole.compass) == 8  # cav_1 alone carries it
    np.testing.assert_allclose(whole.accel_true, np.tile(G, (8, 1)), atol=1e-9)
    errors = imu_errors(config, range(8), 42, "canyon", ["cav_1"])
    np.testing.assert_allclose(whole.accel - whole.accel_true, errors.noise[0, 0], atol=1e-14)
    np.testing.assert_allclose(whole.gyro - whole.gyro_true, errors.noise[1, 0] + 0.001, atol=1e-14)
    np.testing.assert_array_equal(whole.accel_bias, 0.0)
    np.testing.assert_array_equal(whole.gyro_bias, 0.001)
    silent = imu_samples(arrays, range(8), Imu(accel_noise_std=0, gyro_noise_std=0, gyro_bias=0), 42, "canyon")
    np.testing.assert_array_equal(silent.accel, silent.accel_true)


@pytest.mark.parametrize("mode", ["carla", "physical"])
@pytest.mark.parametrize("lag", [0, 1])
@pytest.mark.parametrize("handedness", ["right", "left"])
def test_rows_do_not_depend_on_the_batch(mode: str, lag: int, handedness: str) -> None:
    arrays = driving(drive(60), circle(15.0, 9.0, 60))
    arrays.poses[20:23, 1] = ABSENT
    config = Imu(
        mode=mode, accel_lag_frames=lag, handedness=handedness, bias_correlation_s=None if lag else 5.0,
        accel_scale_std=0.01, misalignment_std_deg=0.5, mount={"cav": MountConfig(position_m=(1, 2, 3), yaw_deg=30)},
    )  # fmt: skip
    whole = assert_batches_do_not_matter(make_imu, arrays, 60, config)
    assert len(whole) == 117


def carla_rates(poses: np.ndarray) -> np.ndarray:
    """CARLA's gyroscope for small angles, (-d roll, -d pitch, +d yaw) / dt in the signs of its Rotator.

    Its yaw turns right, its pitch lifts the nose, its roll drops the right side: our -yaw, -pitch and +roll.
    """
    yaw, pitch, roll = quaternion_to_ypr(poses[:, 3:]).T
    rotator = np.stack([roll, -pitch, -yaw], axis=1)
    return np.gradient(rotator, FRAME_DT, axis=0) * [-1.0, -1.0, 1.0]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_left_handed_rates_have_carlas_signs(axis: int) -> None:
    angles = np.zeros((3, 30))
    angles[axis] = 0.02 * times(30)  # yaw, pitch, roll: small, so that order does not matter
    poses = pose_from_ypr(np.zeros((30, 3)), *angles)
    quiet = Imu(handedness="left", gyro_noise_std=0, gyro_bias=0)
    left = imu_samples(driving(poses), range(30), quiet, 1, "s")
    right = imu_samples(driving(poses), range(30), quiet.model_copy(update={"handedness": "right"}), 1, "s")
    np.testing.assert_allclose(left.gyro, carla_rates(poses), atol=1e-9)
    np.testing.assert_allclose(right.gyro, np.tile(np.eye(3)[2 - axis] * 0.02, (30, 1)), atol=1e-9)


def test_left_handed_forces() -> None:
    config = Imu(handedness="left", accel_noise_std=0)
    # A left turn accelerates to the left: +y of ours, -y of CARLA's. Rest reads +9.81 on z in both.
    turn = imu_samples(driving(circle(15.0, 9.0, 50)), range(5, 45), config, 1, "s")
    np.testing.assert_allclose(turn.accel, np.tile([0.0, -5.4, GRAVITY], (40, 1)), atol=1e-4)
    np.testing.assert_allclose(turn.gyro_true, np.tile([0.0, 0.0, -0.6], (40, 1)), atol=1e-9)
    # Left side up by 0.1 rad: the support pushes along the body's left.
    bank = pose_from_ypr(np.zeros((9, 3)), 0.0, 0.0, np.full(9, 0.1))
    rest = imu_samples(driving(bank), range(9), config, 1, "s")
    np.testing.assert_allclose(rest.accel, np.tile([0, -GRAVITY * np.sin(0.1), GRAVITY * np.cos(0.1)], (9, 1)))
    # Mirroring the world by hand gives the same: CARLA's positions are (x, -y, z), its turns are mirrored too.
    poses = drive(100)
    batch = imu_samples(driving(poses), range(100), config, 1, "s")
    mirror = np.diag([1.0, -1.0, 1.0])
    rotation = mirror @ quaternion_to_matrix(poses[:, 3:]) @ mirror  # sensor to world, both left-handed
    acceleration = (poses[2:, :3] - 2 * poses[1:-1, :3] + poses[:-2, :3]) @ mirror / FRAME_DT**2 + G
    force = np.einsum("fji,fj->fi", rotation[1:-1], acceleration)
    np.testing.assert_allclose(batch.accel[1:-1], force, atol=1e-8)
    # In coordinates v = w x r holds with the same rule for the cross product, so R^T dR/dt is w's matrix there too.
    turning = np.einsum("fji,fjk->fik", rotation[1:-1], rotation[2:] - rotation[:-2]) / (2 * FRAME_DT)
    rate = np.stack([turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]], axis=1)
    np.testing.assert_allclose(batch.gyro_true[1:-1], rate, atol=2e-3)


def test_carlas_accelerometer_is_one_frame_late() -> None:
    poses = drive(40)
    config = Imu(accel_lag_frames=1, accel_noise_std=0, gyro_noise_std=0, gyro_bias=0)
    late = imu_samples(driving(poses), range(40), config, 1, "s")
    # CARLA: second difference of the last three positions, in the axes of now.
    second = (poses[2:, :3] - 2 * poses[1:-1, :3] + poses[:-2, :3]) / FRAME_DT**2
    np.testing.assert_allclose(late.accel[2:], rotate(conjugate(poses[2:, 3:]), second + G), atol=1e-8)
    np.testing.assert_array_equal(late.accel[:2], late.accel_true[:2])  # no central difference before them
    assert np.abs(late.accel - late.accel_true)[2:].max() > 0.01
    np.testing.assert_allclose(late.gyro, late.gyro_true, atol=1e-12)


@pytest.mark.parametrize("lag", [0, 1])
def test_margin_is_what_readings_depend_on(lag: int) -> None:
    """A recording that begins a margin before a frame and ends behind it has the reading of the whole one."""
    poses, config = drive(40), Imu(accel_lag_frames=lag)
    margin = 1 + config.late_frames
    whole = imu_samples(driving(poses), range(40), config, 1, "s")
    for frame in (margin, 7, 20):
        start = frame - margin
        part = replace(driving(poses[start : frame + 2]), frames=range(start, frame + 2))
        one = imu_samples(part, [frame], config, 1, "s")
        np.testing.assert_array_equal(one.accel[0], whole.accel[frame])
        np.testing.assert_array_equal(one.gyro[0], whole.gyro[frame])


def test_compass_is_clockwise_from_north() -> None:
    yaw = np.radians([90.0, 0.0, -90.0, 180.0, 89.0, 91.0])  # north, east, south, west, just east and west of north
    arrays = driving(*(np.tile(pose_from_ypr((0, 0, 0), angle, 0.1, 0.2), (3, 1)) for angle in yaw))
    found = np.degrees(imu_samples(arrays, [1], Imu(), 1, "s").compass)
    np.testing.assert_allclose(found, [0, 90, 180, 270, 1, 359], atol=1e-9)
    rear = Imu(mount={"cav": MountConfig(yaw_deg=180.0)})
    np.testing.assert_allclose(
        np.degrees(imu_samples(arrays, [1], rear, 1, "s").compass[:4]), [180, 270, 0, 90], atol=1e-9
    )


def test_scale_and_misalignment_turn_and_stretch_the_true_reading() -> None:
    config = Imu(
        mode="physical", accel_noise_density=0, gyro_noise_density=0, accel_random_walk=0, gyro_random_walk=0,
        gyro_bias=0, accel_scale_std=0.02, gyro_scale_std=0.05, misalignment_std_deg=1.0,
    )  # fmt: skip
    batch = imu_samples(driving(drive(30)), range(30), config, 3, "s")
    for read, true, spread in ((batch.accel, batch.accel_true, 0.02), (batch.gyro, batch.gyro_true, 0.05)):
        matrix, _, rank, _ = np.linalg.lstsq(true, read, rcond=None)
        np.testing.assert_allclose(true @ matrix, read, atol=1e-12)
        scale = np.linalg.norm(matrix.T, axis=1)  # rows of D = diag(1 + s) R
        turn = matrix.T / scale[:, None]
        assert rank == 3
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
        assert 0 < np.abs(scale - 1).max() < 4 * spread
        assert 0 < np.arccos((np.trace(turn) - 1) / 2) < np.radians(6.0)


def test_absent_agents_have_no_rows() -> None:
    arrays = two_cars(8)
    arrays.poses[3, 0] = ABSENT
    assert [frame for frame, _ in rows_of(make_imu, arrays, range(8), Imu(), 1, "s")] == [0, 1, 2, 4, 5, 6, 7]
    assert imu_samples(arrays, [3], Imu(), 1, "s").accel.shape == (0, 3)


def test_specific_force_is_what_the_body_frame_sees() -> None:
    poses = drive(200)
    accel, gyro = measure(poses, IDENTITY_POSE)
    m = differentiate(poses)
    np.testing.assert_allclose(rotate(poses[:, 3:], accel) - G, m.acceleration, atol=1e-9)
    np.testing.assert_allclose(rotate(conjugate(poses[:, 3:]), m.world_rate), gyro, atol=1e-12)
