"""Trace inputs of the shading of a batch of images once for all weathers: surfaces, light, reflected rays."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.kernels.camera import instance_culling as candidates
from mmw.kernels.shading import denoise as light_filter
from mmw.kernels.shading import reflections as reflection_kernels
from mmw.kernels.shading import shade
from mmw.kernels.shading import shadows as lighting
from mmw.kernels.shading import structs as shading
from mmw.kernels.shading import surface_samples as surfaces
from mmw.kernels.shading.sky import Sky
from mmw.kernels.shading.wet_surfaces import Wet
from mmw.scene.device_scene import DeviceScene
from mmw.sensors.ray_batch import empty_struct
from mmw.sensors.render.camera import BLOCK_DIM, TILE
from mmw.sensors.render.visibility_buffer import FlaggedRows, SampleBuffer, empty_candidates, empty_flags, empty_samples

SUN_CELL_M = 16.0
"""Side of the cells of the grid square to the sun [m]. Design value: some lengths of a car."""

SUN_GRID_RANGE_M = 500.0
"""Distance between an instance and what it shades [m] up to which the whole of the sun's disc counts: the shadow of
what is farther away is too soft to see."""

SHADING_BLOCK_DIM = 256
"""Threads of a block of kernels in files that cast no ray: 12 % faster than with `BLOCK_DIM` on an H100."""

SKY_STEP = int(lighting.SKY_STEP)
"""Pixels between rays to the sky."""

SMOOTH_REACH = (1, 4)
"""Rays apart that the passes of the sky's filter average; the first takes all of 4 x 4 directions once. Design
values."""


def read_surfaces(buffer: SampleBuffer, appearance: shading.AppearanceTable) -> tuple[shading.Surfaces, wp.array]:
    """Return what every sample shows, and flags of the threads whose samples reflect sharply while they are dry."""
    found = _empty_surfaces(buffer.count, appearance, buffer.scene.device)
    sends_ray = empty_flags(buffer.shading_threads, buffer.scene.device)
    inputs = [buffer.scene.struct, appearance, buffer.picture]
    _shade(buffer, surfaces.surface_kernel, buffer.shading_threads, inputs, [found, sends_ray])
    return found, sends_ray


def sun_over(scene: DeviceScene, sky: Sky) -> candidates.Sun:
    """Return the sun of a weather over the loaded batch of a scene."""
    to_sun = np.array(sky.sun_direction, dtype=np.float64)
    across = np.cross((0.0, 0.0, 1.0) if abs(to_sun[2]) < 0.9 else (1.0, 0.0, 0.0), to_sun)
    across /= np.linalg.norm(across)
    plane = np.stack([across, np.cross(to_sun, across)])
    rows = [scene.arrays.frame_row(frame) for frame in scene.batch_frames]
    places = (scene.arrays.poses[rows][:, scene.instance_actor, :3] - scene.origin) @ plane.T
    places = places[np.isfinite(places).all(axis=2)]
    grid = candidates.SunGrid()
    grid.across, grid.along = wp.vec3(*plane[0]), wp.vec3(*plane[1])
    grid.margin = 2.0 * float(sky.sun_radius) * SUN_GRID_RANGE_M
    grid.cell, grid.low, grid.columns, grid.rows = SUN_CELL_M, wp.vec2(), 0, 0
    if len(places):
        around = scene.instance_radius_m + grid.margin
        low, high = places.min(axis=0) - around, places.max(axis=0) + around
        grid.low = wp.vec2(*low)
        grid.columns, grid.rows = (int(n) for n in np.ceil((high - low) / SUN_CELL_M))
    instances = empty_candidates(scene.batch_size * grid.rows * grid.columns, scene)
    if grid.columns:
        kernel, cells = candidates.sun_candidates_kernel, (scene.batch_size, grid.rows, grid.columns)
        wp.launch(kernel, cells, [scene.struct, grid], [instances], device=scene.device)
    sun = candidates.Sun()
    sun.direction, sun.radius, sun.grid, sun.candidates = sky.sun_direction, sky.sun_radius, grid, instances
    return sun


def trace_sun(buffer: SampleBuffer, sun: candidates.Sun) -> wp.array:
    """Return the share of the sun in sight of every sample, before it is smoothed, in 255ths."""
    light = wp.empty(buffer.count, dtype=wp.uint8, device=buffer.scene.device)
    views, height, width = buffer.shape
    half = (views, -(-height // TILE), -(-width // (2 * TILE)), BLOCK_DIM)
    scene, picture, further = buffer.scene.struct, buffer.picture, len(buffer.extras.shaded)
    _trace(buffer, lighting.sun_kernel, half, [scene, picture, sun], [light])
    _trace(buffer, lighting.sun_between_kernel, half, [scene, picture, sun], [light])
    _trace(buffer, lighting.further_sun_kernel, further, [scene, picture, sun, buffer.threads], [light])
    return light


def trace_sky(buffer: SampleBuffer) -> wp.array:
    """Return the share of the sky in sight, in 255ths, at every `SKY_STEP`-th pixel of every such line."""
    views, height, width = buffer.shape
    part = (views, -(-height // SKY_STEP), -(-width // SKY_STEP))
    device = buffer.scene.device
    rays = wp.empty(part, dtype=wp.uint8, device=device)
    launch = (views, -(-part[1] // TILE), -(-part[2] // TILE), BLOCK_DIM)
    _trace(buffer, lighting.sky_kernel, launch, [buffer.scene.struct, buffer.picture], [rays])
    for reach in SMOOTH_REACH:
        smooth = wp.empty(part, dtype=wp.uint8, device=device)
        _shade(buffer, light_filter.smooth_sky_kernel, launch, [buffer.picture, rays, reach], [smooth])
        rays = smooth
    return rays


def gather_light(buffer: SampleBuffer, sun: wp.array | None, sky: wp.array | None) -> tuple[wp.array, wp.array]:
    """Return sun and sky of every sample; the sky of pixel centers alone. What is None is empty.

    Args:
        buffer: What the pixels see.
        sun: From `trace_sun`.
        sky: From `trace_sky`.
    """
    device = buffer.scene.device
    rays = wp.empty((0, 0, 0), dtype=wp.uint8, device=device) if sky is None else sky
    no_sun = wp.empty(0, dtype=wp.uint8, device=device)
    smooth_sun = no_sun if sun is None else wp.clone(sun)
    smooth_sky = wp.empty(0 if sky is None else buffer.extras.first, dtype=wp.uint8, device=device)
    if sun is not None or sky is not None:
        inputs = [buffer.picture, no_sun if sun is None else sun, rays, sun is not None]
        _shade(buffer, light_filter.gather_kernel, buffer.launch, inputs, [smooth_sun, smooth_sky])
    return smooth_sun, smooth_sky


@dataclass(frozen=True)
class ReflectedRays:
    """Reflected rays of a buffer and their hits."""

    number: wp.array
    """Reflected ray of each sample, -1 for none; empty where none was sent."""
    reflections: reflection_kernels.Reflections
    """Without the sun, which depends on where it stands: see `trace_reflection_sun`."""

    def __len__(self) -> int:
        return len(self.reflections.row)


def find_reflections(
    buffer: SampleBuffer, appearance: shading.AppearanceTable, wet: Wet, found: shading.Surfaces, sends_ray: wp.array
) -> FlaggedRows:
    """Return the samples that send a reflected ray."""
    if wet.wetness + wet.puddles > 0.0:
        inputs = [appearance, wet, buffer.picture, found]
        _trace(buffer, reflection_kernels.water_kernel, buffer.shading_threads, inputs, [sends_ray])
    return FlaggedRows(buffer, sends_ray)


def trace_reflections(
    buffer: SampleBuffer, appearance: shading.AppearanceTable, found: shading.Surfaces, senders: FlaggedRows | None
) -> ReflectedRays:
    """Return the reflected rays of a buffer."""
    device, scene, picture = buffer.scene.device, buffer.scene.struct, buffer.picture
    rays = reflection_kernels.Reflections()
    number = wp.full(buffer.count if senders else 0, -1, dtype=int, device=device)
    rays.row = senders.listed() if senders else wp.empty(0, dtype=int, device=device)
    count = len(rays.row)
    rays.samples = empty_samples(count, device, with_surfaces=True)
    rays.surfaces = _empty_surfaces(count, appearance, device)
    rays.sun = wp.empty(0, dtype=wp.uint8, device=device)
    _trace(buffer, reflection_kernels.reflection_number_kernel, count, [rays.row], [number])
    _trace(buffer, reflection_kernels.reflection_trace_kernel, count, [scene, picture, found, rays.row], [rays.samples])
    inputs = [scene, appearance, picture, found, rays]
    _trace(buffer, reflection_kernels.reflection_surface_kernel, count, inputs, [rays.surfaces])
    return ReflectedRays(number, rays)


def trace_reflection_sun(
    buffer: SampleBuffer, found: shading.Surfaces, rays: ReflectedRays, light: candidates.Sun
) -> wp.array:
    """Return 255 where the sun lights what a reflected ray hits, else 0."""
    sun = wp.empty(len(rays), dtype=wp.uint8, device=buffer.scene.device)
    inputs = [buffer.scene.struct, buffer.picture, found, rays.reflections, light]
    _trace(buffer, reflection_kernels.reflection_sun_kernel, len(rays), inputs, [sun])
    return sun


def shade_samples(
    buffer: SampleBuffer,
    weather: shade.Weather,
    time: wp.array,
    found: shading.Surfaces,
    light: shade.Light,
    reflections: reflection_kernels.Reflections,
    *,
    with_lights: bool,
) -> wp.array:
    """Return the luminance that reaches every pixel [kcd/m2], shape [A, H, W], vec3.

    Args:
        buffer: What the pixels see.
        weather: The weather.
        time: Of each view's frame [s], shape [A].
        found: Surfaces of the samples.
        light: Light that reaches them.
        reflections: Hits of reflected rays.
        with_lights: Add the light of vehicles and streets.
    """
    device, scene = buffer.scene.device, buffer.scene.struct
    image = wp.empty(len(reflections.row), dtype=wp.vec3, device=device)
    radiance = wp.empty(buffer.count, dtype=wp.vec3, device=device)
    extras, picture, threads = buffer.extras, buffer.picture, buffer.shading_threads
    reflected = [scene, weather, picture, found, reflections]
    _shade(buffer, shade.reflection_shade_kernel, len(reflections.row), reflected, [image])
    shared = [scene, weather, time, picture, found]
    _shade(buffer, shade.shade_kernel, threads, [*shared, light, image], [radiance])
    if with_lights:
        _shade(buffer, shade.lights_kernel, threads, shared, [radiance])
    mean = wp.empty(len(extras.row), dtype=wp.vec3, device=device)
    _shade(buffer, shade.resolve_kernel, len(extras.row), [extras, radiance], [mean])
    _shade(buffer, shade.put_back_kernel, len(extras.row), [extras, mean], [radiance])
    return radiance[: extras.first].reshape(buffer.shape)


def _trace(buffer: SampleBuffer, kernel: wp.Kernel, dim: int | tuple[int, ...], inputs: list, outputs: list) -> None:
    """Launch a kernel of a file that traces rays."""
    if not isinstance(dim, int) or dim:
        wp.launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device=buffer.scene.device, block_dim=BLOCK_DIM)


def _shade(buffer: SampleBuffer, kernel: wp.Kernel, dim: int | tuple[int, ...], inputs: list, outputs: list) -> None:
    """Launch a kernel of a file that traces none."""
    if not isinstance(dim, int) or dim:
        device = buffer.scene.device
        wp.launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device=device, block_dim=SHADING_BLOCK_DIM)


def _empty_surfaces(count: int, appearance: shading.AppearanceTable, device: str) -> shading.Surfaces:
    emission = count if appearance.has_emission_textures else 0
    return empty_struct(shading.Surfaces, count, device, emission=emission)
