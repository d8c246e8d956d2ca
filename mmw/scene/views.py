"""Make tables of views: one pose for each agent that carries a sensor, in each frame of a batch."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from mmw.config import SensorConfig
from mmw.config.agent_keys import Body
from mmw.core.frame_rate import instant_names
from mmw.core.kinematics import Motion
from mmw.core.random_keys import SEPARATOR, stream_keys, stream_name
from mmw.core.remember import remembered
from mmw.core.transforms import cross, pose_from_mount
from mmw.kernels.core import structs
from mmw.scene.bodies import mounted_poses
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import Actor, SceneData

VIEW_TYPES = (wp.int32, wp.transformf, wp.int32)
"""Warp types of the arrays of `structs.Views`, in their order."""


@dataclass(frozen=True)
class Views:
    """The views of one sensor in one batch; rows are ordered by frame, then by actor. A is the number of views."""

    frame: np.ndarray
    """Frame number, shape [A], int64."""
    batch_index: np.ndarray
    """Position of the frame in its batch, shape [A], int32."""
    actor: np.ndarray
    """Index of the agent in `SceneData.actors`, -1 for a view that is fixed in the world, shape [A], int32."""
    pose: np.ndarray
    """Sensor to world, shape [A, 7], float64."""
    ignore_instance: np.ndarray
    """Instance that is invisible to the view, -1 for none, shape [A], int32."""

    def __len__(self) -> int:
        return len(self.frame)

    def take(self, rows: np.ndarray | slice) -> "Views":
        """Return some of the views, given by their rows."""
        return Views(
            self.frame[rows], self.batch_index[rows], self.actor[rows], self.pose[rows], self.ignore_instance[rows]
        )

    def to_device(self, device: str, origin: np.ndarray | None = None) -> structs.Views:
        """Return the views as an argument of kernels.

        Args:
            device: Warp device name.
            origin: World position of the scene frame's origin [m], shape [3] (`DeviceScene.origin`); zero if absent.
        """
        return views_struct([wp.array(value, dtype=kind, device=device) for value, kind in self.values(origin)])

    def values(self, origin: np.ndarray | None = None) -> list[tuple[np.ndarray, Any]]:
        """Return values and types of the fields of `structs.Views`; see `to_device`."""
        pose = self.pose.copy()
        if origin is not None:
            pose[:, :3] -= origin
        return list(zip((self.batch_index, pose.astype(np.float32), self.ignore_instance), VIEW_TYPES, strict=True))

    def write(self, scene: DeviceScene, columns: Sequence[np.ndarray]) -> None:
        """Write the views to the host side of arrays of `VIEW_TYPES`, after the check of `for_scene`.

        Raises:
            ValueError: If a view's frame is not at its index of the batch.
        """
        scene.check_loaded("view", self.batch_index, self.frame)
        batch_index, pose, ignore = columns
        batch_index[:], ignore[:] = self.batch_index, self.ignore_instance
        pose[:, :3], pose[:, 3:] = self.pose[:, :3] - scene.origin, self.pose[:, 3:]

    def for_scene(self, scene: DeviceScene) -> structs.Views:
        """Return the views on the device of a scene, after a check that their frames are loaded.

        Raises:
            ValueError: If a view's frame is not at its index of the batch.
        """
        scene.check_loaded("view", self.batch_index, self.frame)
        return self.to_device(scene.device, scene.origin)


def views_struct(fields: Sequence[wp.array]) -> structs.Views:
    """Return views as an argument of kernels, see `Views.values`."""
    views = structs.Views()
    views.batch_index, views.pose, views.ignore = fields
    return views


def sensor_actors(arrays: SceneData, sensor: SensorConfig) -> np.ndarray:
    """Return the indices of the actors that carry a sensor, in the scene's order, shape [n], int32.

    Where `SceneData.sensing` names agents, only these.
    """
    return _carriers(arrays.actors, sensor, arrays.sensing)


@remembered(owners=2)
def _carriers(actors: tuple[Actor, ...], sensor: SensorConfig, sensing: frozenset[str] | None) -> np.ndarray:
    found = [
        i
        for i, actor in enumerate(actors)
        if (sensing is None or actor.name in sensing) and sensor.is_on(*actor.identity)
    ]
    return np.array(found, dtype=np.int32)


def mount_pose(
    sensor: SensorConfig, role: str, name: str, model: str = "", label: str = "", body: Body | None = None
) -> np.ndarray:
    """Return the sensor-to-actor pose of a sensor on an actor, shape [7]; see `SensorConfig.mount_on`."""
    mount = sensor.mount_on(role, name, model, label, body)
    return pose_from_mount(mount.position_m, mount.yaw_deg, mount.pitch_deg, mount.roll_deg)


@remembered(owners=2)
def actor_mount(actors: tuple[Actor, ...], sensor: SensorConfig, actor: int) -> np.ndarray:
    """Return `mount_pose` of a sensor on one of the actors of a scene, given by its index."""
    return mount_pose(sensor, *actors[actor].identity)


def make_views(arrays: SceneData, frames: Sequence[int], sensor: SensorConfig) -> Views:
    """Return the views of all agents that carry a sensor (`sensor_actors`); see `actor_views`."""
    return actor_views(arrays, frames, sensor, sensor_actors(arrays, sensor))


def actor_views(arrays: SceneData, frames: Sequence[int], sensor: SensorConfig, actors: np.ndarray) -> Views:
    """Return the poses of a sensor on some actors in each frame: pose of the actor x mount.

    As in CARLA, a sensor sees its own vehicle: `ignore_instance` is -1.

    Args:
        arrays: The scene on the host.
        frames: Frames of the batch; frame `frames[b]` has batch index b.
        sensor: Sensor, whose `mount` gives its pose on them.
        actors: Indices of the actors, whether `on` names them or not, shape [n].

    Returns:
        One row for every frame and every one of these actors that is present in that frame.

    Raises:
        ValueError: If the scene does not cover a frame.
    """
    mounts = np.array([actor_mount(arrays.actors, sensor, i) for i in actors.tolist()]).reshape(-1, 7)
    rows = frame_rows(arrays, frames)
    return _views(np.asarray(frames, dtype=np.int64), actors, *mounted_poses(arrays.poses[rows][:, actors], mounts))


def _views(frames: np.ndarray, actors: np.ndarray, pose: np.ndarray, is_present: np.ndarray) -> Views:
    """Return the views of the actors that are there, see `mounted_poses`."""
    batch_index, place = np.nonzero(is_present)
    nobody = np.full(len(place), -1, dtype=np.int32)
    return Views(frames[batch_index], batch_index.astype(np.int32), actors[place], pose[batch_index, place], nobody)


def sample_views(arrays: SceneData, frames: Sequence[int], sensor: SensorConfig) -> Views:
    """Return the views of the frames in which a sensor samples; otherwise as `make_views`."""
    return _due(arrays, make_views(arrays, frames, sensor), sensor)


def _due(arrays: SceneData, views: Views, sensor: SensorConfig) -> Views:
    is_due = sensor.is_due(arrays.numbers(views.frame), arrays.rate_hz)
    return views if is_due.all() else views.take(is_due)


class SensorViews:
    """The views of several sensors in a batch of frames, `sample_views` of each; poses are composed in one go.

    While the same agents are there, all but frames and poses of a sensor's views are the same arrays for every batch.
    """

    def __init__(self, arrays: SceneData, frames: Sequence[int], sensors: tuple[SensorConfig, ...]):
        """Compose the poses of all sensors on all agents.

        Raises:
            ValueError: If the scene does not cover a frame.
        """
        self._arrays, self._frames = arrays, np.asarray(frames, dtype=np.int64)
        self._carried = _all_carried(arrays.actors, sensors, arrays.sensing)
        poses = arrays.poses[frame_rows(arrays, frames)[:, None], self._carried.actors]
        pose, self._is_present = mounted_poses(poses, self._carried.mounts)
        self._pose = pose.reshape(-1, 7)

    def of(self, sensor: SensorConfig) -> Views:
        """Return the views of one of the sensors, or of another one."""
        part = self._carried.parts.get(id(sensor))
        if part is None:
            return sample_views(self._arrays, self._frames.tolist(), sensor)
        is_present = self._is_present[:, part]
        if sensor.period_frames(self._arrays.rate_hz) != 1 or sensor.sample_times_s:
            is_present = is_present & sensor.is_due(self._arrays.numbers(self._frames), self._arrays.rate_hz)[:, None]
        rows = _rows_present(self._carried, part.start, is_present.tobytes(), len(is_present))
        return Views(
            self._frames.take(rows.batch_index),
            rows.batch_index,
            rows.actor,
            self._pose.take(rows.row, axis=0),
            rows.nobody,
        )


@dataclass(frozen=True)
class _Carried:
    """Sensors on their agents, sensor by sensor, n of them."""

    actors: np.ndarray
    """Index of the agent, shape [n], int32."""
    mounts: np.ndarray
    """Sensor to agent, shape [n, 7], float64."""
    parts: dict[int, slice]
    """Identity of the configuration of a sensor -> its part of the n."""


@remembered(owners=2, size=32)
def _all_carried(
    actors: tuple[Actor, ...], sensors: tuple[SensorConfig, ...], sensing: frozenset[str] | None
) -> _Carried:
    carriers = [_carriers(actors, sensor, sensing) for sensor in sensors]
    mounts = [
        actor_mount(actors, sensor, i) for sensor, own in zip(sensors, carriers, strict=True) for i in own.tolist()
    ]
    ends = np.cumsum([0, *map(len, carriers)]).tolist()
    parts = {id(sensor): slice(*ends[k : k + 2]) for k, sensor in enumerate(sensors)}
    return _Carried(np.concatenate([np.zeros(0, np.int32), *carriers]), np.array(mounts).reshape(-1, 7), parts)


@dataclass(frozen=True)
class _PresentRows:
    """Views of a sensor, A of them, in a batch of frames."""

    row: np.ndarray
    """Their rows among all sensors on their agents in all frames, frame by frame, shape [A], int64."""
    batch_index: np.ndarray
    """See `Views`; shape [A], int32."""
    actor: np.ndarray
    """See `Views`; shape [A], int32."""
    nobody: np.ndarray
    """-1 for each, shape [A], int32."""


@remembered(size=1024)
def _rows_present(carried: _Carried, first: int, is_present: bytes, frames: int) -> _PresentRows:
    """Return the views of a sensor.

    Args:
        carried: Sensors on their agents.
        first: The first of the sensor.
        is_present: Which of its agents have a view in each frame, shape [frames, n], bool.
        frames: Frames of the batch.
    """
    batch_index, place = np.nonzero(np.frombuffer(is_present, dtype=bool).reshape(frames, -1))
    row, count = batch_index * len(carried.actors) + place + first, len(place)
    nobody = np.full(count, -1, dtype=np.int32)
    return _PresentRows(row, batch_index.astype(np.int32), carried.actors[place + first], nobody)


FEW_FRAMES = 4
"""Frames below which it is quicker to look at each."""


def frame_rows(arrays: SceneData, frames: Iterable[int] | np.ndarray) -> np.ndarray:
    """Return the rows of `SceneData.poses` that hold some frames, shape [F], int64.

    Raises:
        ValueError: If the scene does not cover a frame.
    """
    frames = frames if isinstance(frames, np.ndarray) else list(frames)
    if len(frames) < FEW_FRAMES:
        return np.array([arrays.frame_row(int(frame)) for frame in frames], dtype=np.int64)
    return arrays.frame_rows(frames)


def join_views(parts: Sequence[Views]) -> Views:
    """Return the views of several sensors in one table, one after the other."""
    columns = zip(*((p.frame, p.batch_index, p.actor, p.pose, p.ignore_instance) for p in parts), strict=True)
    return Views(*(np.concatenate(column) for column in columns))


def view_keys(arrays: SceneData, views: Views, seed: int, *stream: str | int) -> np.ndarray:
    """Return the key of each view's random numbers at its instant, shape [A, 2], uint32.

    Args:
        arrays: The scene on the host, for the names of the agents.
        views: The views.
        seed: Seed of the configuration, see `SceneData.seeds`.
        stream: Other parts of the name of the stream: scenario, weather, sensor.
    """
    names = [arrays.actors[actor].name for actor in views.actor]
    return instant_keys(arrays, views, seed, [stream_name(*stream, name) for name in names])


def instant_keys(arrays: SceneData, views: Views, seed: int, streams: Sequence[str]) -> np.ndarray:
    """Return what `view_keys` does, given the name of each view's stream between seed and instant (`stream_name`)."""
    instants = instant_names(arrays.numbers(views.frame), arrays.rate_hz)
    named = zip(arrays.seeds(views.frame, seed), streams, instants, strict=True)
    return stream_keys([f"{own}{SEPARATOR}{stream}{SEPARATOR}{instant}" for own, stream, instant in named])


def view_twists(arrays: SceneData, motion: Motion, views: Views) -> tuple[np.ndarray, np.ndarray]:
    """Return how each view's sensor moves at the instant of its frame.

    Args:
        arrays: The scene on the host.
        motion: Derivatives of `arrays.poses`, all frames and actors (`differentiate(arrays.poses, arrays.pose_dt)`).
        views: The views.

    Returns:
        Velocity of the sensor's origin in the world frame [m/s], shape [A, 3], and angular velocity about the axes of
        the world frame [rad/s], shape [A, 3], both float64: v + w x (sensor - agent) and w of the agent's body.

    Raises:
        ValueError: If the scene does not cover a frame of the views.
    """
    rows = frame_rows(arrays, views.frame)
    rate = motion.world_rate[rows, views.actor]
    lever_arm = views.pose[:, :3] - arrays.poses[rows, views.actor, :3]
    return motion.velocity[rows, views.actor] + cross(rate, lever_arm), rate
