"""Views: order, poses, presence, and the check against the loaded batch."""

import dataclasses

import numpy as np
import pytest

from mmw.config import MountConfig
from mmw.core.transforms import pose_to_matrix, quaternion_to_ypr
from mmw.scene.views import SensorViews, actor_views, make_views, mount_pose, sample_views, sensor_actors
from mmw.sensors import DepthCamera, Imu, Lidar
from tests.fixtures.device_rays import loaded
from tests.fixtures.scenes import ABSENT, two_cars


def test_rows_go_by_frame_then_agent() -> None:
    views = make_views(two_cars(4), [2, 0, 3], Lidar())
    np.testing.assert_array_equal(views.frame, [2, 2, 0, 0, 3, 3])
    np.testing.assert_array_equal(views.batch_index, [0, 0, 1, 1, 2, 2])
    np.testing.assert_array_equal(views.actor, [0, 2, 0, 2, 0, 2])
    np.testing.assert_array_equal(views.ignore_instance, -1)
    assert len(views) == 6


def test_role_decides_who_carries_and_where() -> None:
    arrays = two_cars()
    assert list(sensor_actors(arrays, DepthCamera())) == [2]
    assert list(sensor_actors(arrays, Imu())) == [0]
    assert len(make_views(arrays, [0], DepthCamera(on=()))) == 0
    np.testing.assert_allclose(mount_pose(Lidar(), "rsu", "rsu_1")[:3], (0.0, 0.0, 4.0))
    np.testing.assert_allclose(mount_pose(Imu(), "cav", "cav_1"), (0, 0, 0, 0, 0, 0, 1))


def test_a_name_decides_before_the_role() -> None:
    arrays = two_cars()
    names = [actor.name for actor in arrays.actors]
    assert [names[i] for i in sensor_actors(arrays, Imu(on=(names[2],)))] == [names[2]]
    assert len(sensor_actors(arrays, Lidar(on=("cav", names[2])))) == 2
    high = Lidar(mount={names[0]: MountConfig(position_m=(0.0, 0.0, 3.5))})
    usual = make_views(arrays, [0], Lidar()).pose
    lifted = make_views(arrays, [0], high).pose
    np.testing.assert_allclose(lifted[:, 2] - usual[:, 2], (1.0, 0.0))  # the unit keeps its own


def test_any_actor_carries_a_sensor_that_is_put_on_it() -> None:
    """A vehicle has it where a CAV does; an actor of another role at its origin."""
    arrays = two_cars(2)
    sensor = Lidar(on=())
    assert len(make_views(arrays, [0, 1], sensor)) == 0
    views = actor_views(arrays, [0, 1], sensor, np.array([1, 2]))
    np.testing.assert_array_equal(views.actor, [1, 2, 1, 2])
    np.testing.assert_allclose(views.pose[:2, :3], [(20.0, 3.0, 2.5), (0.0, 9.0, 9.0)])
    np.testing.assert_array_equal(mount_pose(sensor, "pedestrian", "ped_001"), mount_pose(sensor, "cav", "cav_1"))
    np.testing.assert_array_equal(mount_pose(sensor, "free", ""), (0, 0, 0, 0, 0, 0, 1))


def test_pose_is_agent_times_mount() -> None:
    arrays = two_cars()
    mount = MountConfig(position_m=(1.0, 0.5, 2.0), yaw_deg=90.0, pitch_deg=10.0)
    views = make_views(arrays, [0, 1], Lidar(mount={"cav": mount, "rsu": mount}))
    # The unit at (0, 9, 5) looks along -y: forward is -y, left is +x.
    np.testing.assert_allclose(views.pose[1, :3], (0.5, 8.0, 7.0), atol=1e-12)
    np.testing.assert_allclose(np.degrees(quaternion_to_ypr(views.pose[1, 3:])), (0.0, 10.0, 0.0), atol=1e-9)
    expected = pose_to_matrix(arrays.poses[1, 0]) @ pose_to_matrix(
        mount_pose(Lidar(mount={"cav": mount}), "cav", "cav_1")
    )
    np.testing.assert_allclose(pose_to_matrix(views.pose[2]), expected, atol=1e-12)


def test_absent_agent_has_no_view() -> None:
    arrays = two_cars(3)
    arrays.poses[1, 0] = ABSENT
    views = make_views(arrays, [0, 1, 2], Lidar())
    np.testing.assert_array_equal(views.frame, [0, 0, 1, 2, 2])
    np.testing.assert_array_equal(views.batch_index, [0, 0, 1, 2, 2])
    np.testing.assert_array_equal(views.actor, [0, 2, 2, 0, 2])


def test_device_rows_are_relative_to_the_scene_origin() -> None:
    views = make_views(two_cars(), [1], Lidar())
    on_device = views.to_device("cpu", np.array([100.0, 0.0, -1.0]))
    expected = views.pose - np.array([100.0, 0, -1, 0, 0, 0, 0])
    np.testing.assert_allclose(on_device.pose.numpy(), expected, atol=1e-5)
    np.testing.assert_array_equal(on_device.batch_index.numpy(), views.batch_index)
    np.testing.assert_array_equal(on_device.ignore.numpy(), views.ignore_instance)


def test_views_of_another_batch_are_refused() -> None:
    arrays = two_cars(4)
    scene = loaded(arrays, "cpu", [0, 1])
    assert make_views(arrays, [0, 1], Lidar()).for_scene(scene).batch_index.shape == (4,)
    for frames in ([1, 0], [0, 1, 2]):
        with pytest.raises(ValueError, match="call load_batch"):
            make_views(arrays, frames, Lidar()).for_scene(scene)


def test_views_of_several_sensors_are_those_of_each() -> None:
    arrays, frames = two_cars(4), [2, 0, 3]
    arrays.poses[3, 0] = ABSENT
    mount = MountConfig(position_m=(1.0, 0.5, 2.0), yaw_deg=90.0)
    sensors = (Lidar(), Imu(), DepthCamera(on=()), Lidar(name="slow", rate_hz=50.0, mount={"cav": mount}))
    other = Lidar(name="other")
    together = SensorViews(arrays, frames, sensors)
    for sensor in (*sensors, other):
        found, wanted = together.of(sensor), sample_views(arrays, frames, sensor)
        for field in dataclasses.fields(wanted):
            own, expected = getattr(found, field.name), getattr(wanted, field.name)
            np.testing.assert_array_equal(own, expected)
            assert own.dtype == expected.dtype


def test_views_of_the_same_agents_share_what_stays() -> None:
    arrays, sensors = two_cars(6), (Lidar(), Imu(), Lidar(name="slow", rate_hz=50.0))
    arrays.poses[4, 0] = ABSENT
    for sensor in sensors:
        one, other, absent, late = (SensorViews(arrays, frames, sensors).of(sensor) for frames in ([0], [2], [4], [1]))
        for name in ("actor", "batch_index", "ignore_instance"):
            first = getattr(one, name)
            assert first is getattr(other, name) and first is not getattr(absent, name)
            assert (first is getattr(late, name)) == (sensor.name != "slow")
