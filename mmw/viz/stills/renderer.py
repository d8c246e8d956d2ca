"""Pictures of a scene for people, by the RGB camera: from an eye, from any camera, or from straight above."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from PIL import Image

from mmw.core.camera_models import Intrinsics
from mmw.core.device import choose_device
from mmw.core.errors import InputError
from mmw.core.random_keys import random_keys
from mmw.core.transforms import pose_from_ypr, rotate
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.scene.views import Views
from mmw.sensors.render.projection import intrinsics_of
from mmw.sensors.render.visibility_buffer import trace_samples
from mmw.sensors.rgb.config import RgbCamera
from mmw.sensors.rgb.simulate import RgbRenderer

MAP_HEIGHT = 10.0
"""Height of the eye of a map over its middle, in sides of the map [-]: at the edge of any map a roof 30 m up is drawn
1.5 m too far out. Design value: float32 still resolves millimeters from the 5 to 10 km above a town."""

MAP_VISIBILITY_M = 20_000.0
"""Visibility of the air of a map, whose haze ends right over the ground besides [m]. Design value."""

MAP_FALLOFF_PER_M = 10.0
"""Decay of that haze with height [1/m]. Design value."""

STREET_FOV_DEG = 70.0
"""Horizontal field of view of pictures from an eye [deg]. Design value."""


def street_camera(width: int = 1280, height: int = 720, samples: int = 4, fov_deg: float = STREET_FOV_DEG) -> RgbCamera:
    """Return a pinhole camera for pictures from an eye; `samples` is 1, 4 or 9 rays in a pixel on an edge.

    Raises:
        InputError: If the camera cannot be like this.
    """
    return RgbCamera(width_px=width, height_px=height, samples=samples, fov_deg=fov_deg)


def look_pose(eye: Sequence[float] | np.ndarray, target: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return the pose of a camera at `eye` that looks at `target`, shape [7].

    It does not roll; straight above the target north is up.

    Raises:
        InputError: If eye and target coincide.
    """
    offset = np.asarray(target, dtype=float) - np.asarray(eye, dtype=float)
    level, length = float(np.hypot(offset[0], offset[1])), float(np.linalg.norm(offset))
    if not length > 0.0:
        raise InputError(f"eye and target are both {list(map(float, eye))}; a view needs a direction; move one of them")
    yaw = np.arctan2(offset[1], offset[0]) if level > 1e-9 * length else 0.5 * np.pi
    return pose_from_ypr(eye, yaw, np.arctan2(-offset[2], level))


def follow_view(pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return eye and target of a view over the left shoulder of an actor with a pose [7], both [3]."""
    heading = rotate(pose[3:], (1.0, 0.0, 0.0)) * (1.0, 1.0, 0.0)
    side = np.array([-heading[1], heading[0], 0.0])
    return pose[:3] - 9.0 * heading + 2.5 * side + (0.0, 0.0, 3.2), pose[:3] + 12.0 * heading + (0.0, 0.0, 1.0)


def map_frame(scene: DeviceScene) -> tuple[np.ndarray, float]:
    """Return the middle [m], shape [2], and the side [m] of a map of the whole town."""
    low, high = scene.arrays.points[:, :2].min(axis=0), scene.arrays.points[:, :2].max(axis=0)
    return 0.5 * (low + high), float((high - low).max())


def load_renderer(
    arrays: SceneData, frame: int, weathers: Mapping[str, Weather], *, seed: int = 0, device: str = "auto"
) -> "StillRenderer":
    """Return a renderer of one frame of a scene that was read for some weathers."""
    scene = DeviceScene(arrays, choose_device(device), 1)
    scene.load_batch([frame])
    return StillRenderer(scene.optical, weathers, seed=seed)


class StillRenderer:
    """Renders pictures of a scene. Textures and skies are loaded once."""

    def __init__(
        self,
        scene: DeviceScene,
        weathers: Mapping[str, Weather],
        *,
        seed: int = 0,
        camera: RgbRenderer | None = None,
    ):
        """Load textures and bake the skies.

        Args:
            scene: Town and vehicles, with a batch loaded.
            weathers: Weather name -> values; the scene was read for each of them.
            seed: Of clouds and rain.
            camera: Renderer of the scene that has the weathers, if there is one already.

        Raises:
            InputError: If the scene was not read for a weather, or a texture cannot be decoded.
        """
        self.scene = scene
        self._weathers = dict(weathers)
        self._seed = seed
        self._given = camera

    @cached_property
    def _camera(self) -> RgbRenderer:
        return self._given or RgbRenderer(self.scene, self._weathers, seed=self._seed)

    @cached_property
    def _map_camera(self) -> RgbRenderer:
        """The same under air that is clear from high up."""
        clear = {
            name: replace(
                weather,
                rain_mm_h=0.0,
                visibility_m=max(weather.visibility_m, MAP_VISIBILITY_M),
                lwc_g_m3=None,
                fog_start_m=0.0,
                fog_falloff_per_m=MAP_FALLOFF_PER_M,
            )
            for name, weather in self._weathers.items()
        }
        return RgbRenderer(self.scene, clear, seed=self._seed)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the textures, one line each."""
        return tuple(self._camera.notes)

    def look(
        self,
        weather: str,
        eye: Sequence[float] | np.ndarray,
        target: Sequence[float] | np.ndarray,
        config: RgbCamera,
    ) -> Image.Image:
        """Return a picture from an eye without an agent.

        Args:
            weather: One of the weathers.
            eye: Position in the world [m].
            target: Point in the middle of the picture [m]; not the eye itself.
            config: The camera, such as a `street_camera`.

        Raises:
            InputError: If eye and target coincide.
        """
        return self.look_from(weather, look_pose(eye, target), config)

    def look_from(self, weather: str, pose: np.ndarray, config: RgbCamera) -> Image.Image:
        """Return a picture by a camera without an agent.

        Args:
            weather: One of the weathers.
            pose: Camera to world, x along the optical axis, y left, z up, shape [7].
            config: The camera.
        """
        views = self._free_view(pose)
        return Image.fromarray(self.render(views, config, self._keys(views, weather))[weather][0])

    def distances(self, pose: np.ndarray, config: RgbCamera) -> np.ndarray:
        """Return how far the first surface in the center of each pixel is from a camera without an agent.

        Args:
            pose: Camera to world, x along the optical axis, y left, z up, shape [7].
            config: The camera.

        Returns:
            Distance along the ray [m], inf where nothing is hit, shape [H, W], float32.
        """
        cutouts = self._camera.alpha_cutouts
        views, intrinsics = self._free_view(pose), intrinsics_of(config)
        buffer = trace_samples(self.scene, views, intrinsics, config.range_m, cutouts, with_surfaces=False)
        return buffer.samples.t.numpy().reshape(intrinsics.height, intrinsics.width)

    def map_view(
        self, weather: str, center: Sequence[float] | np.ndarray, size_m: float, *,
        width: int = 1280, samples: int = 4,
    ) -> Image.Image:  # fmt: skip
        """Return a square map: the scene from high above, north up, without fog and rain.

        Args:
            weather: One of the weathers, for the sun and the ground.
            center: x and y of the middle, world frame [m].
            size_m: Side of the map at the ground [m].
            width: Side of the image [px].
            samples: Rays in a pixel on an edge: 1, 4 or 9.
        """
        ground = float(self.scene.arrays.points[:, 2].min()) if len(self.scene.arrays.points) else 0.0
        height = MAP_HEIGHT * size_m
        eye = np.array([center[0], center[1], ground + height])
        views = self._free_view(look_pose(eye, eye - (0.0, 0.0, 1.0)))
        focal = width * MAP_HEIGHT
        intrinsics = Intrinsics(width, width, focal, focal, 0.5 * width, 0.5 * width)
        config = RgbCamera(width_px=width, height_px=width, samples=samples)
        keys = self._keys(views, weather)
        found = self._render(self._map_camera, views, intrinsics, 1.01 * height, config, keys)
        return Image.fromarray(found[weather][0])

    def render(self, views: Views, config: RgbCamera, keys: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return what a camera sees from several views, weather -> sRGB, shape [A, H, W, 3], uint8.

        Args:
            views: Poses of the camera.
            config: The camera.
            keys: Weather -> random numbers of each view, shape [A, 2], uint32.
        """
        return self._render(self._camera, views, intrinsics_of(config), config.range_m, config, keys)

    def _keys(self, views: Views, weather: str) -> dict[str, np.ndarray]:
        """Return random numbers of views by weather and frame alone."""
        return {weather: random_keys((self._seed, weather, int(frame), 0) for frame in views.frame)}

    def _render(
        self,
        camera: RgbRenderer,
        views: Views,
        intrinsics: Intrinsics,
        range_m: float,
        config: RgbCamera,
        keys: Mapping[str, np.ndarray],
    ) -> dict[str, np.ndarray]:
        buffer = trace_samples(self.scene, views, intrinsics, range_m, camera.alpha_cutouts)
        return {name: images.rgb.numpy() for name, images in camera.render(buffer, config, keys).items()}

    def _free_view(self, pose: np.ndarray) -> Views:
        """Return a view of the first frame of the batch, without an agent."""
        return Views(
            frame=np.array([self.scene.batch_frames[0]], dtype=np.int64),
            batch_index=np.zeros(1, dtype=np.int32),
            actor=np.array([-1], dtype=np.int32),
            pose=pose[None],
            ignore_instance=np.array([-1], dtype=np.int32),
        )
