"""Compute the 3-D box of every vehicle, person and drone in every frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmw.config.agent_keys import AGENT_ROLES
from mmw.core.kinematics import Motion, differentiate
from mmw.core.transforms import compose, make_pose, normalize, quaternion_to_ypr, rotate
from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns, choices, split

BOX_ROLES = ("cav", "vehicle", "pedestrian", "vru", "uav")
"""Actors that have a box."""


@dataclass(frozen=True)
class Boxes:
    """Boxes in the world frame; rows are ordered by frame, then by actor. N is the number of boxes."""

    frame: np.ndarray
    """Frame number, shape [N], int64."""
    actor: np.ndarray
    """Index in `SceneData.actors`, shape [N], int32."""
    object_id: np.ndarray
    """Object id, shape [N], int32."""
    pose: np.ndarray
    """Box to world, origin in the middle of the box, axes along length, width, height, shape [N, 7], float64."""
    ypr: np.ndarray
    """Yaw, pitch (nose down positive) and roll [rad], R = Rz Ry Rx, shape [N, 3]."""
    size: np.ndarray
    """Length, width, height [m], shape [N, 3]."""
    velocity: np.ndarray
    """Velocity of the middle of the box, world frame [m/s], shape [N, 3]."""


def make_boxes(arrays: SceneData, frames: Sequence[int], motion: Motion | None = None) -> Boxes:
    """Return the boxes of all vehicles, people and drones that are present.

    Raises:
        ValueError: If the scene does not cover a frame.
    """
    rows = np.array([arrays.frame_row(int(frame)) for frame in frames], dtype=np.int64)
    if motion is None:
        motion = differentiate(arrays.poses, arrays.pose_dt)
    actors = np.array([i for i, actor in enumerate(arrays.actors) if actor.role in BOX_ROLES], dtype=np.int32)
    frame = np.repeat(np.asarray(frames, dtype=np.int64), len(actors))
    row, actor = np.repeat(rows, len(actors)), np.tile(actors, len(rows))
    is_present = np.isfinite(arrays.poses[row, actor]).all(axis=1)
    frame, row, actor = frame[is_present], row[is_present], actor[is_present]

    pose = arrays.poses[row, actor]
    q = normalize(pose[:, 3:])
    center = np.array([arrays.actors[i].center for i in actor], dtype=np.float64).reshape(-1, 3)
    upright = np.array([0.0, 0.0, 0.0, 1.0])
    return Boxes(
        frame=frame,
        actor=actor,
        object_id=np.array([arrays.actors[i].object_id for i in actor], dtype=np.int32),
        pose=compose(make_pose(pose[:, :3], q), make_pose(center, upright)),
        ypr=quaternion_to_ypr(q),
        size=np.array([arrays.actors[i].size for i in actor], dtype=np.float64).reshape(-1, 3),
        velocity=motion.velocity[row, actor] + np.cross(motion.world_rate[row, actor], rotate(q, center)),
    )


def box_rows(arrays: SceneData, boxes: Boxes) -> Columns:
    """Return the `boxes` table: every vehicle, person and drone that is present."""
    agents = [a.name if a.role in AGENT_ROLES else None for a in arrays.actors]
    return {
        "frame": boxes.frame.astype(np.int32),
        "object_id": boxes.object_id,
        "category": choices([a.label for a in arrays.actors], boxes.actor),
        "agent": choices(agents, boxes.actor),
        **split(("x", "y", "z"), boxes.pose[:, :3]),
        **split(("yaw", "pitch", "roll"), boxes.ypr),
        **split(("length", "width", "height"), boxes.size),
        **split(("vx", "vy", "vz"), boxes.velocity),
    }
