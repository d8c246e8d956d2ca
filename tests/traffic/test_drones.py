"""Drones: through their waypoints, tilted along their acceleration, continuous up to it."""

import numpy as np
import pytest

from mmw.config import UavConfig
from mmw.core.constants import FRAME_DT, GRAVITY
from mmw.core.kinematics import differentiate
from mmw.core.transforms import quaternion_to_matrix, quaternion_to_ypr, rotate
from mmw.traffic.drones import drone_poses, fly_drones

POINTS = ((0.0, (0.0, 0.0, 20.0)), (4.0, (30.0, 0.0, 25.0)), (7.0, (30.0, 20.0, 18.0)), (9.0, (30.0, 20.0, 18.0)))
UAV = UavConfig(name="uav_1", waypoints=[{"time_s": time, "position_m": place} for time, place in POINTS])


def test_passes_the_waypoints_in_their_time() -> None:
    (track,) = fly_drones([UAV], 1101)
    assert (track.name, track.role, track.model) == ("uav_1", "uav", "quadrotor")
    for time, place in POINTS:
        np.testing.assert_allclose(track.poses[round(time * 100), :3], place, atol=1e-9)
    np.testing.assert_array_equal(track.poses[1000], track.poses[1100])  # hovers at the last one
    assert fly_drones([], 10) == []


def test_velocity_and_acceleration_are_continuous() -> None:
    poses = drone_poses(UAV, np.arange(1101) / 100.0)
    velocity = np.gradient(poses[:, :3], FRAME_DT, axis=0)
    acceleration = np.gradient(velocity, FRAME_DT, axis=0)
    assert np.abs(np.diff(velocity, axis=0)).max() < 0.15
    assert np.abs(np.diff(acceleration, axis=0)).max() < 0.6  # a jump would be one of several m/s^2
    motion = differentiate(poses[:, None], FRAME_DT)
    assert np.abs(np.diff(motion.world_rate[:, 0], axis=0)).max() < 0.2


def test_thrust_gives_the_acceleration() -> None:
    poses = drone_poses(UAV, np.arange(1101) / 100.0)
    acceleration = (poses[2:, :3] - 2 * poses[1:-1, :3] + poses[:-2, :3]) / FRAME_DT**2
    thrust = acceleration + np.array([0.0, 0.0, GRAVITY])
    up = rotate(poses[1:-1, 3:], np.tile([0.0, 0.0, 1.0], (len(thrust), 1)))
    np.testing.assert_allclose(up, thrust / np.linalg.norm(thrust, axis=1, keepdims=True), atol=5e-3)


def test_looks_along_its_course_or_as_told() -> None:
    yaw = np.degrees(quaternion_to_ypr(drone_poses(UAV, np.array([0.0, 4.0, 7.0, 12.0]))[:, 3:])[:, 0])
    np.testing.assert_allclose(yaw, [0.0, 90.0, 90.0, 90.0], atol=1e-6)
    told = UavConfig(
        waypoints=[{"time_s": t, "position_m": (5 * t, 0, 9), "yaw_deg": y} for t, y in ((0, 170), (4, -170))]
    )
    turned = quaternion_to_ypr(drone_poses(told, np.linspace(0, 4, 41))[:, 3:])[:, 0]
    assert np.abs(np.degrees(turned)).min() > 169.0  # the shorter way round


def test_hovers_level() -> None:
    poses = drone_poses(UavConfig(position_m=(1, 2, 30), yaw_deg=90), np.arange(5) / 100.0)
    np.testing.assert_allclose(poses[:, :3], [(1, 2, 30)] * 5)
    np.testing.assert_allclose(quaternion_to_matrix(poses[0, 3:]), [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    assert poses[0, 6] == pytest.approx(np.sqrt(0.5))
