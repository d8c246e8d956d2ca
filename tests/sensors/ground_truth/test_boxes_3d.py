"""Boxes against their vehicles' geometry, and returns counted on them."""

import numpy as np

from mmw.core.kinematics import differentiate
from mmw.core.transforms import invert, pose_from_ypr, quaternion_from_ypr, transform_points
from mmw.scene.views import make_views
from mmw.sensors import Lidar
from mmw.sensors.ground_truth.boxes_3d import make_boxes
from mmw.sensors.ground_truth.visibility import count_returns
from tests.fixtures.lidar_sweeps import sweeps
from tests.fixtures.scenes import ABSENT, box_model, street_canyon, two_cars


def turning_scene(frame_count: int = 20):
    t = np.arange(frame_count) * 0.01
    model = box_model("van", (5.5, 2.0, 2.4), (1.3, 0.0, 1.2), material=4)
    yaw = 0.4 + 0.8 * t
    poses = pose_from_ypr(np.stack([3 * t, -2 * t, 0.1 * t], axis=1), yaw, 0.05 + 0 * t, -0.03 + 0 * t)
    return street_canyon((model,), [("veh_001", "vehicle", 0)], poses[:, None])


def test_box_encloses_the_vehicle_tightly() -> None:
    arrays = turning_scene()
    boxes = make_boxes(arrays, range(20))
    for row in range(20):
        world = transform_points(arrays.poses[row, 0], arrays.models[0].points)
        local = transform_points(invert(boxes.pose[row]), world)
        np.testing.assert_allclose(np.abs(local), np.tile(boxes.size[row] / 2, (8, 1)), atol=1e-9)
    np.testing.assert_allclose(quaternion_from_ypr(*boxes.ypr.T), boxes.pose[:, 3:], atol=1e-12)
    np.testing.assert_allclose(boxes.ypr[3], (0.4 + 0.8 * 0.03, 0.05, -0.03), atol=1e-9)


def test_velocity_is_that_of_the_middle() -> None:
    arrays = turning_scene()
    boxes = make_boxes(arrays, range(20))
    measured = (boxes.pose[2:, :3] - boxes.pose[:-2, :3]) / 0.02
    np.testing.assert_allclose(boxes.velocity[1:-1], measured, atol=1e-4)
    assert np.linalg.norm(boxes.velocity[5] - differentiate(arrays.poses).velocity[5, 0]) > 0.9


def test_rows_are_the_vehicles_that_are_present() -> None:
    arrays = two_cars(3)
    arrays.poses[1, 1] = ABSENT
    boxes = make_boxes(arrays, [2, 1])
    np.testing.assert_array_equal(boxes.frame, [2, 2, 1])
    np.testing.assert_array_equal(boxes.actor, [0, 1, 0])
    np.testing.assert_array_equal(boxes.object_id, [arrays.actors[i].object_id for i in (0, 1, 0)])
    assert len(make_boxes(street_canyon(), [0]).frame) == 0


def test_motion_may_be_given() -> None:
    arrays = two_cars(4)
    given, made = make_boxes(arrays, [1, 3], differentiate(arrays.poses)), make_boxes(arrays, [1, 3])
    np.testing.assert_array_equal(given.velocity, made.velocity)
    np.testing.assert_allclose(given.velocity[:, 0], [100.0, -100.0, 100.0, -100.0], atol=1e-9)


def test_returns_are_counted_per_view_and_object() -> None:
    offsets, object_id = np.array([0, 4, 4, 7]), np.array([5, 2, 5, 9, 2, 2, 0])
    np.testing.assert_array_equal(count_returns(offsets, object_id, [2, 5, 77]), [[1, 2, 0], [0, 0, 0], [2, 0, 0]])
    assert count_returns(offsets, object_id, []).shape == (3, 0)
    assert count_returns(np.array([0]), np.zeros(0, int), [1]).shape == (0, 1)
    np.testing.assert_array_equal(count_returns(np.array([0, 0]), np.zeros(0, int), [1]), [[0]])


def test_returns_on_a_vehicle_lie_in_its_box() -> None:
    arrays = two_cars(2)
    config = Lidar(channels=16, points_per_channel=180, optics={"range_resolution_m": 0})
    views, batch = make_views(arrays, [0, 1], config), sweeps(arrays, "cpu", [0, 1], config)
    boxes = make_boxes(arrays, [0, 1])
    ids = boxes.object_id[:2]
    counts = count_returns(batch.offsets, batch.object_id, ids)
    assert counts.shape == (4, 2) and counts[1].min() > 0
    for view in range(4):
        part = slice(batch.offsets[view], batch.offsets[view + 1])
        world = transform_points(views.pose[view], np.stack([batch.x[part], batch.y[part], batch.z[part]], axis=1))
        for k, object_id in enumerate(ids):
            row = np.flatnonzero((boxes.frame == views.frame[view]) & (boxes.object_id == object_id))[0]
            points = world[batch.object_id[part] == object_id]
            assert len(points) == counts[view, k]
            local = transform_points(invert(boxes.pose[row]), points)
            assert np.all(np.abs(local) <= boxes.size[row] / 2 + 1.0 / 256)
