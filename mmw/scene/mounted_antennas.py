"""Compute where antennas on actors are: position, attitude and velocity in the world."""

from dataclasses import dataclass

import numpy as np

from mmw.config.agent_keys import Body
from mmw.config.antennas import AntennaConfig
from mmw.core.kinematics import Motion, differentiate_rows
from mmw.core.transforms import cross, normalize, pose_from_mount, quaternion_to_matrix
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

    def take(self, rows: np.ndarray | slice) -> "RadioDevices":
        """Return some of them."""
        return RadioDevices(self.position[rows], self.rotation[rows], self.velocity[rows])


def antenna_pose(
    antenna: AntennaConfig, role: str, name: str, model: str = "", label: str = "", body: Body | None = None
) -> np.ndarray:
    """Return the antenna-to-actor pose of an antenna on an actor, shape [7]."""
    mount = antenna.mount_on(role, name, model, label, body)
    return pose_from_mount(mount.position_m, mount.yaw_deg, mount.pitch_deg, mount.roll_deg)


def mounted_antennas(
    arrays: SceneData,
    rows: np.ndarray,
    row: np.ndarray,
    actor: np.ndarray,
    mount: np.ndarray,
    motion: Motion | None = None,
) -> RadioDevices:
    """Return antennas that ride on actors.

    Args:
        arrays: The scene on the host.
        rows: Rows of `arrays.poses` that are looked at, shape [S].
        row: Index into `rows` for each antenna, shape [L].
        actor: Actor of each, present in that frame, shape [L].
        mount: Pose of each in the frame of its actor, shape [L, 7]; or its place alone [m], shape [L, 3], where its
            axes are those of the actor.
        motion: Derivatives of all `poses` of the scene, if they are known.
    """
    motion = differentiate_rows(arrays.poses, rows, arrays.pose_dt, motion)
    pose = arrays.poses[rows[row], actor]
    rotation = quaternion_to_matrix(normalize(pose[:, 3:]))
    lever = rotate(rotation, mount[:, :3])
    own, turned = rotation, np.flatnonzero(mount[:, 3:6].any(axis=1))
    if len(turned):  # others keep the bits of the actor's rotation
        own = rotation.copy()
        own[turned] = rotation[turned] @ quaternion_to_matrix(mount[turned, 3:])
    return RadioDevices(
        position=pose[:, :3] + lever,
        rotation=own,
        velocity=motion.velocity[row, actor] + cross(motion.world_rate[row, actor], lever),
    )
