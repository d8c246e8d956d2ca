"""Quaternion and pose algebra: laws, and matrices as the independent opinion."""

import numpy as np
import pytest

from mmw.core import transforms as poses


def random_quaternions(count: int, seed: int = 0) -> np.ndarray:
    return poses.normalize(np.random.default_rng(seed).normal(size=(count, 4)))


def random_poses(count: int, seed: int = 0) -> np.ndarray:
    return poses.make_pose(
        np.random.default_rng(seed + 100).uniform(-50, 50, (count, 3)), random_quaternions(count, seed)
    )


def test_products_and_lengths_have_the_bits_of_numpy() -> None:
    """Over few components NumPy adds in their order."""
    a, b = np.random.default_rng(0).normal(size=(2, 7, 50, 4)) * 10.0 ** np.arange(-150, 50, 4)[:, None]
    for last in (3, 4):
        one, other = a[..., :last], b[..., :last]
        assert poses.dot(one, other).tobytes() == np.sum(one * other, axis=-1, keepdims=True).tobytes()
        assert poses.length(one).tobytes() == np.linalg.norm(one, axis=-1, keepdims=True).tobytes()


def test_rotation_equals_its_matrix() -> None:
    q, v = random_quaternions(50), np.random.default_rng(1).normal(size=(50, 3))
    matrix = poses.quaternion_to_matrix(q)
    np.testing.assert_allclose(poses.rotate(q, v), np.einsum("nij,nj->ni", matrix, v), atol=1e-13)
    np.testing.assert_allclose(np.linalg.det(matrix), 1.0, atol=1e-13)
    np.testing.assert_allclose(matrix @ np.swapaxes(matrix, -1, -2), np.broadcast_to(np.eye(3), (50, 3, 3)), atol=1e-13)


def test_product_turns_by_b_then_by_a() -> None:
    a, b = random_quaternions(20), random_quaternions(20, seed=1)
    v = np.random.default_rng(2).normal(size=(20, 3))
    np.testing.assert_allclose(poses.rotate(poses.multiply(a, b), v), poses.rotate(a, poses.rotate(b, v)), atol=1e-13)


def test_yaw_pitch_roll_signs() -> None:
    forward, left = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]
    quarter = np.pi / 2
    np.testing.assert_allclose(poses.rotate(poses.quaternion_from_ypr(quarter, 0, 0), forward), [0, 1, 0], atol=1e-15)
    # Nose down: forward turns to -z. Left side up: left turns to +z.
    np.testing.assert_allclose(poses.rotate(poses.quaternion_from_ypr(0, quarter, 0), forward), [0, 0, -1], atol=1e-15)
    np.testing.assert_allclose(poses.rotate(poses.quaternion_from_ypr(0, 0, quarter), left), [0, 0, 1], atol=1e-15)


def test_yaw_pitch_roll_is_rz_ry_rx_and_comes_back() -> None:
    rng = np.random.default_rng(3)
    ypr = rng.uniform([-np.pi, -1.5, -np.pi], [np.pi, 1.5, np.pi], (100, 3))
    cos, sin = np.cos(ypr), np.sin(ypr)
    for row, c, s in zip(ypr, cos, sin, strict=True):
        rz = np.array([[c[0], -s[0], 0], [s[0], c[0], 0], [0, 0, 1]])
        ry = np.array([[c[1], 0, s[1]], [0, 1, 0], [-s[1], 0, c[1]]])
        rx = np.array([[1, 0, 0], [0, c[2], -s[2]], [0, s[2], c[2]]])
        np.testing.assert_allclose(
            poses.quaternion_to_matrix(poses.quaternion_from_ypr(*row)), rz @ ry @ rx, atol=1e-14
        )
    np.testing.assert_allclose(poses.quaternion_to_ypr(poses.quaternion_from_ypr(*ypr.T)), ypr, atol=1e-12)


def test_matrix_comes_back_also_at_half_turns() -> None:
    q = np.concatenate([random_quaternions(100), np.eye(4), poses.normalize([[1, 1, 0, 1e-9], [0, 1, -1, 0]])])
    back = poses.quaternion_from_matrix(poses.quaternion_to_matrix(q))
    assert np.all(back[:, 3] >= 0.0)
    np.testing.assert_allclose(poses.quaternion_to_matrix(back), poses.quaternion_to_matrix(q), atol=1e-13)


def test_quaternion_of_a_matrix_is_the_eigenvector() -> None:
    """Of the largest eigenvalue of the matrix of Bar-Itzhack (2000), and small turns keep all their digits."""
    q = random_quaternions(2000)
    m = poses.quaternion_to_matrix(q)
    k = np.empty((2000, 4, 4))
    k[:, :3, :3] = m + m.swapaxes(1, 2) - np.trace(m, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    k[:, 3, :3] = k[:, :3, 3] = np.stack([m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]], 1)
    k[:, 3, 3] = np.trace(m, axis1=1, axis2=2)
    wanted = np.linalg.eigh(k)[1][:, :, -1]
    found = poses.quaternion_from_matrix(m)
    np.testing.assert_allclose(found, wanted * np.where(wanted[:, 3:] < 0.0, -1.0, 1.0), atol=3e-15)
    small = poses.normalize(np.concatenate([1e-9 * random_quaternions(50)[:, :3], np.ones((50, 1))], axis=1))
    back = poses.quaternion_from_matrix(poses.quaternion_to_matrix(small).reshape(5, 10, 3, 3))
    np.testing.assert_allclose(back, small.reshape(5, 10, 4), rtol=1e-13)


@pytest.mark.parametrize("angle", [0.0, 1e-14, 1e-8, 1e-3, 1.0, 3.0])
def test_log_inverts_exp(angle: float) -> None:
    vector = angle * poses.normalize(np.random.default_rng(4).normal(size=(20, 3)))
    q = poses.quaternion_exp(vector)
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1.0, atol=1e-15)
    np.testing.assert_allclose(poses.quaternion_log(q), vector, rtol=1e-12, atol=1e-22)
    np.testing.assert_allclose(poses.quaternion_log(-q), vector, rtol=1e-12, atol=1e-22)


def test_compose_and_invert_equal_matrices() -> None:
    a, b = random_poses(30), random_poses(30, seed=1)
    matrix_a, matrix_b = poses.pose_to_matrix(a), poses.pose_to_matrix(b)
    np.testing.assert_allclose(poses.pose_to_matrix(poses.compose(a, b)), matrix_a @ matrix_b, atol=1e-11)
    np.testing.assert_allclose(poses.pose_to_matrix(poses.invert(a)), np.linalg.inv(matrix_a), atol=1e-11)
    points = np.random.default_rng(5).normal(size=(30, 3))
    expected = np.einsum("nij,nj->ni", matrix_a, np.concatenate([points, np.ones((30, 1))], axis=1))[:, :3]
    np.testing.assert_allclose(poses.transform_points(a, points), expected, atol=1e-12)


def test_shapes_broadcast() -> None:
    series = random_poses(12).reshape(3, 4, 7)
    mount = poses.pose_from_mount((1.0, 2.0, 3.0), yaw_deg=90.0)
    assert poses.compose(series, mount).shape == (3, 4, 7)
    np.testing.assert_allclose(poses.compose(series, mount)[1, 2], poses.compose(series[1, 2], mount), atol=1e-14)
    assert poses.transform_points(series[0, 0], np.zeros((5, 3))).shape == (5, 3)
    assert poses.compose(np.zeros((0, 7)), mount).shape == (0, 7)


def test_mount_is_in_degrees() -> None:
    mount = poses.pose_from_mount((0.0, 0.0, 2.5), yaw_deg=-90.0, pitch_deg=10.0)
    np.testing.assert_allclose(np.degrees(poses.quaternion_to_ypr(mount[3:])), [-90.0, 10.0, 0.0], atol=1e-12)


def test_continuous_removes_sign_flips() -> None:
    q = poses.quaternion_exp(np.linspace(0, 8, 60)[:, None] * np.array([0.0, 0.0, 1.0]))
    flipped = q * np.where(np.random.default_rng(6).random(60) < 0.5, -1.0, 1.0)[:, None]
    smooth = poses.continuous(flipped)
    assert np.all(np.sum(smooth[1:] * smooth[:-1], axis=1) > 0.99)
    np.testing.assert_allclose(np.abs(np.sum(smooth * q, axis=1)), 1.0, atol=1e-14)


def test_zero_quaternion_is_refused() -> None:
    with pytest.raises(ValueError, match="quaternion is zero"):
        poses.normalize(np.zeros(4))


@pytest.mark.parametrize("count", [0, 1, 2])
def test_continuous_keeps_short_series(count: int) -> None:
    series = np.tile([0.0, 0.0, 0.6, -0.8], (count, 3, 1))
    np.testing.assert_array_equal(poses.continuous(series), series)
