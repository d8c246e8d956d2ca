"""Skies, materials, views and shots by hand for the tests of the RGB camera."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from mmw.config import RgbConfig
from mmw.kernels.air import HORIZON, Air
from mmw.kernels.depth import DepthImages
from mmw.kernels.sky import Sky
from mmw.looks import Look
from mmw.materials import Material
from mmw.poses import pose_from_mount, rotate
from mmw.scene import Scene
from mmw.scene_arrays import SceneArrays
from mmw.sensors.lens import intrinsics_of, unproject
from mmw.sensors.rgb import RgbCamera
from mmw.sensors.sky import SUN_RADIUS, make_sky, sun_direction
from mmw.sensors.visibility_buffer import SampleBuffer, depth_images, trace_samples
from mmw.views import Views
from mmw.weather import Weather
from tests import scenes

SMALL = RgbConfig(width_px=64, height_px=48, fov_deg=60.0)
"""A camera of 64 x 48 pixels, 60 degrees wide."""


def matter(name: str = "matter", base: str = "none", **look) -> Material:
    """Return a material with this look; an index of 1 makes it a Lambert surface."""
    return replace(scenes.material(name), nonvisual_base=base, look=Look(**look))


def lambert(albedo: float | Sequence[float], name: str = "matter") -> Material:
    """Return a material that scatters light by Lambert's law and mirrors none."""
    color = tuple(np.broadcast_to(albedo, 3).tolist())
    return matter(name, color=color, ior=1.0, roughness=1.0)


def glowing(emission: Sequence[float] = (1.0, 1.0, 1.0), name: str = "glow") -> Material:
    """Return a black material that shines with a luminance [kcd/m2]."""
    return matter(name, color=(0.0, 0.0, 0.0), ior=1.0, roughness=1.0, emission=tuple(emission))


def even_sky(device: str, luminance: float, *, sun: Weather | None = None, klux: float = 0.0) -> Sky:
    """Return a sky of the same luminance [kcd/m2] all round, ground included.

    Args:
        device: Warp device.
        luminance: Of every direction.
        sun: Weather that says where the sun stands; none: there is none.
        klux: White illuminance by the sun of a plane that faces it.
    """
    real, sky = make_sky(Weather(), device), Sky()
    for name in ("map", "blurred"):
        like = getattr(real, name)  # four halves a texel in one word, whatever the layout of the directions
        texels = np.full((*like.shape, 4), luminance, dtype=np.float16).view(np.uint64)[..., 0]
        setattr(sky, name, wp.array(texels, dtype=like.dtype, device=device))
    sky.scale = 1.0
    sky.sun_direction = wp.vec3(*(sun_direction(sun) if sun else (0.0, 0.0, 1.0)))
    sky.sun_illuminance = wp.vec3(klux, klux, klux)
    sky.sun_radius = SUN_RADIUS
    sky.exposure = 1.0
    return sky


def no_air(device: str) -> Air:
    """Return air that takes and adds no light."""
    air = Air()
    air.horizon = wp.zeros(int(HORIZON), dtype=wp.vec3, device=device)
    return air


def at(*places: Sequence[float], frame: int | Sequence[int] = 0) -> Views:
    """Return views by nobody: each place is x, y, z [m] and yaw, pitch, roll [deg] (see `pose_from_mount`), or a pose
    of 7 numbers. Slots are the frames in the order in which they first come."""
    poses = [np.array(p, dtype=float) if len(p) == 7 else pose_from_mount(p[:3], *p[3:]) for p in places]
    frames = np.broadcast_to(frame, len(places)).astype(np.int64)
    order = list(dict.fromkeys(frames.tolist()))
    slot = np.array([order.index(k) for k in frames.tolist()], dtype=np.int32)
    none = np.full(len(places), -1, dtype=np.int32)
    return Views(frames, slot, none, np.array(poses).reshape(-1, 7), none)


@dataclass(frozen=True)
class Shot:
    """Pictures of one scene."""

    scene: Scene
    camera: RgbCamera
    buffer: SampleBuffer
    config: RgbConfig
    weathers: tuple[str, ...]

    def light(self) -> dict[str, np.ndarray]:
        """Return the radiance in each weather [kcd/m2], shape [A, H, W, 3], after a check that all of it is finite."""
        images = {name: image.numpy() for name, image in self.camera.radiance(self.buffer, self.config).items()}
        assert all(np.isfinite(image).all() and (image >= 0.0).all() for image in images.values())
        return images

    def one(self) -> np.ndarray:
        """Return the radiance of the first view in the only weather, shape [H, W, 3]."""
        (images,) = self.light().values()
        return images[0]

    def rgb(self) -> dict[str, np.ndarray]:
        """Return the developed pictures, shape [A, H, W, 3], uint8, with the same keys in every weather."""
        count = len(self.buffer.views)
        keys = {name: np.arange(2 * count, dtype=np.uint32).reshape(-1, 2) for name in self.weathers}
        return {name: images.rgb.numpy() for name, images in self.camera.render(self.buffer, self.config, keys).items()}

    @property
    def rays(self) -> np.ndarray:
        """Unit directions of the pixels' centres of the first view, world frame, shape [H, W, 3]."""
        lens = self.buffer.intrinsics
        u, v = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
        return rotate(self.buffer.views.pose[0, 3:], unproject(lens, np.stack([u, v], axis=-1)))

    def objects(self) -> np.ndarray:
        """Return the object id of every pixel, -1 for none, shape [A, H, W]."""
        return self.depth().object_id.numpy()

    def depth(self) -> DepthImages:
        """Return the depth images of the same rays."""
        return depth_images(self.buffer, with_metres=True, with_objects=True)


def shoot(
    arrays: SceneArrays,
    device: str,
    views: Views,
    *,
    config: RgbConfig = SMALL,
    weathers: Mapping[str, Weather] | None = None,
    sky: "Sky | None" = None,
    glow: float = 0.0,
    debug: bool = False,
) -> Shot:
    """Return a camera before a scene.

    Args:
        arrays: The scene.
        device: Warp device.
        views: The views.
        config: The camera.
        weathers: Weathers; `sunny` alone if absent.
        sky: Sky for all weathers instead of their own, without air.
        glow: Luminance of open ground, with `sky` [kcd/m2].
        debug: Magenta where a texture is missing.
    """
    frames = list(dict.fromkeys(views.frame.tolist())) or [arrays.frames[0]]
    scene = Scene(arrays, device, len(frames))
    scene.load_batch(frames)
    camera = RgbCamera(scene, weathers or {"sunny": Weather()}, debug=debug)
    if sky is not None:
        for weather in camera._shading.values():
            weather.sky, weather.air, weather.glow = sky, no_air(device), wp.vec3(glow, glow, glow)
    buffer = trace_samples(scene, views, intrinsics_of(config), config.range_m, camera.cut_outs)
    return Shot(scene, camera, buffer, config, tuple(weathers or ("sunny",)))
