"""Render images of a batch of views in every weather, from one visibility.

1. `trace_samples` finds what every pixel sees; `with_extras` sends more rays through pixels on edges.
2. `rgb_light` reads the surfaces' textures, traces the sun's shadows, how much sky every pixel sees, and one reflected
   ray where something reflects sharply. None of it depends on the weather, but for the place of the sun and wet ground.
3. Each weather shades what was traced, and its pictures are tone-mapped: exposure, tone map, noise, sRGB.
"""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.core.constants import FRAME_DT
from mmw.core.kinematics import Motion, differentiate
from mmw.kernels.camera import instance_culling as candidates
from mmw.kernels.shading import reflections as reflection_kernels
from mmw.kernels.shading import shade
from mmw.kernels.shading import structs as shading
from mmw.kernels.shading.sky import Sky
from mmw.kernels.shading.wet_surfaces import Wet
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import view_twists
from mmw.sensors.render.appearance_buffers import AppearanceArrays
from mmw.sensors.render.lighting import (
    SHADING_BLOCK_DIM,
    ReflectedRays,
    find_reflections,
    gather_light,
    read_surfaces,
    shade_samples,
    sun_over,
    trace_reflection_sun,
    trace_reflections,
    trace_sky,
    trace_sun,
)
from mmw.sensors.render.lights import STREET_KLUX, load_brakes, make_lights
from mmw.sensors.render.optical_flow import device_twists, image_motion
from mmw.sensors.render.rain_streaks import drop_light, make_rain, streak_cover
from mmw.sensors.render.sky.sky import bake, ground_radiance, make_air, make_sky, mean_radiance
from mmw.sensors.render.tone_mapping import make_exposure, tone_map
from mmw.sensors.render.visibility_buffer import EXTRA_OFFSETS, SampleBuffer, find_edges, with_extras
from mmw.sensors.render.wet_surfaces import make_wet
from mmw.sensors.rgb.config import RgbCamera

DARK_KLUX = 1.0
"""Illuminance of level ground by sun and sky below which the light of vehicles and streets is drawn [klux]: a
dipped beam gives some 0.02 klux on a road 20 m ahead. Design value."""


@dataclass(frozen=True)
class RgbImages:
    """Pictures of a batch in one weather, on the device."""

    rgb: wp.array
    """sRGB, shape [A, H, W, 3], uint8; row 0 is the top, column 0 the left."""
    exposure: wp.array
    """Factor on luminance that makes 1 white [1/(kcd/m2)], shape [A], float32."""


class RgbRenderer:
    """Renders camera views of one scene in several weathers.

    Attributes:
        notes: Notes for the user on textures, one line each.
    """

    def __init__(self, scene: DeviceScene, weathers: Mapping[str, Weather], *, seed: int = 0, debug: bool = False):
        """Load textures and bake the skies.

        Raises:
            ValueError: If the scene was not read for a weather, or a texture cannot be decoded.
        """
        self._scene = scene
        self._seed = seed
        self._weathers = dict(weathers)
        self._motion: Motion | None = None
        self._lit_frames: tuple[int, ...] | None = None
        appearance = AppearanceArrays(scene, debug=debug)
        self.notes = appearance.notes
        ground = float(scene.arrays.points[:, 2].min() - scene.origin[2]) if len(scene.arrays.points) else 0.0
        self._shading: dict[str, shade.Weather] = {}
        self._is_dark = {name: bake(weather, seed).horizontal_klux < DARK_KLUX for name, weather in weathers.items()}
        for name, weather in weathers.items():
            struct = shade.Weather()
            struct.appearance_table = appearance.for_weather(name)
            struct.lights = make_lights(scene, name, weather)
            street_klux = STREET_KLUX if struct.lights.street_count > 0 else 0.0
            struct.sky = make_sky(weather, scene.device, seed, lights_klux=street_klux)
            struct.air = make_air(weather, scene.device, ground, seed)
            struct.wet = make_wet(weather, scene.origin)
            struct.glow = wp.vec3(*ground_radiance(weather, seed))
            self._shading[name] = struct
        groups: dict[tuple, list[str]] = {}
        for name in weathers:
            groups.setdefault(tuple(material.appearance for material in scene.arrays.materials[name]), []).append(name)
        self._groups = list(groups.values())

    @property
    def alpha_cutouts(self) -> "shading.AppearanceTable | None":
        """Appearance for `trace_samples` where a material has holes, else None."""
        first = next(iter(self._shading.values())).appearance_table
        return first if first.has_holes else None

    def render(self, buffer: SampleBuffer, config: RgbCamera, keys: Mapping[str, np.ndarray]) -> dict[str, RgbImages]:
        """Return the pictures of the views in each weather that has keys.

        Args:
            buffer: What the pixels see.
            config: Rays to send, and how light becomes a picture.
            keys: Weather -> random numbers of each view, shape [A, 2], uint32 (`mmw.scene.views.view_keys`), for noise
                and streaks. Some or all of the camera's weathers; the others cost nothing.
        """
        device = self._scene.device
        image = config.image
        twists = device_twists(self._twists(buffer), device)
        motion = image_motion(buffer, twists) if image.motion_blur else None
        images = {}
        for name, radiance in self.radiance(buffer, config, keys).items():
            weather, sky = self._weathers[name], self._shading[name].sky
            exposure = make_exposure(image.exposure, radiance, sky.exposure)
            key = wp.array(keys[name], dtype=wp.vec2ui, device=device)
            cover, of_drop = None, None
            if image.streaks and weather.rain_mm_h > 0.0:
                rain = make_rain(weather, image, buffer.intrinsics)
                cover = streak_cover(buffer.on_device, twists, key, buffer.camera, buffer.samples.t, rain)
                of_drop = drop_light(wp.vec3(*mean_radiance(weather, self._seed)))
            rgb = tone_map(radiance, image, exposure, keys=key, motion=motion, cover=cover, drop_light=of_drop)
            images[name] = RgbImages(rgb, exposure)
        return images

    def normals(self, buffer: SampleBuffer) -> wp.array:
        """Return the interpolated normal in each pixel's center without normal maps, shape [A, H, W], vec3.

        Sensor frame (x along the optical axis, y left, z up), toward the camera; zero where nothing is hit.
        """
        images = wp.empty(buffer.shape, dtype=wp.vec3, device=self._scene.device)
        if images.size:
            appearance = next(iter(self._shading.values())).appearance_table
            wp.launch(
                shade.normal_kernel, dim=buffer.launch,
                inputs=[self._scene.struct, appearance, buffer.picture],
                outputs=[images], device=self._scene.device, block_dim=SHADING_BLOCK_DIM,
            )  # fmt: skip
        return images

    def flow(self, buffer: SampleBuffer) -> wp.array:
        """Return how far what each pixel's center shows moves until the next frame [px], shape [A, H, W], vec2."""
        return image_motion(buffer, device_twists(self._twists(buffer), self._scene.device))

    def _twists(self, buffer: SampleBuffer) -> tuple[np.ndarray, np.ndarray]:
        if self._motion is None:
            self._motion = differentiate(self._scene.arrays.poses)
        carried = np.flatnonzero(buffer.views.actor >= 0)
        velocity, rate = np.zeros((2, len(buffer.views), 3))
        velocity[carried], rate[carried] = view_twists(self._scene.arrays, self._motion, buffer.views.take(carried))
        return velocity, rate

    def _load_batch(self) -> None:
        """Bring the brake lights of the loaded frames."""
        if self._scene.batch_frames != self._lit_frames:
            brakes = load_brakes(self._scene)
            for weather in self._shading.values():
                weather.lights.brake = brakes
            self._lit_frames = self._scene.batch_frames

    def radiance(
        self, buffer: SampleBuffer, config: RgbCamera, weathers: Collection[str] | None = None
    ) -> dict[str, wp.array]:
        """Return the luminance at every pixel in each weather [kcd/m2], shape [A, H, W], vec3, on the device."""
        wanted = list(self._shading if weathers is None else weathers)
        self._load_batch()
        device = self._scene.device
        if not len(buffer.views):
            return {name: wp.empty(buffer.shape, dtype=wp.vec3, device=device) for name in wanted}
        time = wp.array(buffer.views.frame * FRAME_DT, dtype=float, device=device)
        # What does not depend on a number that the host waits for comes before the wait, so that the device goes on.
        edges = find_edges(buffer) if EXTRA_OFFSETS[config.samples] else None
        sky_light = trace_sky(buffer) if config.sky_light else None
        if edges:
            buffer = with_extras(buffer, edges, config.samples)
        images = {}
        for group in self._groups:
            names = [name for name in group if name in wanted]
            if not names:
                continue
            appearance = self._shading[names[0]].appearance_table
            found, sends_ray = read_surfaces(buffer, appearance)
            wettest = self._wettest(names)
            senders = find_reflections(buffer, appearance, wettest, found, sends_ray) if config.reflections else None
            suns = {name: _sun_of(self._shading[name].sky) for name in names}
            skies = {suns[name]: self._shading[name].sky for name in names}
            lights = {
                sun: _light(buffer, sky if sun and config.shadows else None, sky_light) for sun, sky in skies.items()
            }
            rays = trace_reflections(buffer, appearance, found, senders)
            reflections = {sun: _reflections(buffer, found, rays, light.sun) for sun, light in lights.items()}
            for name in names:
                weather, sun = self._shading[name], suns[name]
                light = lights[sun].struct
                light.reflection = rays.number
                with_lights = self._is_dark[name] and weather.lights.beam_count + weather.lights.street_count > 0
                images[name] = shade_samples(
                    buffer, weather, time, found, light, reflections[sun], with_lights=with_lights
                )
        return {name: images[name] for name in wanted}

    def _wettest(self, names: Sequence[str]) -> Wet:
        """Return water that is nowhere less than in any of some weathers: it decides where reflected rays are sent."""
        wet = make_wet(self._weathers[names[0]], self._scene.origin)
        wet.wetness = max(self._weathers[name].wetness for name in names)
        wet.puddles = max(self._weathers[name].puddles for name in names)
        return wet


@dataclass(frozen=True)
class _Light:
    """The light of one place of the sun."""

    struct: shade.Light
    sun: "candidates.Sun | None"
    """The sun, None where it casts no shadows."""


def _sun_of(sky: Sky) -> tuple[float, ...]:
    """Return the unit vector to the sun of a sky; nothing where it does not shine."""
    return tuple(sky.sun_direction) if any(sky.sun_illuminance) else ()


def _light(buffer: SampleBuffer, sky: "Sky | None", sky_light: wp.array | None) -> _Light:
    """Return the light of the sun of a sky, None for no shadows, and of the sky, from `trace_sky`."""
    sun = sun_over(buffer.scene, sky) if sky is not None else None
    struct = shade.Light()
    struct.sun, struct.sky = gather_light(buffer, trace_sun(buffer, sun) if sun is not None else None, sky_light)
    return _Light(struct, sun)


def _reflections(
    buffer: SampleBuffer, found: shading.Surfaces, rays: ReflectedRays, sun: "candidates.Sun | None"
) -> reflection_kernels.Reflections:
    """Return reflected rays with the light of one place of the sun on what they hit."""
    reflections = reflection_kernels.Reflections()
    for name in ("row", "samples", "surfaces", "sun"):
        setattr(reflections, name, getattr(rays.reflections, name))
    if sun is not None:
        reflections.sun = trace_reflection_sun(buffer, found, rays, sun)
    return reflections
