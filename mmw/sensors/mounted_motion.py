"""Compute how sensors of one configuration move on their agents: all agents at once."""

from dataclasses import dataclass

import numpy as np

from mmw.config import SensorConfig
from mmw.core.kinematics import Motion, differentiate, window
from mmw.core.transforms import compose, normalize
from mmw.scene.scene_data import SceneData
from mmw.scene.views import Views, actor_mount


@dataclass(frozen=True)
class ViewGrid:
    """The frames and agents of some views, and the place of each view among them."""

    frames: np.ndarray
    """Frames, ascending, shape [F], int64."""
    actors: np.ndarray
    """Agents, ascending, shape [A], int32."""
    place: tuple[np.ndarray, np.ndarray]
    """Agent and frame of each view as indices of these, shape [N] each."""


def view_grid(views: Views) -> ViewGrid:
    """Return the frames and agents of some views."""
    frame, actor = views.frame, views.actor
    if len(frame) and (frame == frame[0]).all() and (actor[1:] > actor[:-1]).all():  # of one frame
        return ViewGrid(frame[:1], actor, (np.arange(len(actor)), np.zeros(len(actor), dtype=np.int64)))
    frames, at_frame = np.unique(frame, return_inverse=True)
    actors, of_actor = np.unique(actor, return_inverse=True)
    return ViewGrid(frames, actors, (of_actor, at_frame))


@dataclass(frozen=True)
class MountedMotion:
    """Poses of a sensor on A agents in P consecutive rows of a recording, and their derivatives."""

    pose: np.ndarray
    """Sensor to world, shape [P, A, 7]; NaN where an agent is absent."""
    motion: Motion
    """Derivatives of the poses, shape [P, A, 3]."""
    at: np.ndarray
    """Those of the P rows that were asked for, shape [F]."""


def mounted_motion(
    arrays: SceneData, config: SensorConfig, actors: np.ndarray, rows: np.ndarray, lag: int = 0
) -> MountedMotion:
    """Return how a sensor moves on some agents, bit for bit as if each agent were alone.

    Args:
        arrays: The scene on the host.
        config: The sensor.
        actors: Indices of the agents, shape [A].
        rows: Rows of `SceneData.poses`, shape [F].
        lag: Rows before these that count too.
    """
    part = window(np.concatenate([rows, np.maximum(rows - lag, 0)]) if lag else rows)
    poses = arrays.poses[part][:, actors]
    mounts = np.array([actor_mount(arrays.actors, config, i) for i in actors.tolist()]).reshape(-1, 7)
    sensor = compose(np.concatenate([poses[..., :3], normalize(poses[..., 3:])], axis=-1), mounts)
    return MountedMotion(sensor, differentiate(sensor, arrays.pose_dt), rows - part.start)
