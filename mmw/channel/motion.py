"""Velocities of actors: what Doppler is made of. The same derivatives that the IMU and the pose table use."""

import numpy as np

from mmw.constants import FRAME_DT
from mmw.scene_arrays import SceneArrays
from mmw.sensors.kinematics import differentiate

REACH_FRAMES = 4
"""Most frames on either side that the derivatives of a frame depend on: the extrapolation at the ends takes four."""


def actor_rates(arrays: SceneArrays, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return velocity and angular velocity of every actor.

    Args:
        arrays: The scene on the host.
        rows: Rows of `arrays.poses`, shape [S].

    Returns:
        Velocity [m/s] and angular velocity [rad/s], world frame, each of shape [S, V, 3]; NaN where absent.
    """
    if len(rows) == 0:
        return np.zeros((0, len(arrays.actors), 3)), np.zeros((0, len(arrays.actors), 3))
    begin = max(int(rows.min()) - REACH_FRAMES, 0)
    window = arrays.poses[begin : int(rows.max()) + REACH_FRAMES + 1]
    motion = differentiate(window, FRAME_DT * arrays.frames.step)
    return motion.velocity[rows - begin], motion.world_rate[rows - begin]
