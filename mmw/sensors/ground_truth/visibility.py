"""Find what agents see: returns, detections and pixels on each actor, and lines of sight between them."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.config.antennas import AntennaConfig
from mmw.core.packed_arrays import borrow_arrays, padded_count
from mmw.core.remember import remembered
from mmw.core.repeated_launch import launch_again
from mmw.kernels.core import line_of_sight as sight
from mmw.scene.bodies import points_on
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import Actor
from mmw.scene.views import frame_rows
from mmw.sensors.ground_truth.boxes_3d import BOX_ROLES
from mmw.sensors.ray_batch import BLOCK_DIM


@remembered()
def boxed_actors(scene_actors: Sequence) -> np.ndarray:
    """Return the indices of the actors that have a box, in the scene's order, shape [K], int32."""
    return np.array([i for i, actor in enumerate(scene_actors) if actor.role in BOX_ROLES], dtype=np.int32)


@remembered()
def object_ids(scene_actors: Sequence) -> np.ndarray:
    """Return the object ids of all actors, shape [V], int32."""
    return np.array([actor.object_id for actor in scene_actors], dtype=np.int32)


def count_returns(offsets: np.ndarray, object_id: np.ndarray, wanted: Sequence[int]) -> np.ndarray:
    """Return how many points of each view lie on each wanted object, shape [A, K], int32.

    Args:
        offsets: First point of every view, and the number of points, shape [A + 1].
        object_id: Object of every point, -1 for none, shape [N].
        wanted: K different object ids.
    """
    shape = len(offsets) - 1, len(wanted)
    highest = max(int(object_id.max(initial=-1)), *wanted, -1)
    column_of = np.full(highest + 2, -1, dtype=np.int32)  # the last place is that of -1
    column_of[np.asarray(wanted, dtype=np.int64)] = np.arange(len(wanted))
    found = np.flatnonzero((column_of >= 0)[object_id])  # few: most points lie on the town
    view = np.repeat(np.arange(shape[0]), np.diff(np.searchsorted(found, offsets)))
    counts = np.bincount(view * shape[1] + column_of[object_id[found]], minlength=shape[0] * shape[1])
    return counts.reshape(shape).astype(np.int32)


@dataclass(frozen=True)
class LineOfSight:
    """Lines of sight from agents to boxed actors; rows are ordered by frame, agent and actor. L is their number."""

    frame: np.ndarray
    """Frame number, shape [L], int64."""
    agent: np.ndarray
    """Actor index of the agent, shape [L], int32."""
    actor: np.ndarray
    """Actor index of the other one, shape [L], int32."""
    is_los: np.ndarray
    """True if the line of sight is unobstructed: its first hit is the actor itself, or nothing. Shape [L], bool."""
    blocker: np.ndarray
    """Object id of the first obstacle on the line of sight, -1 where there is none, shape [L], int32."""


def start_sight(
    scene: DeviceScene,
    frames: Sequence[int],
    antenna: AntennaConfig,
    due: np.ndarray | None = None,
) -> Callable[[], LineOfSight]:
    """Trace whether an antenna of each agent sees the middle of each boxed actor, and the first obstacle between them.

    The agent's own body is passed through, so that a low roof does not hide what drives beside it.

    Args:
        scene: Town and vehicles, with the frames loaded.
        frames: Frames of the batch.
        antenna: The antenna; agents that do not carry it have no row.
        due: Frames that are looked at, shape of `frames`, bool; None for all of them.

    Returns:
        Waits for the device and returns the lines; to be called once. The host may do other work before.
    """
    arrays, rows = scene.arrays, frame_rows(scene.arrays, frames)
    poses = arrays.poses[rows]
    is_here = np.asarray(np.isfinite(poses).all(axis=2))
    if due is not None:
        is_here &= due[:, None]
    lines = _lines(arrays.actors, antenna, scene.instance_actor, is_here.tobytes())
    at = np.concatenate([lines.batch_index, lines.batch_index])
    points = points_on(poses[at, lines.end], lines.place)
    count = len(lines.actor)
    found = start_lines(scene, lines.batch_index, points[:count], points[count:], lines.ignore)

    def wait() -> LineOfSight:
        first = found()
        is_los = (first < 0) | (first == lines.own)
        frame = np.asarray(frames, dtype=np.int64)[lines.batch_index]
        return LineOfSight(frame, lines.agent, lines.actor, is_los, np.where(is_los, -1, first).astype(np.int32))

    return wait


@dataclass(frozen=True)
class _Lines:
    """The lines of sight of an antenna in some frames, L of them."""

    batch_index: np.ndarray
    """Place of the frame among the frames, shape [L]."""
    agent: np.ndarray
    """Actor index of the agent, shape [L], int32."""
    actor: np.ndarray
    """Actor index of the other one, shape [L], int32."""
    end: np.ndarray
    """Actors at the ends of the lines: those of `agent`, then of `actor`, shape [2 L]."""
    place: np.ndarray
    """Ends in the frames of these: places of antennas, then middles of boxes [m], shape [2 L, 3]."""
    ignore: np.ndarray
    """Instance of the agent, -1 for none, shape [L], int32."""
    own: np.ndarray
    """Object id of the other actor, shape [L], int32."""


@remembered(owners=3)
def _lines(actors: tuple[Actor, ...], antenna: AntennaConfig, instance_actor: np.ndarray, is_here: bytes) -> _Lines:
    """Return the lines of frames in which some actors are present, [F, V], bool, as bytes."""
    names = [actor.identity for actor in actors]
    agents = np.array([i for i, name in enumerate(names) if antenna.is_on(*name)], dtype=np.int32)
    all_agents, all_actors = (grid.ravel() for grid in np.meshgrid(agents, boxed_actors(actors), indexing="ij"))
    others = all_agents != all_actors
    all_agents, all_actors = all_agents[others], all_actors[others]
    present = np.frombuffer(is_here, dtype=bool).reshape(-1, len(actors))
    batch_index, line = np.nonzero(present[:, all_agents] & present[:, all_actors])
    agent, actor = all_agents[line], all_actors[line]
    place = np.array([antenna.mount_on(*name).position_m for name in names]).reshape(-1, 3)
    middle = np.array([one.center for one in actors]).reshape(-1, 3)
    instance_of = np.full(len(actors), -1, dtype=np.int32)
    instance_of[instance_actor] = np.arange(len(instance_actor))
    return _Lines(
        batch_index, agent, actor, np.concatenate([agent, actor]), np.concatenate([place[agent], middle[actor]]),
        instance_of[agent], object_ids(actors)[actor],
    )  # fmt: skip


def start_lines(
    scene: DeviceScene, batch_index: np.ndarray, start: np.ndarray, end: np.ndarray, ignore: np.ndarray
) -> Callable[[], np.ndarray]:
    """Trace the first object on each line.

    Args:
        scene: Town and vehicles, with a batch loaded.
        batch_index: Position of each line's frame in the batch, shape [L].
        start: World frame [m], shape [L, 3].
        end: World frame [m], shape [L, 3].
        ignore: Instance that each line passes through, -1 for none, shape [L].

    Returns:
        Waits for the device and returns the objects, -1 for a free line, shape [L], int32; to be called once.
    """
    count, room = len(batch_index), padded_count(len(batch_index))
    numbers, ends = ((room,), wp.int32), ((room,), wp.vec3)
    block = borrow_arrays(scene.device, numbers, ends, ends, numbers, numbers)
    frames, starts, stops, passed, _ = block.host
    frames[:count], passed[:count] = batch_index, ignore
    starts[:count], stops[:count] = start - scene.origin, end - scene.origin
    *inputs, out = block.upload()
    launch_again(sight.line_of_sight_kernel, (count,), [scene.struct, *inputs, out], scene.device, BLOCK_DIM)

    def wait() -> np.ndarray:
        found = block.download()[-1][:count].copy()
        block.release()
        return found

    return wait
