"""Motion of sensors while they sweep: velocity and angular rate of each view."""

import numpy as np

from mmw.core.kinematics import Motion
from mmw.scene.scene_data import SceneData
from mmw.scene.views import Views


def view_twists(arrays: SceneData, motion: Motion, views: Views) -> tuple[np.ndarray, np.ndarray]:
    """Return how each view's sensor moves at the instant of its frame.

    Args:
        arrays: The scene on the host.
        motion: Derivatives of `arrays.poses`, all frames and actors (`differentiate(arrays.poses)`).
        views: The views.

    Returns:
        Velocity of the sensor's origin in the world frame [m/s], shape [A, 3], and angular velocity about the axes of
        the world frame [rad/s], shape [A, 3], both float64: v + w x (sensor - agent) and w of the agent's body.

    Raises:
        ValueError: If the scene does not cover a frame of the views.
    """
    rows = np.array([arrays.frame_row(int(frame)) for frame in views.frame], dtype=np.int64)
    rate = motion.world_rate[rows, views.actor]
    lever_arm = views.pose[:, :3] - arrays.poses[rows, views.actor, :3]
    return motion.velocity[rows, views.actor] + np.cross(rate, lever_arm), rate
