"""Quaternions and rigid poses in float64.

A quaternion is (x, y, z, w), unit, Hamilton product; it turns vectors of the child frame into the parent frame. A pose
is (x, y, z, qx, qy, qz, qw), child to parent: `p_parent = rotate(q, p_child) + position`. Every function works on
arrays with any leading shape and broadcasts.

Yaw, pitch and roll turn about z, then about the new y, then about the new x: R = Rz(yaw) Ry(pitch) Rx(roll). In our
frames (x forward, y left, z up) yaw is counter-clockwise seen from above, pitch is nose down positive, roll is left
side up positive.

Source: J. Solà, "Quaternion kinematics for the error-state Kalman filter" (2017), sections 1, 2 and 4; scalar moved to
the end.
"""

import numpy as np
from numpy.typing import ArrayLike

IDENTITY_POSE = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
"""Identity transformation."""


NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
"""For each axis the one after it and the one before it."""

FEW_VECTORS = 2048
"""Numbers below which it is quicker to put axes in another order than to work on each."""


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the vector product over the last axis, shape [..., 3]; the bits of `np.cross`, in a tenth of its time."""
    if max(a.size, b.size) < FEW_VECTORS:
        found = a.take(NEXT, -1) * b.take(LAST, -1) - a.take(LAST, -1) * b.take(NEXT, -1)
        return found.astype(np.float64, copy=False)
    x = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out = np.empty((*x.shape, 3))
    out[..., 0] = x
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


FEW = 512
"""Numbers below which one call of NumPy is quicker than a few on whole columns."""


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the scalar product over a short last axis, shape [..., 1]; the bits of `np.sum`, in less of its time."""
    products = a * b
    if products.size < FEW:
        return np.add.reduce(products, axis=-1, keepdims=True)
    total = products[..., :1]
    for axis in range(1, products.shape[-1]):
        total = total + products[..., axis : axis + 1]
    return total


def length(v: np.ndarray) -> np.ndarray:
    """Return the length of vectors over a short last axis, shape [..., 1]; the bits of `np.linalg.norm`."""
    return np.sqrt(dot(v, v))


def normalize(q: ArrayLike) -> np.ndarray:
    """Return unit quaternions, shape [..., 4].

    Raises:
        ValueError: If a quaternion is zero.
    """
    q = np.asarray(q, dtype=np.float64)
    norm = length(q)
    if not norm.all():
        raise ValueError("normalize: a quaternion is zero; a rotation needs a length above zero; check the poses")
    return q / norm


def conjugate(q: ArrayLike) -> np.ndarray:
    """Return the inverse rotation of unit quaternions, shape [..., 4]."""
    return np.asarray(q, dtype=np.float64) * np.array([-1.0, -1.0, -1.0, 1.0])


def multiply(a: ArrayLike, b: ArrayLike) -> np.ndarray:
    """Return the Hamilton product a b, the rotation b followed by a, shape [..., 4]."""
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    vector_a, vector_b, scalar_a, scalar_b = a[..., :3], b[..., :3], a[..., 3:], b[..., 3:]
    vector = scalar_a * vector_b + scalar_b * vector_a + cross(vector_a, vector_b)
    scalar = scalar_a * scalar_b - dot(vector_a, vector_b)
    return np.concatenate([vector, scalar], axis=-1)


def rotate(q: ArrayLike, v: ArrayLike) -> np.ndarray:
    """Return vectors rotated by unit quaternions, shape [..., 3]."""
    q, v = np.asarray(q, dtype=np.float64), np.asarray(v, dtype=np.float64)
    twice = 2.0 * cross(q[..., :3], v)
    return v + q[..., 3:] * twice + cross(q[..., :3], twice)


def x_axes(q: np.ndarray) -> np.ndarray:
    """Return where unit quaternions turn the x axis, shape [..., 3]; the bits of `rotate`."""
    x, y, w = q[..., 0], q[..., 1], q[..., 3]
    twice = 2.0 * q
    twice_y, twice_z = twice[..., 1], twice[..., 2]
    out = np.empty((*q.shape[:-1], 3))
    out[..., 0] = 1.0 - (y * twice_y + q[..., 2] * twice_z)
    out[..., 1] = w * twice_z + x * twice_y
    out[..., 2] = x * twice_z - w * twice_y
    return out


def quaternion_exp(rotation_vector: ArrayLike) -> np.ndarray:
    """Return the quaternion of a rotation vector (axis times angle [rad], shape [..., 3]), shape [..., 4]."""
    half = 0.5 * np.asarray(rotation_vector, dtype=np.float64)
    angle = np.linalg.norm(half, axis=-1, keepdims=True)
    return np.concatenate([half * np.sinc(angle / np.pi), np.cos(angle)], axis=-1)


def quaternion_log(q: ArrayLike) -> np.ndarray:
    """Return the shortest rotation vector (axis times angle [rad]) of unit quaternions, shape [..., 3]."""
    q = np.asarray(q, dtype=np.float64)
    q = np.where(q[..., 3:] < 0.0, -q, q)
    sine = length(q[..., :3])
    angle = 2.0 * np.arctan2(sine, q[..., 3:])
    # Near zero, angle / sine = 2 to double precision.
    is_turned = sine > 1e-12
    scale = np.where(is_turned, angle / np.where(is_turned, sine, 1.0), 2.0)
    return q[..., :3] * scale


def angle_between(a: ArrayLike, b: ArrayLike) -> np.ndarray:
    """Return the angle between two rotations [rad], 0 to pi, shape [...]."""
    return np.linalg.norm(quaternion_log(multiply(conjugate(a), b)), axis=-1)


def quaternion_from_ypr(yaw: ArrayLike, pitch: ArrayLike, roll: ArrayLike) -> np.ndarray:
    """Return the quaternion of yaw, pitch and roll [rad], shape [..., 4]."""
    half = [0.5 * np.asarray(angle, dtype=np.float64) for angle in (yaw, pitch, roll)]
    cy, cp, cr = (np.cos(angle) for angle in half)
    sy, sp, sr = (np.sin(angle) for angle in half)
    return np.stack(
        np.broadcast_arrays(
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
            cy * cp * cr + sy * sp * sr,
        ),
        axis=-1,
    )


def quaternion_to_ypr(q: ArrayLike) -> np.ndarray:
    """Return yaw (-pi, pi], pitch [-pi/2, pi/2] and roll (-pi, pi] of unit quaternions [rad], shape [..., 3]."""
    m = quaternion_to_matrix(q)
    yaw = np.arctan2(m[..., 1, 0], m[..., 0, 0])
    # arctan2 has full precision near +-90 deg, where an arcsine would lose half of the digits.
    pitch = np.arctan2(-m[..., 2, 0], np.hypot(m[..., 0, 0], m[..., 1, 0]))
    roll = np.arctan2(m[..., 2, 1], m[..., 2, 2])
    return np.stack([yaw, pitch, roll], axis=-1)


def quaternion_to_matrix(q: ArrayLike) -> np.ndarray:
    """Return rotation matrices of unit quaternions, shape [..., 3, 3]; column j is the child's axis j."""
    q = np.asarray(q, dtype=np.float64)
    x, y, z, w = (q[..., axis] for axis in range(4))
    out = np.empty((*q.shape[:-1], 3, 3))
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
    return out


def quaternion_from_matrix(matrix: ArrayLike) -> np.ndarray:
    """Return unit quaternions with w >= 0 of rotation matrices [..., 3, 3], shape [..., 4].

    K + I = 4 q q^T, with K made of R, so that each of its columns is along q; the longest one is taken, so it is well
    conditioned for every angle.

    Source: I. Y. Bar-Itzhack, "New method for extracting the quaternion from a rotation matrix", J. Guidance 23 (2000),
    for K; S. W. Shepperd, "Quaternion from rotation matrix", J. Guidance 1 (1978), for the choice.
    """
    m = np.asarray(matrix, dtype=np.float64)
    k = np.empty((*m.shape[:-2], 4, 4))
    k[..., :3, :3] = m + np.swapaxes(m, -1, -2)
    trace = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2]
    for i in range(3):
        k[..., i, i] -= trace
        j, h = (i + 1) % 3, (i + 2) % 3
        k[..., 3, i] = k[..., i, 3] = m[..., h, j] - m[..., j, h]
    k[..., 3, 3] = trace
    longest = np.argmax(np.diagonal(k, axis1=-2, axis2=-1), axis=-1)[..., None]
    column = np.take_along_axis(k, longest[..., None], axis=-1)[..., 0] + (np.arange(4) == longest)
    q = column / length(column)
    return np.where(q[..., 3:] < 0.0, -q, q)


def make_pose(position: ArrayLike, q: ArrayLike) -> np.ndarray:
    """Return poses, shape [..., 7], of positions [m] [..., 3] and unit quaternions [..., 4]."""
    position, q = np.asarray(position, dtype=np.float64), np.asarray(q, dtype=np.float64)
    if position.shape[:-1] == q.shape[:-1]:
        return np.concatenate([position, q], axis=-1)
    shape = np.broadcast_shapes(position.shape[:-1], q.shape[:-1])
    return np.concatenate([np.broadcast_to(position, (*shape, 3)), np.broadcast_to(q, (*shape, 4))], axis=-1)


def pose_from_ypr(
    position: ArrayLike, yaw: ArrayLike = 0.0, pitch: ArrayLike = 0.0, roll: ArrayLike = 0.0
) -> np.ndarray:
    """Return poses, shape [..., 7], of positions [m] and yaw, pitch, roll [rad]."""
    return make_pose(position, quaternion_from_ypr(yaw, pitch, roll))


def pose_from_mount(
    position_m: ArrayLike, yaw_deg: float = 0.0, pitch_deg: float = 0.0, roll_deg: float = 0.0
) -> np.ndarray:
    """Return the sensor-to-agent pose of a configured mount: offset [m] and angles [deg], shape [7]."""
    return pose_from_ypr(position_m, *np.radians([yaw_deg, pitch_deg, roll_deg]))


def compose(parent: ArrayLike, child: ArrayLike) -> np.ndarray:
    """Return poses of the child in the reference frame of the parent's pose, shape [..., 7]."""
    parent, child = np.asarray(parent, dtype=np.float64), np.asarray(child, dtype=np.float64)
    position = transform_points(parent, child[..., :3])
    return make_pose(position, multiply(parent[..., 3:], child[..., 3:]))


def invert(pose: ArrayLike) -> np.ndarray:
    """Return inverse poses (parent to child), shape [..., 7]."""
    pose = np.asarray(pose, dtype=np.float64)
    q = conjugate(pose[..., 3:])
    return make_pose(-rotate(q, pose[..., :3]), q)


def transform_points(pose: ArrayLike, points: ArrayLike) -> np.ndarray:
    """Return points of the child frame in the parent frame [m], shape [..., 3]; leading shapes broadcast."""
    pose = np.asarray(pose, dtype=np.float64)
    return rotate(pose[..., 3:], points) + pose[..., :3]


def pose_to_matrix(pose: ArrayLike) -> np.ndarray:
    """Return homogeneous column-vector matrices, shape [..., 4, 4]."""
    pose = np.asarray(pose, dtype=np.float64)
    matrix = np.zeros((*pose.shape[:-1], 4, 4))
    matrix[..., :3, :3] = quaternion_to_matrix(pose[..., 3:])
    matrix[..., :3, 3] = pose[..., :3]
    matrix[..., 3, 3] = 1.0
    return matrix


def continuous(q: ArrayLike) -> np.ndarray:
    """Return a series of quaternions, shape [F, ..., 4], with signs such that neighbors have a positive product."""
    q = np.asarray(q, dtype=np.float64)
    flip = np.sum(q[1:] * q[:-1], axis=-1) < 0.0
    sign = np.concatenate([np.ones((min(len(q), 1), *q.shape[1:-1])), np.where(flip, -1.0, 1.0)]).cumprod(axis=0)
    return q * sign[..., None]
