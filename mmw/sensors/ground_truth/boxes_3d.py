"""Compute the 3-D box of every vehicle, person and drone in every frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmw.config.agent_keys import AGENT_ROLES
from mmw.core.kinematics import Motion, differentiate
from mmw.core.remember import remembered
from mmw.core.transforms import compose, cross, make_pose, normalize, quaternion_to_ypr, rotate
from mmw.scene.scene_data import Actor, SceneData
from mmw.scene.table_rows import ActorTexts, Columns, actor_texts, encoded_texts, split, texts_of
from mmw.scene.views import frame_rows

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


@dataclass(frozen=True)
class BoxedActors:
    """The actors that have a box, in the scene's order, K of them."""

    actor: np.ndarray
    """Index in `SceneData.actors`, shape [K], int32."""
    object_id: np.ndarray
    """Object id, shape [K], int32."""
    middle: np.ndarray
    """Box to actor, origin in the middle of the box, shape [K, 7], float64."""
    size: np.ndarray
    """Length, width, height [m], shape [K, 3]."""


@remembered()
def boxed(actors: tuple[Actor, ...]) -> BoxedActors:
    """Return the actors that have a box."""
    own = [(i, actor) for i, actor in enumerate(actors) if actor.role in BOX_ROLES]
    return BoxedActors(
        np.array([i for i, _ in own], dtype=np.int32),
        np.array([actor.object_id for _, actor in own], dtype=np.int32),
        make_pose(np.array([actor.center for _, actor in own], dtype=np.float64).reshape(-1, 3), (0.0, 0.0, 0.0, 1.0)),
        np.array([actor.size for _, actor in own], dtype=np.float64).reshape(-1, 3),
    )


def make_boxes(arrays: SceneData, frames: Sequence[int], motion: Motion | None = None) -> Boxes:
    """Return the boxes of all vehicles, people and drones that are present.

    Raises:
        ValueError: If the scene does not cover a frame.
    """
    if motion is None:
        motion = differentiate(arrays.poses, arrays.pose_dt)
    found, rows = boxed(arrays.actors), frame_rows(arrays, frames)
    at, place = np.nonzero(np.isfinite(arrays.poses[rows][:, found.actor]).all(axis=-1))
    row, actor = rows[at], found.actor[place]
    pose = arrays.poses[row, actor]
    q = normalize(pose[:, 3:])
    middle = found.middle[place]
    return Boxes(
        frame=np.asarray(frames, dtype=np.int64)[at],
        actor=actor,
        object_id=found.object_id[place],
        pose=compose(make_pose(pose[:, :3], q), middle),
        ypr=quaternion_to_ypr(q),
        size=found.size[place],
        velocity=motion.velocity[row, actor] + cross(motion.world_rate[row, actor], rotate(q, middle[:, :3])),
    )


def box_rows(arrays: SceneData, boxes: Boxes) -> Columns:
    """Return the `boxes` table: every vehicle, person and drone that is present."""
    return {
        "frame": boxes.frame.astype(np.int32),
        "object_id": boxes.object_id,
        "category": texts_of(actor_texts(arrays.actors, "label"), boxes.actor),
        "agent": texts_of(_agent_names(arrays.actors), boxes.actor),
        **split(("x", "y", "z"), boxes.pose[:, :3]),
        **split(("yaw", "pitch", "roll"), boxes.ypr),
        **split(("length", "width", "height"), boxes.size),
        **split(("vx", "vy", "vz"), boxes.velocity),
    }


@remembered()
def _agent_names(actors: tuple[Actor, ...]) -> ActorTexts:
    """Return the names of the actors that are agents, null for others."""
    return encoded_texts([actor.name if actor.role in AGENT_ROLES else None for actor in actors])
