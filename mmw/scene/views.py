"""Sensors x frames -> view tables: which sensor of which agent looks from where, in which frame."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.config import SensorConfig
from mmw.core.random_keys import random_keys
from mmw.core.transforms import compose, normalize, pose_from_mount
from mmw.kernels.core import structs
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData


@dataclass(frozen=True)
class Views:
    """The views of one sensor in one batch; rows are ordered by frame, then by actor. A is the number of views."""

    frame: np.ndarray
    """Frame number, shape [A], int64."""
    slot: np.ndarray
    """Position of the frame in its batch, shape [A], int32."""
    actor: np.ndarray
    """Index of the agent in `SceneData.actors`, -1 for a view that nobody carries and that stands still, shape [A],
    int32."""
    pose: np.ndarray
    """Sensor to world, shape [A, 7], float64."""
    ignore: np.ndarray
    """Instance that the view does not see, -1 for none, shape [A], int32."""

    def __len__(self) -> int:
        return len(self.frame)

    def take(self, rows: np.ndarray | slice) -> "Views":
        """Return some of the views, given by their rows."""
        return Views(self.frame[rows], self.slot[rows], self.actor[rows], self.pose[rows], self.ignore[rows])

    def to_device(self, device: str, origin: np.ndarray | None = None) -> structs.Views:
        """Return the views as kernels take them.

        Args:
            device: Warp device name.
            origin: World position of the scene frame's origin [m], shape [3] (`DeviceScene.origin`); zero if absent.
        """
        pose = self.pose.copy()
        if origin is not None:
            pose[:, :3] -= origin
        views = structs.Views()
        views.slot = wp.array(self.slot, dtype=wp.int32, device=device)
        views.pose = wp.array(pose.astype(np.float32), dtype=wp.transformf, device=device)
        views.ignore = wp.array(self.ignore, dtype=wp.int32, device=device)
        return views

    def for_scene(self, scene: DeviceScene) -> structs.Views:
        """Return the views on the device of a scene, after a check that the scene holds their frames.

        Raises:
            ValueError: If a view's frame is not in its slot of the scene.
        """
        loaded = np.asarray(scene.batch_frames, dtype=np.int64)
        is_loaded = (self.slot >= 0) & (self.slot < len(loaded))
        is_loaded[is_loaded] = loaded[self.slot[is_loaded]] == self.frame[is_loaded]
        if not is_loaded.all():
            row = int(np.argmin(is_loaded))
            raise ValueError(
                f"view {row}: frame {self.frame[row]} in slot {self.slot[row]}; the scene holds frames "
                f"{list(scene.batch_frames[:8])}; call load_batch with the frames that the views were made for"
            )
        return self.to_device(scene.device, scene.origin)


def sensor_actors(arrays: SceneData, sensor: SensorConfig) -> np.ndarray:
    """Return the indices of the actors that carry a sensor, in the scene's order, shape [n], int32.

    Where `SceneData.sensing` names agents, only these.
    """
    found = [
        i
        for i, actor in enumerate(arrays.actors)
        if actor.role in sensor.on and (arrays.sensing is None or actor.name in arrays.sensing)
    ]
    return np.array(found, dtype=np.int32)


def mount_pose(sensor: SensorConfig, role: str) -> np.ndarray:
    """Return the sensor-to-agent pose of a sensor on agents of a role (`cav` or `rsu`), shape [7]."""
    mount = sensor.mount_on(role)
    return pose_from_mount(mount.position_m, mount.yaw_deg, mount.pitch_deg, mount.roll_deg)


def make_views(arrays: SceneData, frames: Sequence[int], sensor: SensorConfig) -> Views:
    """Return where a sensor is in each frame: pose of its agent x mount.

    Nothing is ignored: like CARLA's, a sensor sees its own vehicle, so a ray that starts above a roof may end on it.

    Args:
        arrays: The scene on the host.
        frames: Frames of the batch; frame `frames[s]` is in slot s.
        sensor: Its `on` and `mount` decide who carries it and where.

    Returns:
        One row for every frame and every agent that carries the sensor and is present in that frame.

    Raises:
        ValueError: If the scene does not cover a frame.
    """
    actors = sensor_actors(arrays, sensor)
    rows = np.array([arrays.frame_row(int(frame)) for frame in frames], dtype=np.int64)
    frame = np.repeat(np.asarray(frames, dtype=np.int64), len(actors))
    slot = np.repeat(np.arange(len(rows), dtype=np.int32), len(actors))
    actor = np.tile(actors, len(rows))
    pose = arrays.poses[rows][:, actors].reshape(-1, 7)
    is_present = np.isfinite(pose).all(axis=1)
    frame, slot, actor, pose = frame[is_present], slot[is_present], actor[is_present], pose[is_present]
    mounts = {role: mount_pose(sensor, role) for role in sensor.on}
    mount = np.array([mounts[arrays.actors[i].role] for i in actor]).reshape(-1, 7)
    pose = np.concatenate([pose[:, :3], normalize(pose[:, 3:])], axis=1)
    return Views(frame, slot, actor, compose(pose, mount), np.full(len(frame), -1, dtype=np.int32))


def join_views(parts: Sequence[Views]) -> Views:
    """Return the views of several sensors in one table, one after the other; at least one part."""
    columns = zip(*((p.frame, p.slot, p.actor, p.pose, p.ignore) for p in parts), strict=True)
    return Views(*(np.concatenate(column) for column in columns))


def view_keys(arrays: SceneData, views: Views, *stream: str | int) -> np.ndarray:
    """Return the key of each view's random numbers, shape [A, 2], uint32.

    Args:
        arrays: The scene on the host, for the names of the agents.
        views: The views.
        stream: What else names the stream: seed, scenario, weather, sensor.
    """
    names = [arrays.actors[actor].name for actor in views.actor]
    return random_keys((*stream, name, int(frame)) for name, frame in zip(names, views.frame, strict=True))
