"""Hold one moment of a world: actors, objects, materials, transmitters and receivers that can be read and changed."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from mmw.config.sensor import SensorConfig
from mmw.core.errors import InputError
from mmw.core.registry import load_reference
from mmw.physics.materials.material import Material, RadioMaterial
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.material_handle import MaterialHandle
from mmw.scene.mounted_antennas import RadioDevices
from mmw.scene.named_items import NamedItems
from mmw.scene.object_handle import ObjectHandle
from mmw.scene.radio_devices import RadioDevice, Receiver, Transmitter, finite_vector, unit_quaternion
from mmw.scene.ray_casting import RayHits, cast_rays, ray_arrays
from mmw.scene.scene_data import SceneData
from mmw.scene.scene_devices import SceneDevices, antenna_states, default_array, device_actor
from mmw.scene.scene_edits import check_mesh
from mmw.scene.scene_state import SceneState
from mmw.usd.semantics import CARLA_TAG

if TYPE_CHECKING:
    from PIL.Image import Image

    from mmw.channel.antennas.arrays import PlanarArray

Device = TypeVar("Device", bound=RadioDevice)
Item = TypeVar("Item")
Color = tuple[float, float, float]


class Scene:
    """One moment of a world on one device: `load_scene` makes it.

    Everything that is changed counts from the next computation on. A change of a pose uploads poses; only a change of
    meshes builds the trees for rays anew.

    Attributes:
        name: Name of the scenario; random numbers of sensors depend on it.
        seed: Seed of those random numbers.
        tx_array: Array of transmitters that have none of their own; None for a vertical short dipole.
        rx_array: Array of receivers that have none of their own.

    Examples:
        >>> import mmw
        >>> scene = mmw.load_scene(mmw.load_config("quickstart"), frame=5)  # a town with its traffic
        >>> scene.actors["cav_1"].role, len(scene.actors), scene.frame
        ('cav', 21, 5)
        >>> scene.actors["cav_1"].position = (2.0, 45.0, 0.1)
    """

    def __init__(
        self,
        data: SceneData,
        weathers: Mapping[str, Weather],
        *,
        frame: int | None = None,
        device: str = "auto",
        name: str = "scene",
        seed: int = 42,
        scene_seed: int | None = None,
        files: Any = None,
    ):
        """Put arrays that were read or made in code on a device.

        Args:
            data: The world: meshes, actors and their poses in all frames.
            weathers: Weather -> physical values; the first is what computations use unless another one is named.
            frame: Frame to begin with; None for the first one.
            device: `auto`, `cpu` or `cuda:N`.
            name: Name of the scenario.
            seed: Seed of the sensors' random numbers.
            scene_seed: Seed of clouds and patches of fog; None for `seed`.
            files: Temporary folder that textures are in, kept as long as the scene.

        Raises:
            InputError: If there is no weather, the data lacks the materials of one, it has no such frame, or the
                machine has no such device.
        """
        self.name, self.seed, self.scene_seed = name, seed, seed if scene_seed is None else scene_seed
        self.tx_array: PlanarArray | None = None
        self.rx_array: PlanarArray | None = None
        self._state = SceneState(data, weathers, frame, device, name, files)
        self._devices = SceneDevices(self._state)

    def __repr__(self) -> str:
        if self._state.is_closed:
            return f"<scene {self.name!r}, closed>"
        data, state = self._state.data, self._state
        return (
            f"<scene {self.name!r}: {len(data.faces):,} triangles, {len(data.actors)} actors, frame {state.frame} of "
            f"{data.frames[0]} to {data.frames[-1]}, {', '.join(state.weathers)}, {state.device}>"
        )

    def __enter__(self) -> "Scene":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the memory on the host and the device; nothing can be computed afterwards."""
        self._state.close()

    @property
    def device(self) -> str:
        """Warp device."""
        return self._state.device

    @property
    def frames(self) -> range:
        """Frames that the scene covers, 1 / `rate_hz` apart."""
        return self._state.data.frames

    @property
    def rate_hz(self) -> int:
        """Frames a second [Hz]."""
        return self._state.data.rate_hz

    @property
    def frame(self) -> int:
        """The current frame. Setting it puts every actor of the recording back on its track."""
        return self._state.frame

    @frame.setter
    def frame(self, value: int) -> None:
        self._state.set_frame(value)

    @property
    def weathers(self) -> dict[str, Weather]:
        """Weather -> physical values; the first is the default."""
        return dict(self._state.weathers)

    @property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner of the static world [m], shape [2, 3]; NaN if there is none."""
        points = self._state.data.points
        return np.array([points.min(axis=0), points.max(axis=0)]) if len(points) else np.full((2, 3), np.nan)

    # --- what is in it ------------------------------------------------------------------------------------------------

    @property
    def actors(self) -> dict[str, ObjectHandle]:
        """Actors by name."""
        return NamedItems("actor", {a.name: ObjectHandle(self._state, a.object_id) for a in self._state.data.actors})

    @property
    def objects(self) -> dict[str, ObjectHandle]:
        """All objects, actors too: by the last part of the prim path where that is unique, else by the whole path."""
        rows = [row for row in self._state.data.objects if row.object_id not in self._state.removed]
        short = [row.actor or row.prim_path.rpartition("/")[2] for row in rows]
        count: dict[str, int] = {}
        for name in short:
            count[name] = count.get(name, 0) + 1
        keys = [name if count[name] == 1 else row.prim_path for name, row in zip(short, rows, strict=True)]
        return NamedItems(
            "object", {key: ObjectHandle(self._state, row.object_id) for key, row in zip(keys, rows, strict=True)}
        )

    @property
    def materials(self) -> dict[str, MaterialHandle]:
        """Materials by name."""
        ids: dict[str, list[int]] = {}
        for number, material in enumerate(self.materials_by_id()):
            ids.setdefault(material.name, []).append(number)
        return NamedItems(
            "material", {name: MaterialHandle(self._state, name, tuple(own)) for name, own in ids.items()}
        )

    def materials_by_id(self, weather: str | None = None) -> tuple[Material, ...]:
        """Return the materials of a weather by id; of the first weather for None.

        Raises:
            InputError: If the scene does not have the weather.
        """
        return self._state.materials_by_id(weather)

    def check_weather(self, name: str | None = None) -> str:
        """Return the name of a weather of the scene; the first one for None.

        Raises:
            InputError: If the scene does not have it.
        """
        return self._state.check_weather(name)

    def add_object(
        self,
        name: str,
        points: ArrayLike,
        faces: ArrayLike,
        *,
        material: str,
        label: str = "unlabeled",
        position: ArrayLike = (0.0, 0.0, 0.0),
        orientation: ArrayLike = (0.0, 0.0, 0.0, 1.0),
    ) -> ObjectHandle:
        """Add an object, which can move, and return it.

        Args:
            name: Name that no actor has.
            points: Vertices in the object's frame [m], shape [N, 3].
            faces: Triangles, counter-clockwise from outside, shape [M, 3].
            material: Name of a material of the scene; `add_material` adds others.
            label: Semantic class, a key of `mmw.usd.semantics.CARLA_TAG`.
            position: Origin of the object's frame in the world [m], shape [3].
            orientation: Object-to-world quaternion (x, y, z, w), shape [4].

        Raises:
            InputError: If the name is taken, the mesh is broken, or material or label is not known.
        """
        where = f"object {name!r}"
        vertices, triangles = check_mesh(where, points, faces)
        if label not in CARLA_TAG:
            raise InputError(f"{where}: label = {label!r}; known are {', '.join(CARLA_TAG)}; choose one")
        place = finite_vector(f"{where}: position", position, 3)
        pose = np.concatenate([place, unit_quaternion(f"{where}: orientation", orientation)])
        return ObjectHandle(self._state, self._state.add_object(name, vertices, triangles, material, label, pose))

    def add_material(
        self, name: str, radio: RadioMaterial, *, color: Color = (0.5, 0.5, 0.5), lidar_reflectance: float = 0.3
    ) -> MaterialHandle:
        """Add a material to the scene, to be put on objects, and return it.

        Args:
            name: Name that no material of the scene has.
            radio: Radio properties, the same in every weather.
            color: Linear diffuse color, 0 to 1.
            lidar_reflectance: Diffuse reflectance at 905 nm, 0 to 1.

        Raises:
            InputError: If the name is taken or a value is out of range.
        """
        if name in self.materials:
            raise InputError(f"material {name!r}: the scene has one of this name; change that, or choose another name")
        if not isinstance(radio, RadioMaterial):
            raise InputError(f"material {name!r}: radio = {radio!r}; a mmw.RadioMaterial is needed; give one")
        own = Material(name, radio, "none", lidar_reflectance, color)
        self._state.add_material(dict.fromkeys(self._state.data.materials, own))
        return self.materials[name]

    # --- transmitters and receivers -----------------------------------------------------------------------------------

    @property
    def transmitters(self) -> dict[str, Transmitter]:
        """Transmitters by name, in the order in which they were added."""
        return self._devices.transmitters

    @property
    def receivers(self) -> dict[str, Receiver]:
        """Receivers by name, in the order in which they were added."""
        return self._devices.receivers

    def add(self, device: Device) -> Device:
        """Add a transmitter or a receiver, and return it.

        Raises:
            InputError: If it is neither, the name is taken, or its actor is not in the scene.
        """
        if isinstance(device, RadioDevice) and device.actor is not None:
            self.actors[device.actor]
        self._devices.add(device)
        return device

    def remove(self, name: str) -> None:
        """Remove a transmitter or a receiver, or both if both have the name.

        Raises:
            InputError: If there is none. Objects have a method `remove` of their own.
        """
        self._devices.remove(name)

    def array_of(self, device: RadioDevice) -> "PlanarArray":
        """Return the array of a device: its own, that of the scene, or a vertical short dipole."""
        of_scene = self.tx_array if isinstance(device, Transmitter) else self.rx_array
        return device.array or of_scene or default_array()

    def antenna_states(self, devices: Sequence[RadioDevice]) -> RadioDevices:
        """Return where the phase centers of devices are in the current frame, how they are turned and move.

        Raises:
            InputError: If an actor is not in the scene, or absent in the frame.
        """
        return antenna_states(self._state, devices)

    def antenna_state(self, device: RadioDevice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return position [m], [3], device-to-world rotation, [3, 3], and velocity [m/s], [3], of a device."""
        state = self.antenna_states([device])
        return state.position[0], state.rotation[0], state.velocity[0]

    def device_actor(self, device: RadioDevice) -> int:
        """Return the index of the actor that carries a device, -1 for none.

        Raises:
            InputError: If the actor is not in the scene, or absent in the current frame.
        """
        return device_actor(self._state, device)

    # --- computing ----------------------------------------------------------------------------------------------------

    @property
    def arrays(self) -> SceneData:
        """The scene on the host with all changes. Its arrays are not to be written to."""
        return self._state.arrays

    @property
    def device_scene(self) -> DeviceScene:
        """The scene on the device, the current frame at batch index 0."""
        return self._state.device_scene

    @property
    def cache(self) -> dict[Any, Any]:
        """Values that sensors keep between captures; emptied when a mesh changes."""
        return self._state.cache

    @property
    def version(self) -> int:
        """Number that grows with every change of a pose or a mesh."""
        return self._state.version

    def cached(self, key: Any, make: Callable[[], Item]) -> Item:
        """Return a value that is made once and kept until a mesh changes, or which materials are slabs or rough."""
        return self._state.cached(key, make)

    def cast_rays(self, origins: ArrayLike, directions: ArrayLike, *, max_distance: float = np.inf) -> RayHits:
        """Find the first surface along each ray in the current frame.

        Args:
            origins: Ray origins in the world [m], shape [R, 3] or [3].
            directions: Directions in the world, of any length above 0, shape [R, 3] or [3].
            max_distance: Rays end here [m].

        Returns:
            Distance, object, material and normal of each hit, shape [R].

        Raises:
            InputError: If shapes do not fit, or a value is not finite.
        """
        start, toward = ray_arrays(origins, directions, max_distance)
        return cast_rays(self.device_scene.optical, start, toward, max_distance=max_distance)

    def capture(
        self,
        sensor: SensorConfig | Sequence[SensorConfig],
        *,
        pose: ArrayLike | None = None,
        actor: str | Sequence[str] | None = None,
        velocity: ArrayLike = (0.0, 0.0, 0.0),
        weather: str | Sequence[str] | None = None,
        output: Literal["numpy", "warp"] = "numpy",
    ) -> Any:
        """Return what a sensor measures in the current frame, by the code that generates datasets.

        Args:
            sensor: A sensor of `mmw.sensors`, or several.
            pose: Sensor to world (x, y, z, qx, qy, qz, qw), shape [7], or [K, 7] for K poses in one launch.
            actor: Agent that carries the sensor on its own mount, or several; instead of `pose`.
            velocity: Velocity of the sensor in the world [m/s], shape [3], beside `pose`.
            weather: Name of a weather of the scene; None for the first; several give a mapping by name.
            output: `numpy`, or `warp` for arrays that stay on the device (`torch.from_dlpack` takes them).

        Returns:
            The sample of the sensor, such as `PointCloud` or `RgbImage`; a list for several sensors, poses or actors.

        Raises:
            InputError: If there is no such actor or weather, a value is not finite, or the sensor is inside something.

        Examples:
            >>> import mmw
            >>> scene = mmw.load_scene(mmw.load_config("quickstart"))
            >>> lidar = mmw.sensors.Lidar(channels=16, points_per_channel=180)
            >>> cloud = scene.capture(lidar, actor="cav_1")
            >>> cloud.xyz.shape[1], cloud.object_id.dtype
            (3, dtype('int32'))
        """
        function = load_reference("mmw.sensors.scene_capture:capture")
        return function(self, sensor, pose=pose, actor=actor, velocity=velocity, weather=weather, output=output)

    # --- seeing -------------------------------------------------------------------------------------------------------

    def show(self, **options: Any) -> Any:
        """Show the scene in 3-D: a widget in a notebook, a window in a script, or a file.

        Args:
            options: Those of `mmw.viz.scene_view.show.show`, such as `paths`, `radio_map`, `clip_z_m` and `save`.
        """
        return load_reference("mmw.viz.scene_view.show:show")(self, **options)

    def render(self, **options: Any) -> "Image":
        """Return a picture of the scene by the RGB camera, with paths and coverage drawn in.

        Args:
            options: Those of `mmw.viz.scene_view.picture.render_picture`: `eye`, `look_at`, `paths` and `radio_map`.
        """
        return load_reference("mmw.viz.scene_view.picture:render_picture")(self, **options)
