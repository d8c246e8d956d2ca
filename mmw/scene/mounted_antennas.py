"""Compute where antennas on actors are: position, attitude and velocity in the world."""

from dataclasses import dataclass

import numpy as np

from mmw.core.kinematics import differentiate_rows
from mmw.core.transforms import normalize, quaternion_to_matrix
from mmw.physics.em.vectors import rotate
from mmw.scene.scene_data import SceneData


@dataclass(frozen=True)
class RadioDevices:
    """Antennas in the world frame: one side of every link, or those of a list."""

    position: np.ndarray
    """Phase center of the antenna [m], shape [L, 3], float64."""
    rotation: np.ndarray
    """Antenna-to-world rotation, shape [L, 3, 3], float64."""
    velocity: np.ndarray
    """Velocity of the antenna [m/s], shape [L, 3], float64."""

    def take(self, rows: np.ndarray) -> "RadioDevices":
        """Return some of them."""
        return RadioDevices(self.position[rows], self.rotation[rows], self.velocity[rows])


def mounted_antennas(
    arrays: SceneData, rows: np.ndarray, row: np.ndarray, actor: np.ndarray, mount: np.ndarray
) -> RadioDevices:
    """Return antennas that ride on actors; their axes are those of the actors.

    Args:
        arrays: The scene on the host.
        rows: Rows of `arrays.poses` that are looked at, shape [S].
        row: Index into `rows` for each antenna, shape [L].
        actor: Actor of each, present in that frame, shape [L].
        mount: Place of each in the frame of its actor [m], shape [L, 3].
    """
    poses, motion = arrays.poses[rows], differentiate_rows(arrays.poses, rows, arrays.pose_dt)
    rotation = quaternion_to_matrix(normalize(poses[row, actor, 3:]))
    lever = rotate(rotation, mount)
    return RadioDevices(
        position=poses[row, actor, :3] + lever,
        rotation=rotation,
        velocity=motion.velocity[row, actor] + np.cross(motion.world_rate[row, actor], lever),
    )
