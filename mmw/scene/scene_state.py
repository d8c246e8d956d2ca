"""Hold what a scene consists of at one moment, on the host and on a device, and apply changes to it."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from mmw.core.device import choose_device
from mmw.core.errors import InputError
from mmw.core.kinematics import differentiate_rows
from mmw.core.transforms import multiply, normalize, quaternion_exp
from mmw.physics.materials.material import Material, RadioMaterial
from mmw.physics.weather.weather import Weather
from mmw.scene import scene_edits as edits
from mmw.scene.device_scene import DeviceScene
from mmw.scene.foliage import has_same_crowns
from mmw.scene.scene_data import SceneData, SceneObject

Value = TypeVar("Value")
Track = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Pose [7], velocity [m/s] and angular velocity [rad/s], both [3], of an actor that was moved by hand."""


class SceneState:
    """State of a scene. Changes count from the next use of `arrays` and `device_scene` on.

    Attributes:
        name: Name of the scene in messages.
        weathers: Weather -> physical values; the first is the default.
        device: Warp device.
        cache: What sensors keep between captures; emptied when a mesh changes.
        removed: Ids of the objects that were taken out.
        version: Grows with every change of a pose or a mesh: paths that were traced before are out of date.
    """

    def __init__(
        self, data: SceneData, weathers: Mapping[str, Weather], frame: int | None, device: str, name: str, files: Any
    ):
        """Start from arrays; the arguments are those of `Scene`."""
        missing = [weather for weather in weathers if weather not in data.materials]
        if missing or not weathers:
            named = f"weather {missing[0]!r}" if missing else "no weather"
            raise InputError(f"scene {name!r}: {named}; the data has materials of {', '.join(data.materials)}; use one")
        self.name, self.weathers, self.device = name, dict(weathers), choose_device(device)
        self.cache: dict[Any, Any] = {}
        self.removed: set[int] = set()
        self.version = 0
        self._data: SceneData | None = data
        self._recorded = frozenset(actor.object_id for actor in data.actors)  # what is added later has no track
        self._files = files  # a temporary folder with textures, which lives as long as this
        self._kept: dict[Any, Any] = {}
        self._tracks: dict[int, Track] = {}
        self._arrays: SceneData | None = None
        self._on_device: DeviceScene | None = None
        self._is_loaded = False
        self._frame = data.frames[0]
        self.set_frame(self._frame if frame is None else frame)

    @property
    def data(self) -> SceneData:
        """The world in all frames, without the poses that were set by hand.

        Raises:
            InputError: If the scene is closed.
        """
        if self._data is None:
            raise InputError(f"scene {self.name!r}: is closed; load it again")
        return self._data

    @property
    def is_closed(self) -> bool:
        """True after `close`."""
        return self._data is None

    def close(self) -> None:
        """Free the memory on the host and the device."""
        self.cache.clear()
        self._kept.clear()
        self._data = self._arrays = self._on_device = self._files = None

    # --- time and weather ---------------------------------------------------------------------------------------------

    @property
    def frame(self) -> int:
        """The current frame."""
        return self._frame

    def set_frame(self, value: int) -> None:
        """Choose a frame, and put every actor of the recording back on its track.

        Raises:
            InputError: If the scene does not cover it.
        """
        frames = self.data.frames
        if isinstance(value, bool) or value not in frames:
            raise InputError(
                f"scene {self.name!r}: frame = {value!r}; it has frames {frames[0]} to {frames[-1]}; choose one of them"
            )
        self._tracks = {key: track for key, track in self._tracks.items() if key not in self._recorded}
        self._frame = int(value)
        self._poses_changed()

    def check_weather(self, name: str | None = None) -> str:
        """Return the name of a weather; the first one for None or an empty name.

        Raises:
            InputError: If the scene does not have it.
        """
        if name and name not in self.weathers:
            raise InputError(
                f"scene {self.name!r}: weather {name!r}; it was loaded with {', '.join(self.weathers)}; name one of "
                "them, or load it with this weather too"
            )
        return name or next(iter(self.weathers))

    def materials_by_id(self, weather: str | None = None) -> tuple[Material, ...]:
        """Return the materials of a weather by id; of the first weather for None.

        Raises:
            InputError: If the scene does not have it.
        """
        return self.data.materials[self.check_weather(weather)]

    # --- arrays -------------------------------------------------------------------------------------------------------

    @property
    def arrays(self) -> SceneData:
        """The scene on the host with all changes."""
        if not self._tracks:
            return self.data
        if self._arrays is None:
            self._arrays = _with_tracks(self.data, self._frame, self._tracks)
        return self._arrays

    @property
    def device_scene(self) -> DeviceScene:
        """The scene on the device, the current frame at batch index 0."""
        arrays = self.arrays
        if self._on_device is None:
            self._on_device, self._is_loaded = DeviceScene(arrays, self.device, 1), False
        if not self._is_loaded:
            if self._on_device.arrays is not arrays:
                self._on_device.replace_arrays(arrays)
            self._on_device.load_batch([self._frame])
            self._is_loaded = True
        return self._on_device

    def cached(self, key: Any, make: Callable[[], Value]) -> Value:
        """Return a value that is made once and kept until a mesh changes, or which materials are slabs or rough."""
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def _poses_changed(self) -> None:
        self.version += 1
        self._arrays, self._is_loaded = None, False

    def _meshes_changed(self, data: SceneData) -> None:
        self._data, self._on_device = data, None
        self._kept.clear()
        self.cache.clear()
        self._poses_changed()

    # --- objects ------------------------------------------------------------------------------------------------------

    def object_row(self, object_id: int) -> SceneObject:
        """Return an object's row.

        Raises:
            InputError: If it was removed.
        """
        row = self.data.objects[object_id]
        if object_id in self.removed:
            raise InputError(f"object {row.prim_path!r}: was removed from the scene {self.name!r}; look it up again")
        return row

    def object_motion(self, object_id: int) -> tuple[np.ndarray, np.ndarray]:
        """Return velocity [m/s] and angular velocity [rad/s] of an object in the world frame, shape [3] each."""
        index = edits.actor_of(self.data, object_id)
        if index < 0:
            return np.zeros(3), np.zeros(3)
        if object_id in self._tracks:
            return self._tracks[object_id][1].copy(), self._tracks[object_id][2].copy()
        row = np.array([self.data.frame_row(self._frame)])
        motion = differentiate_rows(self.data.poses[:, index], row, self.data.pose_dt)
        return motion.velocity[0], motion.world_rate[0]

    def is_moved(self, object_id: int) -> bool:
        """Return whether an object's pose or velocity was set by hand."""
        return object_id in self._tracks

    def move_object(self, object_id: int, pose: np.ndarray, velocity: np.ndarray, rate: np.ndarray) -> None:
        """Put an object at a pose [7], with a velocity [m/s] and an angular velocity [rad/s] in the world frame."""
        self.object_row(object_id)
        if edits.actor_of(self.data, object_id) < 0:
            self._meshes_changed(edits.detach_object(self.data, object_id))
        self._tracks[object_id] = (pose, velocity, rate)
        self._poses_changed()

    def add_object(
        self, name: str, points: np.ndarray, faces: np.ndarray, material: str, label: str, pose: np.ndarray
    ) -> int:
        """Add an object and return its id.

        Raises:
            InputError: If the name is taken or the material is not known.
        """
        self._check_free(name)
        number = self._material_id(f"object {name!r}", material)
        self._meshes_changed(edits.add_object(self.data, name, points, faces, number, label, pose))
        return len(self.data.objects) - 1

    def clone_object(self, object_id: int, name: str, pose: np.ndarray) -> int:
        """Add another actor like an object, and return its id.

        Raises:
            InputError: If the name is taken, or it is an actor without a shape.
        """
        self._check_free(name)
        self.object_row(object_id)
        if edits.actor_of(self.data, object_id) < 0:
            self._meshes_changed(edits.detach_object(self.data, object_id))
        index = edits.actor_of(self.data, object_id)
        self._meshes_changed(edits.clone_actor(self.data, index, name, pose))
        new = len(self.data.objects) - 1
        self._tracks[new] = (pose, np.zeros(3), np.zeros(3))
        return new

    def remove_object(self, object_id: int) -> None:
        """Take an object out of the scene."""
        self.object_row(object_id)
        self._tracks.pop(object_id, None)
        self._meshes_changed(edits.remove_object(self.data, object_id))
        self.removed.add(object_id)

    def paint_object(self, object_id: int, material: str) -> None:
        """Put a material on all faces of an object.

        Raises:
            InputError: If the scene has no such material, or the object has no shape.
        """
        row = self.object_row(object_id)
        if not edits.has_geometry(self.data, object_id):
            raise InputError(f"object {row.prim_path!r}: has no shape; a material needs faces; name another object")
        number = self._material_id(f"object {row.prim_path!r}", material)
        self._meshes_changed(edits.paint_object(self.data, object_id, number, material))

    def add_material(self, materials: Mapping[str, Material]) -> None:
        """Add a material that no face has yet, as it is in each weather."""
        everywhere = {weather: materials[weather] for weather in self.data.materials}
        self._meshes_changed(edits.add_material(self.data, everywhere)[0])

    def change_radio(
        self, ids: tuple[int, ...], change: Callable[[RadioMaterial], RadioMaterial], weather: str | None
    ) -> None:
        """Change the radio properties of some materials in a weather; in all for None.

        Raises:
            InputError: If the scene does not have the weather, or a value is out of range.
        """
        wanted = [self.check_weather(weather)] if weather else list(self.data.materials)
        tables = dict(self.data.materials)
        for name in wanted:
            row = list(tables[name])
            for number in ids:
                row[number] = replace(row[number], radio=change(row[number].radio), radar_radio=None)
            tables[name] = tuple(row)
        before, self._data = self.data, replace(self.data, materials=tables)
        self._arrays, self._is_loaded = None, False
        if not has_same_crowns(before, self.data):
            self._meshes_changed(self.data)
        elif _kinds(self.data) != _kinds(before):
            self._kept.clear()

    def _material_id(self, where: str, name: str) -> int:
        names = [material.name for material in self.materials_by_id()]
        if name not in names:
            raise InputError(f"{where}: material {name!r}; the scene has {', '.join(sorted(set(names)))}; name one")
        return names.index(name)

    def _check_free(self, name: str) -> None:
        if not isinstance(name, str) or not name or "/" in name:
            raise InputError(f"object {name!r}: a name is a text without `/`; give one")
        if any(actor.name == name for actor in self.data.actors):
            raise InputError(f"object {name!r}: the scene has an actor of this name; choose another")


def _kinds(data: SceneData) -> list[list[tuple[bool, bool, str]]]:
    """Return which materials are slabs or rough, and their medium, in each weather; tables of surfaces depend on it."""
    return [[(m.radio.transmits, m.radio.scatters, m.radio.medium) for m in own] for own in data.materials.values()]


def _with_tracks(data: SceneData, frame: int, tracks: Mapping[int, Track]) -> SceneData:
    """Return the scene with some actors moving in a straight line through a pose in one frame.

    Every reader of the poses then sees the velocity as their derivative. A recording of one frame is extended by one
    frame on each side for that, in which the other actors stand still.
    """
    frames, poses = data.frames, data.poses
    if len(frames) == 1:
        frames = range(frames[0] - 1, frames[0] + 2)
        poses = np.repeat(poses, data.pose_rows(len(frames)), axis=0)
    poses = poses.copy()
    time = data.pose_dt * (np.arange(len(poses)) - frames.index(frame) * data.pose_stride)[:, None]
    for object_id, (pose, velocity, rate) in tracks.items():
        index = edits.actor_of(data, object_id)
        poses[:, index, :3] = pose[:3] + velocity * time
        poses[:, index, 3:] = multiply(quaternion_exp(rate * time), normalize(pose[3:]))
    return replace(data, frames=frames, poses=poses)
