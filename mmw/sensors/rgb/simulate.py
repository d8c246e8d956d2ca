"""Render images of a batch of views in every weather, from one visibility.

1. `trace_samples` finds what every pixel sees; `with_extras` sends more rays through pixels on edges.
2. `rgb_light` reads the surfaces' textures, traces the sun's shadows, how much sky every pixel sees, and one reflected
   ray where something reflects sharply. None of it depends on the weather, but for the place of the sun and wet ground.
3. Each weather shades what was traced, and its pictures are tone-mapped: exposure, tone map, noise, sRGB.
"""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
import warp as wp

from mmw.core.kinematics import Motion
from mmw.core.recorded_work import DirectWork, NewArrays
from mmw.core.transfer import to_host
from mmw.kernels.camera import instance_culling as candidates
from mmw.kernels.shading import reflections as reflection_kernels
from mmw.kernels.shading import shade
from mmw.kernels.shading import structs as shading
from mmw.kernels.shading.sky import Sky
from mmw.kernels.shading.wet_surfaces import Wet
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.scene.views import Views
from mmw.sensors.camera_group.images import CameraImage, object_images
from mmw.sensors.camera_group.launches import Launch, single_launches, trace_launch
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
from mmw.sensors.render.lights import STREET_KLUX, batch_brakes, make_lights
from mmw.sensors.render.optical_flow import device_twists, image_motion
from mmw.sensors.render.rain_streaks import drop_light, make_rain, streak_cover
from mmw.sensors.render.row_lists import ListShares, RowLists
from mmw.sensors.render.sky.sky import bake, ground_radiance, make_air, make_sky, mean_radiance
from mmw.sensors.render.tone_mapping import make_exposure, tone_map
from mmw.sensors.render.visibility_buffer import EXTRA_OFFSETS, SampleBuffer, depth_images, with_extras
from mmw.sensors.render.wet_surfaces import make_wet
from mmw.sensors.rgb.config import RgbCamera
from mmw.sensors.rgb.frame_inputs import FrameArrays, FrameValues, SunPlace, frame_values, twists_of
from mmw.sensors.samples import Array, join, to_output
from mmw.sensors.sensor_input import SensorInput

T = TypeVar("T")

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


@dataclass(frozen=True)
class RgbImage(CameraImage):
    """Images of A views in one weather, or the one of a single view, whose arrays lack the first axis."""

    rgb: Array
    """sRGB, shape [A, H, W, 3], uint8; row 0 is the top, column 0 the left."""
    exposure: np.ndarray
    """Factor on luminance that makes 1 white [1/(kcd/m2)], shape [A], float32, always on the host."""
    instance: Array | None = None
    """Object in each pixel, -1 for nothing, shape [A, H, W], int32; None without `segmentation`."""
    normals: Array | None = None
    """Unit normals in the sensor frame, zero for nothing, shape [A, H, W, 3], float32; None without `normals`. In Warp
    [A, H, W] of `vec3`."""
    flow: Array | None = None
    """Optical flow to the next frame, right and down [px], shape [A, H, W, 2], float32; None without `flow`. In Warp
    [A, H, W] of `vec2`."""


def simulate(data: SensorInput, config: RgbCamera) -> dict[str, RgbImage]:
    """Return the images of all views in each weather, from the same rays."""
    renderer = rgb_renderer(data.cache, data.scene, data.weathers, data.seed_of_scene, config.debug)
    launches = single_launches(config, data.views, data.scene.device)
    parts = [_images(replace(data, views=launch.views), config, launch, renderer) for launch in launches]
    return {name: join([part[name] for part in parts]) for name in data.weathers}


def _images(data: SensorInput, config: RgbCamera, launch: Launch, renderer: "RgbRenderer") -> dict[str, RgbImage]:
    buffer = trace_launch(data.scene, launch, renderer.alpha_cutouts)
    shared: dict[str, Any] = {"intrinsics": launch.intrinsics}
    if config.normals:
        shared["normals"] = to_output(renderer.normals(buffer), data.output)
    if config.flow:
        shared["flow"] = to_output(renderer.flow(buffer, data.motion), data.output)
    if config.segmentation or config.boxes_2d:
        objects = depth_images(buffer, range_m=config.range_m, with_metres=False, with_objects=True).object_id
        shared |= object_images(data, config, launch, objects)
        shared["instance"] = to_output(objects, data.output) if config.segmentation else None
    keys = {name: data.keys(name, config.name) for name in data.weathers}
    found = renderer.render(buffer, config, keys, data.motion)
    exposures = to_host([images.exposure for images in found.values()])
    return {
        name: RgbImage(to_output(images.rgb, data.output), exposure, **shared)
        for (name, images), exposure in zip(found.items(), exposures, strict=True)
    }


def rgb_renderer(
    cache: dict[Any, Any], scene: DeviceScene, weathers: Mapping[str, Weather], seed: int, debug: bool
) -> "RgbRenderer":
    """Return what renders images of a scene, which is made once and then kept in a cache; see `RgbRenderer`."""
    key = "rgb", seed, debug
    if key not in cache:
        cache[key] = RgbRenderer(scene, {}, seed=seed, debug=debug)
    cache[key].add(weathers)
    return cache[key]


class RgbRenderer:
    """Renders camera views of one scene in several weathers.

    Attributes:
        notes: Notes for the user on textures, one line each.
        list_shares: Room of the lists of rows, which grows where it was not enough.
    """

    def __init__(self, scene: DeviceScene, weathers: Mapping[str, Weather], *, seed: int = 0, debug: bool = False):
        """Load textures and bake the skies.

        Raises:
            ValueError: If the scene was not read for a weather, or a texture cannot be decoded.
        """
        self._scene = scene
        self._seed = seed
        self._appearance = AppearanceArrays(scene, debug=debug)
        self.notes = self._appearance.notes
        self._weathers: dict[str, Weather] = {}
        self._shading: dict[str, shade.Weather] = {}
        self._suns: dict[str, SunPlace] = {}
        self._is_dark: dict[str, bool] = {}
        self._groups: list[list[str]] = []
        self._brakes: tuple[SceneData, tuple[int, ...], np.ndarray] | None = None
        self.list_shares = ListShares()
        self.add(weathers)

    def add(self, weathers: Mapping[str, Weather]) -> None:
        """Bake the skies of further weathers; those that are there already cost nothing.

        Raises:
            ValueError: If the scene was not read for a weather.
        """
        if weathers.keys() <= self._shading.keys():
            return
        scene, seed = self._scene, self._seed
        ground = float(scene.arrays.points[:, 2].min() - scene.origin[2]) if len(scene.arrays.points) else 0.0
        for name, weather in weathers.items():
            if name in self._shading:
                continue
            struct = shade.Weather()
            struct.appearance_table = self._appearance.for_weather(name)
            struct.lights = make_lights(scene, name, weather)
            street_klux = STREET_KLUX if struct.lights.street_count > 0 else 0.0
            struct.sky = make_sky(weather, scene.device, seed, lights_klux=street_klux)
            struct.air = make_air(weather, scene.device, ground, seed)
            struct.wet = make_wet(weather, scene.origin)
            struct.glow = wp.vec3(*ground_radiance(weather, seed))
            self._is_dark[name] = bake(weather, seed).horizontal_klux < DARK_KLUX
            self._weathers[name], self._shading[name], self._suns[name] = weather, struct, _sun_of(struct.sky)
        groups: dict[tuple, list[str]] = {}
        for name in self._shading:
            groups.setdefault(tuple(material.appearance for material in scene.arrays.materials[name]), []).append(name)
        self._groups = list(groups.values())

    @property
    def alpha_cutouts(self) -> "shading.AppearanceTable | None":
        """Appearance for `trace_samples` where a material has holes, else None."""
        return self._appearance.alpha_cutouts

    def render(
        self,
        buffer: SampleBuffer,
        config: RgbCamera,
        keys: Mapping[str, np.ndarray],
        motion: Motion | None = None,
    ) -> dict[str, RgbImages]:
        """Return the pictures of the views in each weather that has keys.

        Args:
            buffer: What the pixels see.
            config: Rays to send, and how light becomes a picture.
            keys: Weather -> random numbers of each view, shape [A, 2], uint32 (`mmw.scene.views.view_keys`), for noise
                and streaks. Some or all of the camera's weathers; the others cost nothing.
            motion: `differentiate(scene.arrays.poses, scene.arrays.pose_dt)`, if at hand.
        """
        return self._directly(buffer, config, keys, motion, self.pictures)

    def radiance(
        self, buffer: SampleBuffer, config: RgbCamera, weathers: Collection[str] | None = None
    ) -> dict[str, wp.array]:
        """Return the luminance at every pixel in each weather [kcd/m2], shape [A, H, W], vec3, on the device."""
        none = np.zeros((len(buffer.views), 2), dtype=np.uint32)
        keys = dict.fromkeys(self._shading if weathers is None else weathers, none)
        return self._directly(buffer, config, keys, None, self._radiance)

    def _directly(
        self,
        buffer: SampleBuffer,
        config: RgbCamera,
        keys: Mapping[str, np.ndarray],
        motion: Motion | None,
        make: Callable[..., dict[str, T]],
    ) -> dict[str, T]:
        """Return images of traced views, made again as long as a list has no room for its rows."""
        work = DirectWork(self._scene.device)
        values = self.frame_values(buffer.scene, buffer.views, config, keys, motion)

        def launch(arrays: NewArrays, inputs: list[wp.array]) -> tuple[dict[str, T], RowLists]:
            lists = RowLists(arrays, self.list_shares, buffer.extras.first)
            return make(replace(buffer, arrays=arrays), config, values, FrameArrays(*inputs), lists), lists

        while True:
            with work.run(None, values.inputs, launch) as (images, lists):
                (counts,) = work.to_host([lists.counts])
                if lists.fit(counts):
                    return images

    def frame_values(
        self,
        scene: DeviceScene,
        views: Views,
        config: RgbCamera,
        keys: Mapping[str, np.ndarray],
        motion: Motion | None = None,
    ) -> FrameValues:
        """Return what changes from frame to frame for `pictures`; see `render` for the arguments."""
        skies = {} if not config.shadows else {self._suns[name]: self._shading[name].sky for name in keys}
        skies.pop((), None)
        if self._brakes is None or self._brakes[0] is not scene.arrays or self._brakes[1] != scene.batch_frames:
            self._brakes = scene.arrays, scene.batch_frames, batch_brakes(scene, motion)
        return frame_values(scene, views, keys, skies, self._brakes[2], motion)

    def pictures(
        self, buffer: SampleBuffer, config: RgbCamera, values: FrameValues, frame: FrameArrays, lists: RowLists
    ) -> dict[str, RgbImages]:
        """Launch what makes the pictures of the views, without a wait; they hold if all `lists` fit.

        Args:
            buffer: What the pixels see.
            config: Rays to send, and how light becomes a picture.
            values: From `frame_values`; its inputs are not read.
            frame: Its inputs on the device.
            lists: Lists of the launch.
        """
        image, arrays = config.image, buffer.arrays
        blur = image_motion(buffer, frame.twists) if image.motion_blur else None
        images = {}
        for name, radiance in self._radiance(buffer, config, values, frame, lists).items():
            weather, sky = self._weathers[name], self._shading[name].sky
            exposure = make_exposure(image.exposure, radiance, sky.exposure, arrays)
            key = frame.key[values.weathers.index(name)] if len(buffer.views) else arrays.empty(0, wp.vec2ui)
            cover, of_drop = None, None
            if image.streaks and weather.rain_mm_h > 0.0:
                rain = make_rain(weather, image, buffer.intrinsics)
                cover = streak_cover(buffer.on_device, frame.twists, key, buffer.camera, buffer.samples.t, rain, arrays)
                of_drop = drop_light(wp.vec3(*mean_radiance(weather, self._seed)))
            rgb = tone_map(
                radiance, image, exposure, keys=key, motion=blur, cover=cover, drop_light=of_drop, arrays=arrays
            )
            images[name] = RgbImages(rgb, exposure)
        return images

    def normals(self, buffer: SampleBuffer) -> wp.array:
        """Return the interpolated normal in each pixel's center without normal maps, shape [A, H, W], vec3.

        Sensor frame (x along the optical axis, y left, z up), toward the camera; zero where nothing is hit.
        """
        images = buffer.arrays.empty(buffer.shape, wp.vec3)
        if images.size:
            appearance = next(iter(self._shading.values())).appearance_table
            wp.launch(
                shade.normal_kernel, dim=buffer.launch,
                inputs=[self._scene.struct, appearance, buffer.picture],
                outputs=[images], device=self._scene.device, block_dim=SHADING_BLOCK_DIM,
            )  # fmt: skip
        return images

    def flow(self, buffer: SampleBuffer, motion: Motion | None = None) -> wp.array:
        """Return how far what each pixel's center shows moves until the next frame [px], shape [A, H, W], vec2."""
        twists = device_twists(twists_of(buffer.scene, buffer.views, motion), self._scene.device)
        return image_motion(buffer, twists, 1.0 / buffer.scene.arrays.rate_hz)

    def _radiance(
        self, buffer: SampleBuffer, config: RgbCamera, values: FrameValues, frame: FrameArrays, lists: RowLists
    ) -> dict[str, wp.array]:
        """Launch what finds the luminance at every pixel in each weather; see `pictures`."""
        wanted, arrays = values.weathers, buffer.arrays
        if not len(buffer.views):
            return {name: arrays.empty(buffer.shape, wp.vec3) for name in wanted}
        if EXTRA_OFFSETS[config.samples]:
            buffer = with_extras(buffer, config.samples, lists)
        sky_light = trace_sky(buffer) if config.sky_light else None
        suns = {name: self._suns[name] for name in wanted}
        skies = {suns[name]: self._shading[name].sky for name in wanted}
        lights = {place: self._light(buffer, place, sky, sky_light, values, frame) for place, sky in skies.items()}
        images = {}
        for group in self._groups:
            names = [name for name in group if name in wanted]
            if not names:
                continue
            appearance = self._shading[names[0]].appearance_table
            found, sends_ray = read_surfaces(buffer, appearance)
            senders = None
            if config.reflections:
                senders = find_reflections(buffer, appearance, self._wettest(names), found, sends_ray, lists)
            rays = trace_reflections(buffer, appearance, found, senders)
            places = dict.fromkeys(suns[name] for name in names)
            reflections = {place: _reflections(buffer, found, rays, lights[place].sun) for place in places}
            for name in names:
                weather, place = self._shading[name], suns[name]
                weather.lights.brake = frame.brake
                light = lights[place].struct
                light.reflection = rays.number
                with_lights = self._is_dark[name] and weather.lights.beam_count + weather.lights.street_count > 0
                images[name] = shade_samples(
                    buffer, weather, frame.time, found, light, reflections[place], with_lights=with_lights
                )
        return {name: images[name] for name in wanted}

    def _light(
        self,
        buffer: SampleBuffer,
        place: SunPlace,
        sky: Sky,
        sky_light: wp.array | None,
        values: FrameValues,
        frame: FrameArrays,
    ) -> "_Light":
        """Return the light of the sun at a place, if it casts shadows, and of the sky, from `trace_sky`."""
        sun = None
        if place in values.suns:
            k = values.suns.index(place)
            low, size = frame.sun_low[k : k + 1], frame.sun_size[k : k + 1]
            sun = sun_over(buffer.scene, sky, low, size, values.rooms[k], buffer.arrays)
        struct = shade.Light()
        struct.sun, struct.sky = gather_light(buffer, trace_sun(buffer, sun) if sun is not None else None, sky_light)
        return _Light(struct, sun)

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


def _sun_of(sky: Sky) -> SunPlace:
    """Return the unit vector to the sun of a sky; nothing where it does not shine."""
    return tuple(sky.sun_direction) if any(sky.sun_illuminance) else ()


def _reflections(
    buffer: SampleBuffer, found: shading.Surfaces, rays: ReflectedRays, sun: "candidates.Sun | None"
) -> reflection_kernels.Reflections:
    """Return reflected rays with the light of one place of the sun on what they hit."""
    reflections = reflection_kernels.Reflections()
    for name in ("row", "count", "samples", "surfaces", "sun"):
        setattr(reflections, name, getattr(rays.reflections, name))
    if sun is not None:
        reflections.sun = trace_reflection_sun(buffer, found, rays, sun)
    return reflections
