"""Make the samples of sensors that move with agents and measure their own motion: all agents and frames at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from mmw.config import SensorConfig
from mmw.core.frame_rate import instants
from mmw.core.kinematics import REACH_FRAMES
from mmw.core.packed_arrays import borrow_arrays
from mmw.core.random_keys import random_keys
from mmw.core.remember import remembered
from mmw.core.repeated_launch import launch_again
from mmw.kernels.navigation import mounted as kernels
from mmw.scene.scene_data import Actor, SceneData
from mmw.scene.views import Views, actor_mount, frame_rows


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
    frames, at_frame = np.unique(views.frame, return_inverse=True)
    actors, of_actor = np.unique(views.actor, return_inverse=True)
    return ViewGrid(frames, actors, (of_actor, at_frame))


def agent_names(arrays: SceneData, actors: np.ndarray) -> tuple[str, ...]:
    """Return the names of actors given by their indices."""
    return tuple(arrays.actors[index].name for index in actors.tolist())


@remembered()
def series_keys(config: SensorConfig, seed: int, scenario: str, agents: tuple[str, ...], kind: str) -> np.ndarray:
    """Return the keys of one kind of random series of a sensor on some agents, shape [A, 2], uint32."""
    return random_keys((seed, scenario, agent, config.name, kind) for agent in agents)


def mounted_samples(
    kernel: wp.Kernel,
    arrays: SceneData,
    views: Views,
    config: SensorConfig,
    stream: tuple[int, str],
    arguments: Sequence[Any],
    columns: int,
    lag: int = 0,
) -> np.ndarray:
    """Return what a kernel measures in some views, shape [columns, N], float64.

    A sample depends on no other and not on which ones are asked for.

    Args:
        kernel: Takes samples, mounted sensors, `arguments` and what it fills (`mmw.kernels.navigation.mounted`).
        arrays: The scene on the host.
        views: The views.
        config: The sensor.
        stream: Seed and scenario of its noise.
        arguments: Further arguments.
        columns: Numbers of a sample.
        lag: Rows of poses before a sample's that count too.

    Raises:
        ValueError: If the scene does not cover a frame.
    """
    rows, times = frame_rows(arrays, views.frame), instants(views.frame, arrays.rate_hz)
    mounted = _mounted(arrays.actors, config, views.actor.tobytes(), *stream, arrays.pose_dt)
    return sampled(kernel, arrays.poses, rows, times, mounted, arguments, columns, lag)


def sampled(
    kernel: wp.Kernel,
    poses: np.ndarray,
    rows: np.ndarray,
    times: tuple[np.ndarray, np.ndarray],
    mounted: kernels.Mounted,
    arguments: Sequence[Any],
    columns: int,
    lag: int = 0,
) -> np.ndarray:
    """Return what a kernel measures in some rows of poses, shape [columns, N]; see `mounted_samples`.

    Args:
        kernel: As `mounted_samples`.
        poses: Actors to world in consecutive rows, shape [P, V, 7].
        rows: Row of each sample, shape [N].
        times: Frame of 100 Hz and milliseconds since then of each sample, see `instants`.
        mounted: The sensor of each sample.
        arguments: As `mounted_samples`.
        columns: As `mounted_samples`.
        lag: As `mounted_samples`.
    """
    count = len(rows)
    first = max(int(rows.min(initial=len(poses))) - REACH_FRAMES - lag, 0)
    around = poses[first : int(rows.max(initial=0)) + REACH_FRAMES + 1]
    numbers = ((count,), wp.int32)
    block = borrow_arrays("cpu", (around.shape, wp.float64), numbers, numbers, numbers, ((columns, count), wp.float64))
    held, row, frame, part, values = block.host
    held[:], row[:], frame[:], part[:] = around, rows - first, *times
    samples = block.struct(kernels.Samples, "poses", "row", "frame", "part", None)
    launch_again(kernel, (count,), [samples, mounted, *arguments, block.arrays[-1]], "cpu")
    made = values.copy()
    block.release()
    return made


@remembered(owners=2)
def _mounted(
    actors: tuple[Actor, ...], config: SensorConfig, index: bytes, seed: int, scenario: str, dt: float
) -> kernels.Mounted:
    """Return a sensor on the actors of some views, whose indices are given as bytes."""
    own = np.frombuffer(index, dtype=np.int32)
    mounts = np.array([actor_mount(actors, config, i) for i in own.tolist()]).reshape(-1, 7)
    keys = series_keys(config, seed, scenario, tuple(actors[i].name for i in own.tolist()), "white")
    return mounted_sensors(own, mounts, keys, dt)


def mounted_sensors(actor: np.ndarray, mount: np.ndarray, key: np.ndarray, dt: float) -> kernels.Mounted:
    """Return the sensors of some samples as an argument of kernels.

    Args:
        actor: Actor that carries the sensor of each sample, shape [N].
        mount: Sensor to actor, shape [N, 7].
        key: Key of its white noise, shape [N, 2], uint32.
        dt: Time between rows of poses [s].
    """
    out = kernels.Mounted()
    out.actor = wp.array(actor, dtype=int, device="cpu")
    out.position = wp.array(mount[:, :3], dtype=wp.vec3d, device="cpu")
    out.attitude = wp.array(mount[:, 3:], dtype=wp.vec4d, device="cpu")
    out.key = wp.array(key, dtype=wp.vec2ui, device="cpu")
    out.dt = dt
    return out
