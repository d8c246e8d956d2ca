"""Compute the 3-D box of every vehicle, person and drone in every frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.config.agent_keys import AGENT_ROLES
from mmw.core.kinematics import Motion, differentiate
from mmw.core.packed_arrays import borrow_arrays
from mmw.core.remember import remembered
from mmw.core.repeated_launch import launch_again
from mmw.kernels.core.bodies import boxes_kernel
from mmw.scene.scene_data import Actor, SceneData
from mmw.scene.table_rows import Columns, actor_texts, split
from mmw.scene.views import frame_rows
from mmw.storage.name_column import NameColumn, name_column

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
    """Middle of the box in the actor's frame [m], shape [K, 3]."""
    size: np.ndarray
    """Length, width, height [m], shape [K, 3]."""


@remembered()
def boxed(actors: tuple[Actor, ...]) -> BoxedActors:
    """Return the actors that have a box."""
    own = [(i, actor) for i, actor in enumerate(actors) if actor.role in BOX_ROLES]
    return BoxedActors(
        np.array([i for i, _ in own], dtype=np.int32),
        np.array([actor.object_id for _, actor in own], dtype=np.int32),
        np.array([actor.center for _, actor in own], dtype=np.float64).reshape(-1, 3),
        np.array([actor.size for _, actor in own], dtype=np.float64).reshape(-1, 3),
    )


def make_boxes(arrays: SceneData, frames: Sequence[int], motion: Motion | None = None) -> Boxes:
    """Return the boxes of all vehicles, people and drones that are present.

    Raises:
        ValueError: If the scene does not cover a frame.
    """
    if motion is None:
        motion = differentiate(arrays.poses, arrays.pose_dt)
    rows = frame_rows(arrays, frames)
    is_here = np.isfinite(arrays.poses[rows[:, None], boxed(arrays.actors).actor]).all(axis=-1)
    found = _present(arrays.actors, is_here.tobytes())
    row, actor, count = rows[found.batch_index], found.actor, len(found.actor)
    vectors = ((count,), wp.vec3d)
    block = borrow_arrays("cpu", ((count, 7), wp.float64), vectors, vectors, vectors, ((13, count), wp.float64))
    given = arrays.poses[row, actor], motion.velocity[row, actor], motion.world_rate[row, actor], found.middle
    for held, values in zip(block.host, given, strict=False):
        held[:] = values
    launch_again(boxes_kernel, (count,), block.arrays, "cpu")
    made = block.host[-1].copy()
    block.release()
    frame = np.asarray(frames, dtype=np.int64)[found.batch_index]
    return Boxes(frame, actor, found.object_id, made[:7].T, made[7:10].T, found.size, made[10:].T)


@dataclass(frozen=True)
class _Present(BoxedActors):
    """The actors that have a box in some frames, frame by frame."""

    batch_index: np.ndarray
    """Place of the frame among the frames, shape [K]."""


@remembered()
def _present(actors: tuple[Actor, ...], is_here: bytes) -> _Present:
    """Return the boxed actors of frames in which some of them are present, [F, K], bool, as bytes."""
    found = boxed(actors)
    at, place = np.nonzero(np.frombuffer(is_here, dtype=bool).reshape(-1, max(len(found.actor), 1)))
    return _Present(found.actor[place], found.object_id[place], found.middle[place], found.size[place], at)


def box_rows(arrays: SceneData, boxes: Boxes) -> Columns:
    """Return the `boxes` table: every vehicle, person and drone that is present."""
    return {
        "frame": boxes.frame.astype(np.int32),
        "object_id": boxes.object_id,
        "category": actor_texts(arrays.actors, "label")[boxes.actor],
        "agent": _agent_names(arrays.actors)[boxes.actor],
        **split(("x", "y", "z"), boxes.pose[:, :3]),
        **split(("yaw", "pitch", "roll"), boxes.ypr),
        **split(("length", "width", "height"), boxes.size),
        **split(("vx", "vy", "vz"), boxes.velocity),
    }


@remembered()
def _agent_names(actors: tuple[Actor, ...]) -> NameColumn:
    """Return the names of the actors that are agents, null for others."""
    return name_column([actor.name if actor.role in AGENT_ROLES else None for actor in actors])
