"""Sensors, points and boxes on bodies: the general functions of poses, in NumPy, say the same."""

import numpy as np
import pytest

from mmw.core.kinematics import differentiate
from mmw.core.transforms import compose, cross, make_pose, normalize, quaternion_to_ypr, rotate, transform_points
from mmw.scene.bodies import mounted_poses, points_on
from mmw.sensors.ground_truth.boxes_3d import make_boxes
from tests.fixtures.scenes import ABSENT, two_cars


def random_poses(*shape: int) -> np.ndarray:
    """Return poses with quaternions that are not unit ones."""
    return np.random.default_rng(5).normal(size=(*shape, 7)) * np.array([300.0, 300, 5, 2, 2, 2, 2])


def unit(poses: np.ndarray) -> np.ndarray:
    return make_pose(poses[..., :3], normalize(poses[..., 3:]))


def test_mounted_poses_have_the_bits_of_composed_ones() -> None:
    """Sums, products, quotients and roots alone, in the same order and none of them fused."""
    bodies, mounts = random_poses(4, 6), unit(random_poses(6))
    bodies[2, 3] = ABSENT
    pose, is_present = mounted_poses(bodies, mounts)
    np.testing.assert_array_equal(pose, compose(unit(bodies), mounts))
    np.testing.assert_array_equal(is_present, np.isfinite(bodies).all(axis=-1))
    assert mounted_poses(bodies[:0], mounts)[0].shape == (0, 6, 7)
    assert mounted_poses(bodies[:, :0], mounts[:0])[1].shape == (4, 0)


def test_zero_quaternions_are_refused() -> None:
    bodies = random_poses(2, 1)
    bodies[1, 0, 3:] = 0.0
    with pytest.raises(ValueError, match="a quaternion is zero"):
        mounted_poses(bodies, unit(random_poses(1)))
    mounted_poses(bodies[:1], unit(random_poses(1)))  # the last call's fault is not this one's


def test_points_have_the_bits_of_transformed_ones() -> None:
    bodies, local = random_poses(9), np.random.default_rng(2).normal(size=(9, 3))
    np.testing.assert_array_equal(points_on(bodies, local), transform_points(unit(bodies), local))


def test_boxes_are_those_of_the_bodies_poses() -> None:
    """Places and velocities have the same bits; an arctangent may round otherwise, by 1e-15 rad at most."""
    arrays = two_cars(6)
    arrays.poses[:] = unit(random_poses(*arrays.poses.shape[:2]))
    arrays.poses[3, 1] = ABSENT
    boxes, motion = make_boxes(arrays, list(arrays.frames)), differentiate(arrays.poses)
    center = np.array([arrays.actors[actor].center for actor in boxes.actor])
    pose = arrays.poses[boxes.frame, boxes.actor]
    q = normalize(pose[:, 3:])
    np.testing.assert_array_equal(boxes.pose[:, 3:], q)
    np.testing.assert_array_equal(boxes.pose[:, :3], transform_points(unit(pose), center))
    np.testing.assert_allclose(boxes.ypr, quaternion_to_ypr(q), rtol=0, atol=1e-15)
    velocity, rate = (getattr(motion, name)[boxes.frame, boxes.actor] for name in ("velocity", "world_rate"))
    np.testing.assert_array_equal(boxes.velocity, velocity + cross(rate, rotate(q, center)))
    assert boxes.frame.tolist() == [0, 0, 1, 1, 2, 2, 3, 4, 4, 5, 5]  # of two cars; the roadside unit has none
