"""Antennas ride on their actors, with the bits of NumPy."""

import numpy as np

from mmw.core.kinematics import differentiate
from mmw.core.transforms import cross, normalize, pose_from_ypr, quaternion_to_matrix
from mmw.physics.em.vectors import rotate
from mmw.scene.mounted_antennas import mounted_antennas, mounts_at
from tests.oracles.channel import driving, traffic


def test_antennas_have_the_bits_of_numpy() -> None:
    generator = np.random.default_rng(4)
    poses = driving(np.arange(12) * 0.01)
    poses[..., 3:] *= generator.uniform(0.5, 2.0, (12, 4, 1))  # not of unit length
    data = traffic(poses)
    rows, count = np.array([2, 7, 5]), 40
    row, actor = generator.integers(0, 3, count), generator.integers(0, 4, count)
    place = generator.normal(size=(count, 3))
    mount = pose_from_ypr(place, np.where(np.arange(count) % 3 == 0, generator.normal(size=count), 0.0))
    motion = differentiate(data.poses, data.pose_dt)
    found = mounted_antennas(data, rows, row, actor, mounts_at(mount), motion)
    pose = data.poses[rows[row], actor]
    rotation = quaternion_to_matrix(normalize(pose[:, 3:]))
    lever = rotate(rotation, place)
    at = rows[row], actor
    assert found.position.tobytes() == (pose[:, :3] + lever).tobytes()
    assert found.velocity.tobytes() == (motion.velocity[at] + cross(motion.world_rate[at], lever)).tobytes()
    turned = np.arange(count) % 3 == 0
    assert found.rotation[~turned].tobytes() == rotation[~turned].tobytes()
    turn = quaternion_to_matrix(mount[turned, 3:])
    np.testing.assert_array_equal(found.rotation[turned], rotation[turned] @ turn)
    alone = mounted_antennas(data, rows, row, actor, mounts_at(place), motion)
    assert alone.rotation.tobytes() == rotation.tobytes() and alone.position.tobytes() == found.position.tobytes()
