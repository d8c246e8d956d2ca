"""Compute where antennas on actors are: position, attitude and velocity in the world."""

from dataclasses import dataclass

import numpy as np

from mmw.config.agent_keys import Body
from mmw.config.antennas import AntennaConfig
from mmw.core.host_kernels import run_on_host
from mmw.core.kinematics import Motion, motion_at
from mmw.core.transforms import pose_from_mount, quaternion_to_matrix
from mmw.kernels.core.mounted_antennas import mounted_antennas_kernel
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


@dataclass(frozen=True)
class Mounts:
    """Places of antennas on their actors."""

    place: np.ndarray
    """In the frame of the actor [m], shape [L, 3]."""
    turned: np.ndarray
    """Antennas whose axes are not those of the actor, shape [T]."""
    rotation: np.ndarray
    """Antenna-to-actor rotations of these, shape [T, 3, 3]."""


def mounts_at(mount: np.ndarray) -> Mounts:
    """Return the mounts of poses in the frames of actors, shape [L, 7]; or of places alone [m], shape [L, 3]."""
    turned = np.flatnonzero(mount[:, 3:6].any(axis=1))
    rotation = quaternion_to_matrix(mount[turned, 3:]) if len(turned) else np.zeros((0, 3, 3))
    return Mounts(mount[:, :3], turned, rotation)


def mounted_antennas(
    arrays: SceneData,
    rows: np.ndarray,
    row: np.ndarray,
    actor: np.ndarray,
    mounts: Mounts,
    motion: Motion | None = None,
) -> RadioDevices:
    """Return antennas that ride on actors.

    Args:
        arrays: The scene on the host.
        rows: Rows of `arrays.poses` that are looked at, shape [S].
        row: Index into `rows` for each antenna, shape [L].
        actor: Actor of each, present in that frame, shape [L].
        mounts: Where each is on its actor.
        motion: Derivatives of all `poses` of the scene, if they are known.
    """
    motion, at, part = motion_at(arrays.poses, rows, arrays.pose_dt, motion)
    body = at.take(row) * arrays.poses.shape[1] + actor
    moving = (arrays.poses[part], 7), (motion.velocity, 3), (motion.world_rate, 3)
    given = *(values.reshape(-1, size).take(body, axis=0) for values, size in moving), mounts.place
    count = (len(actor),)
    position, rotation, velocity = run_on_host(mounted_antennas_kernel, count, given, (), (count, count, count))
    if len(mounts.turned):  # others keep the bits of the actor's rotation
        rotation[mounts.turned] = rotation[mounts.turned] @ mounts.rotation
    return RadioDevices(position, rotation, velocity)
