"""Trace inputs of the shading of a batch of images once for all weathers: surfaces, light, reflected rays."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import warp as wp

from mmw.core.packed_arrays import padded_count
from mmw.core.recorded_work import NewArrays
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
from mmw.scene.views import frame_rows
from mmw.sensors.render.camera import BLOCK_DIM, TILE
from mmw.sensors.render.row_lists import RowList, RowLists, empty_flags
from mmw.sensors.render.visibility_buffer import SampleBuffer, empty_candidates, empty_samples, no_count, no_rows

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
    found = _empty_surfaces(buffer.count, appearance, buffer.arrays)
    sends_ray = empty_flags(buffer.arrays, buffer.shading_threads)
    inputs = [buffer.scene.struct, appearance, buffer.picture]
    _shade(buffer, surfaces.surface_kernel, buffer.shading_threads, inputs, [found, sends_ray])
    return found, sends_ray


@dataclass(frozen=True)
class SunCells:
    """The grid square to a sun over the loaded batch of a scene."""

    low: np.ndarray
    """Corner of the first cell [m], shape [2]."""
    size: np.ndarray
    """Columns and rows, shape [2], int32."""
    room: int
    """Cells of all frames that there is room for."""


@lru_cache(maxsize=32)
def sun_plane(to_sun: tuple[float, ...]) -> np.ndarray:
    """Return two unit vectors square to the unit vector to the sun and to each other, shape [2, 3]."""
    axis = np.array(to_sun, dtype=np.float64)
    across = np.cross((0.0, 0.0, 1.0) if abs(axis[2]) < 0.9 else (1.0, 0.0, 0.0), axis)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(axis, across)])


def sun_margin(sky: Sky) -> float:
    """Return the margin of the discs around instances [m], see `SunGrid`."""
    return 2.0 * float(sky.sun_radius) * SUN_GRID_RANGE_M


def sun_cells(scene: DeviceScene, to_sun: tuple[float, ...], margin: float) -> SunCells:
    """Return the cells of a sun over the loaded batch of a scene.

    Args:
        scene: The scene.
        to_sun: Unit vector to the sun.
        margin: From `sun_margin` [m].
    """
    rows = frame_rows(scene.arrays, scene.batch_frames)
    places = (scene.arrays.poses[rows][:, scene.instance_actor, :3] - scene.origin) @ sun_plane(to_sun).T
    places = places[np.isfinite(places).all(axis=2)]
    low, size = np.zeros(2), np.zeros(2, dtype=np.int32)
    if len(places):
        around = scene.instance_radius_m + margin
        low, high = places.min(axis=0) - around, places.max(axis=0) + around
        size = np.ceil((high - low) / SUN_CELL_M).astype(np.int32)
    return SunCells(low.astype(np.float32), size, padded_count(scene.batch_size * int(size[0]) * int(size[1])))


def sun_over(
    scene: DeviceScene, sky: Sky, low: wp.array, size: wp.array, room: int, arrays: NewArrays
) -> candidates.Sun:
    """Return the sun of a weather over the loaded batch of a scene.

    Args:
        scene: The scene.
        sky: Sky of the weather.
        low: `SunCells.low` on the device, shape [1], vec2.
        size: `SunCells.size`, shape [1], vec2i.
        room: `SunCells.room`.
        arrays: Source of arrays.
    """
    plane = sun_plane(tuple(sky.sun_direction))
    grid = candidates.SunGrid()
    grid.across, grid.along = wp.vec3(*plane[0]), wp.vec3(*plane[1])
    grid.margin, grid.cell, grid.low, grid.size = sun_margin(sky), SUN_CELL_M, low, size
    instances = empty_candidates(room, scene, arrays)
    inputs = [scene.struct, grid, scene.batch_size]
    wp.launch(candidates.sun_candidates_kernel, room, inputs, [instances], device=scene.device)
    sun = candidates.Sun()
    sun.direction, sun.radius, sun.grid, sun.candidates = sky.sun_direction, sky.sun_radius, grid, instances
    return sun


def trace_sun(buffer: SampleBuffer, sun: candidates.Sun) -> wp.array:
    """Return the share of the sun in sight of every sample, before it is smoothed, in 255ths."""
    light = buffer.arrays.empty(buffer.count, wp.uint8)
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
    rays = buffer.arrays.empty(part, wp.uint8)
    launch = (views, -(-part[1] // TILE), -(-part[2] // TILE), BLOCK_DIM)
    _trace(buffer, lighting.sky_kernel, launch, [buffer.scene.struct, buffer.picture], [rays])
    for reach in SMOOTH_REACH:
        smooth = buffer.arrays.empty(part, wp.uint8)
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
    arrays = buffer.arrays
    rays = arrays.empty((0, 0, 0), wp.uint8) if sky is None else sky
    no_sun = arrays.empty(0, wp.uint8)
    smooth_sun = no_sun
    if sun is not None:
        smooth_sun = arrays.empty(len(sun), wp.uint8)
        wp.copy(smooth_sun, sun)
    smooth_sky = arrays.empty(0 if sky is None else buffer.extras.first, wp.uint8)
    if sun is not None or sky is not None:
        inputs = [buffer.picture, no_sun if sun is None else sun, rays, sun is not None]
        _shade(buffer, light_filter.gather_kernel, buffer.launch, inputs, [smooth_sun, smooth_sky])
    return smooth_sun, smooth_sky


@dataclass(frozen=True)
class ReflectedRays:
    """Reflected rays of a buffer and their hits."""

    number: wp.array
    """Reflected ray of each sample, -1 for none; empty where none is sent."""
    reflections: reflection_kernels.Reflections
    """Without the sun, which depends on where it stands: see `trace_reflection_sun`."""

    def __len__(self) -> int:
        """Return the rays that there is room for."""
        return len(self.reflections.row)


def find_reflections(
    buffer: SampleBuffer,
    appearance: shading.AppearanceTable,
    wet: Wet,
    found: shading.Surfaces,
    sends_ray: wp.array,
    lists: RowLists,
) -> RowList:
    """Return the samples that send a reflected ray."""
    if wet.wetness + wet.puddles > 0.0:
        inputs = [appearance, wet, buffer.picture, found]
        _trace(buffer, reflection_kernels.water_kernel, buffer.shading_threads, inputs, [sends_ray])
    return lists.list("reflected", buffer, sends_ray, buffer.shading_threads)


def trace_reflections(
    buffer: SampleBuffer, appearance: shading.AppearanceTable, found: shading.Surfaces, senders: RowList | None
) -> ReflectedRays:
    """Return the reflected rays of a buffer, none for None."""
    arrays, scene, picture = buffer.arrays, buffer.scene.struct, buffer.picture
    rays = reflection_kernels.Reflections()
    number = arrays.full(0 if senders is None else buffer.count, -1, int)
    if senders is None:
        senders = RowList(no_rows(buffer.scene.device), no_count(buffer.scene.device))
    rays.row, rays.count = senders.row, senders.count
    count = len(rays.row)
    rays.samples = empty_samples(count, arrays, with_surfaces=True)
    rays.surfaces = _empty_surfaces(count, appearance, arrays)
    rays.sun = arrays.empty(0, wp.uint8)
    _trace(buffer, reflection_kernels.reflection_number_kernel, count, [rays], [number])
    _trace(buffer, reflection_kernels.reflection_trace_kernel, count, [scene, picture, found, rays], [rays.samples])
    inputs = [scene, appearance, picture, found, rays]
    _trace(buffer, reflection_kernels.reflection_surface_kernel, count, inputs, [rays.surfaces])
    return ReflectedRays(number, rays)


def trace_reflection_sun(
    buffer: SampleBuffer, found: shading.Surfaces, rays: ReflectedRays, light: candidates.Sun
) -> wp.array:
    """Return 255 where the sun lights what a reflected ray hits, else 0."""
    sun = buffer.arrays.empty(len(rays), wp.uint8)
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
    arrays, scene = buffer.arrays, buffer.scene.struct
    image = arrays.empty(len(reflections.row), wp.vec3)
    radiance = arrays.empty(buffer.count, wp.vec3)
    extras, picture, threads = buffer.extras, buffer.picture, buffer.shading_threads
    reflected = [scene, weather, picture, found, reflections]
    _shade(buffer, shade.reflection_shade_kernel, len(reflections.row), reflected, [image])
    shared = [scene, weather, time, picture, found]
    _shade(buffer, shade.shade_kernel, threads, [*shared, light, image], [radiance])
    if with_lights:
        _shade(buffer, shade.lights_kernel, threads, shared, [radiance])
    mean = arrays.empty(len(extras.row), wp.vec3)
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


def _empty_surfaces(count: int, appearance: shading.AppearanceTable, arrays: NewArrays) -> shading.Surfaces:
    emission = count if appearance.has_emission_textures else 0
    return arrays.struct(shading.Surfaces, count, emission=emission)
