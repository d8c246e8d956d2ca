"""CARLA's frames: left-handed, x forward, y right, z up, degrees; the mirror image of ours (y -> -y).

With F = diag(1, -1, 1) a rotation R of our frames is F R F in CARLA's; in angles roll stays, yaw and pitch change sign:
yaw is clockwise seen from above, pitch is nose up positive, roll is right side down positive.

Source: formats of CARLA 0.9.15 (`carla.Rotation`, `carla.Transform`) and of OPV2V, whose poses are lists
[x, y, z, roll, yaw, pitch] in meters and degrees.
"""

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.transforms import make_pose, pose_to_matrix, quaternion_from_ypr, quaternion_to_ypr

_MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])


def carla_point(point: ArrayLike) -> np.ndarray:
    """Return points or vectors [..., 3] of one of our frames in CARLA's, or back."""
    return np.asarray(point, dtype=np.float64) * np.array([1.0, -1.0, 1.0])


def carla_angles(ypr: ArrayLike) -> np.ndarray:
    """Return CARLA's roll, yaw, pitch [deg], shape [..., 3], of our yaw, pitch, roll [rad], shape [..., 3]."""
    yaw, pitch, roll = np.moveaxis(np.degrees(np.asarray(ypr, dtype=np.float64)), -1, 0)
    return np.stack([roll, -yaw, -pitch], axis=-1)


def carla_pose(pose: ArrayLike) -> np.ndarray:
    """Return [x, y, z, roll, yaw, pitch] (m, deg), shape [..., 6], of poses [..., 7]."""
    pose = np.asarray(pose, dtype=np.float64)
    return np.concatenate([carla_point(pose[..., :3]), carla_angles(quaternion_to_ypr(pose[..., 3:]))], axis=-1)


def pose_from_carla(values: ArrayLike) -> np.ndarray:
    """Return poses, shape [..., 7], of [x, y, z, roll, yaw, pitch] (m, deg), shape [..., 6]."""
    values = np.asarray(values, dtype=np.float64)
    roll, yaw, pitch = np.moveaxis(np.radians(values[..., 3:]), -1, 0)
    return make_pose(carla_point(values[..., :3]), quaternion_from_ypr(-yaw, -pitch, roll))


def carla_matrix(pose: ArrayLike) -> np.ndarray:
    """Return homogeneous matrices [..., 4, 4] between CARLA's frames of poses [..., 7] between ours."""
    return _MIRROR @ pose_to_matrix(pose) @ _MIRROR
