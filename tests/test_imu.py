"""IMU and kinematics: analytic motions, the inverse integrator, noise."""

import numpy as np
import pytest

from mmw.config import ImuConfig, MountConfig
from mmw.constants import FRAME_DT, GRAVITY
from mmw.poses import (
    IDENTITY_POSE,
    angle_between,
    compose,
    conjugate,
    make_pose,
    pose_from_mount,
    pose_from_ypr,
    rotate,
)
from mmw.sensors.imu import imu_noise, integrate_imu, make_imu, measure
from mmw.sensors.kinematics import differentiate, differentiate_rows
from tests.scenes import ABSENT, two_cars

G = np.array([0.0, 0.0, GRAVITY])


def times(count: int = 1001) -> np.ndarray:
    return FRAME_DT * np.arange(count)


def circle(radius: float, speed: float, count: int = 1001) -> np.ndarray:
    angle = speed / radius * times(count)
    position = np.stack([radius * np.sin(angle), radius * (1 - np.cos(angle)), np.full(count, 3.0)], axis=1)
    return pose_from_ypr(position, angle)


def drive(count: int = 1001) -> np.ndarray:
    """A hard drive: turns, braking, hills, nodding and rolling, with angular accelerations above 1 rad/s^2."""
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


def test_noise_does_not_depend_on_the_frames_asked_for() -> None:
    config = ImuConfig()
    whole = np.concatenate(imu_noise(config, range(1000), 42, "town", "cav_1"), axis=1)
    for frames in (range(100, 200), [999, 3, 3, 500], range(1), range(0)):
        part = np.concatenate(imu_noise(config, frames, 42, "town", "cav_1"), axis=1)
        np.testing.assert_array_equal(part, whole[list(frames)])


def test_noise_differs_between_streams() -> None:
    def first(seed=42, scenario="town", agent="cav_1", name="imu") -> np.ndarray:
        return imu_noise(ImuConfig(name=name), range(4), seed, scenario, agent)[0]

    variants = [first(), first(seed=43), first(scenario="tower"), first(agent="cav_2"), first(name="imu_2")]
    for i, one in enumerate(variants):
        for other in variants[:i]:
            assert not np.any(one == other)


def test_noise_statistics() -> None:
    count = 40_000
    accel, gyro = imu_noise(ImuConfig(), range(count), 7, "town", "cav_1")
    scaled = np.concatenate([accel / 0.1, (gyro - 0.001) / 0.002], axis=1)
    # Five standard errors of mean, variance and correlation of independent normal deviates.
    assert np.abs(scaled.mean(axis=0)).max() < 5 / np.sqrt(count)
    assert np.abs(scaled.var(axis=0) - 1).max() < 5 * np.sqrt(2 / count)
    assert np.abs(np.corrcoef(scaled.T) - np.eye(6)).max() < 5 / np.sqrt(count)
    assert np.abs(np.mean(scaled[1:] * scaled[:-1], axis=0)).max() < 5 / np.sqrt(count)
    assert abs(np.mean(np.abs(scaled) > 1.959964) - 0.05) < 0.005


def test_batch_rows_order_truth_and_noise() -> None:
    arrays = two_cars(8)
    config = ImuConfig(mount={"cav": MountConfig(position_m=(0.5, 0.0, 1.0))})
    whole = make_imu(arrays, range(8), config, 42, "canyon")
    np.testing.assert_array_equal(whole.frame, np.arange(8))
    np.testing.assert_array_equal(whole.actor, 0)
    part = make_imu(arrays, [5, 2], config, 42, "canyon")
    for name in ("accel", "gyro", "accel_true", "gyro_true"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[[5, 2]])
    np.testing.assert_allclose(whole.accel_true, np.tile(G, (8, 1)), atol=1e-9)
    noise = imu_noise(config, range(8), 42, "canyon", "cav_1")
    np.testing.assert_allclose(whole.accel - whole.accel_true, noise[0], atol=1e-14)
    np.testing.assert_allclose(whole.gyro - whole.gyro_true, noise[1], atol=1e-14)
    silent = make_imu(arrays, range(8), ImuConfig(accel_noise_std=0, gyro_noise_std=0, gyro_bias=0), 42, "canyon")
    np.testing.assert_array_equal(silent.accel, silent.accel_true)


def test_absent_agents_have_no_rows() -> None:
    arrays = two_cars(8)
    arrays.poses[3, 0] = ABSENT
    np.testing.assert_array_equal(make_imu(arrays, range(8), ImuConfig(), 1, "s").frame, [0, 1, 2, 4, 5, 6, 7])
    assert len(make_imu(arrays, [3], ImuConfig(), 1, "s").frame) == 0


def test_specific_force_is_what_the_body_frame_sees() -> None:
    poses = drive(200)
    accel, gyro = measure(poses, IDENTITY_POSE)
    m = differentiate(poses)
    np.testing.assert_allclose(rotate(poses[:, 3:], accel) - G, m.acceleration, atol=1e-9)
    np.testing.assert_allclose(rotate(conjugate(poses[:, 3:]), m.world_rate), gyro, atol=1e-12)
