"""Trace the visibility buffer of camera views once for color, depth and segmentation in every weather."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
import warp as wp

from mmw.core.camera_models import Intrinsics
from mmw.core.recorded_work import NewArrays
from mmw.kernels.camera import camera as camera_kernels
from mmw.kernels.camera import depth as depth_kernels
from mmw.kernels.camera import image_samples as picture
from mmw.kernels.camera import instance_culling as candidate_kernels
from mmw.kernels.camera import visibility as kernels
from mmw.kernels.core import structs
from mmw.kernels.shading import structs as shading
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import Views
from mmw.sensors.render.camera import BLOCK_DIM, device_camera, tiles
from mmw.sensors.render.row_lists import RowList, RowLists, empty_flags

EXTRA_OFFSETS = {
    1: (),
    4: ((-0.301, 0.342), (-0.083, -0.392), (0.384, 0.050)),
    9: (
        (0.05, 0.27), (0.27, -0.05), (-0.05, -0.27), (-0.27, 0.05),
        (0.16, 0.44), (0.44, -0.16), (-0.16, -0.44), (-0.44, 0.16),
    ),
}  # fmt: skip
"""Samples in a pixel on an edge -> places of those beside its center [px]: all rows and columns differ, so that nearly
level and nearly upright edges are smooth too. Design values."""


ROOM_FOR_EXTRAS = 0.5
"""Further samples over pixel centers that there is room for from the start: in the shipped towns a third. Where more
come, all samples move."""


@dataclass(frozen=True)
class SampleBuffer:
    """The first surface in every pixel of a batch of views, on the device."""

    scene: DeviceScene
    views: Views
    on_device: structs.Views
    intrinsics: Intrinsics
    camera: camera_kernels.Camera
    samples: shading.Samples
    """Rows (view * H + v) * W + u of the pixel centers, A * H * W of them, those of `extras`, then room for more."""
    extras: shading.Extras
    """Further rays of pixels on edges; none unless asked for (`with_extras`)."""
    candidates: structs.Candidates
    """Instances that the rays of each tile can hit."""
    alpha_cutouts: "shading.AppearanceTable | None"
    """Appearance of a scene with cut-out textures."""
    arrays: NewArrays
    """Source of the arrays of what is made of it."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Views, rows and columns: [A, H, W]."""
        return (len(self.views), self.intrinsics.height, self.intrinsics.width)

    @property
    def threads(self) -> int:
        """Threads that work on the pixel centers, in whole tiles."""
        return int(np.prod(self.launch))

    @property
    def further(self) -> int:
        """Further samples that there is room for; see `Extras`."""
        return len(self.extras.row) * len(self.extras.offset)

    @property
    def count(self) -> int:
        """All samples that there is room for."""
        return self.extras.first + self.further

    @property
    def shading_threads(self) -> int:
        """Threads for all samples that are shaded."""
        return self.threads + len(self.extras.shaded)

    @cached_property
    def picture(self) -> picture.Picture:
        """Struct of it for kernels; what is set in `extras` later is not in it."""
        images = picture.Picture()
        images.views, images.camera = self.on_device, self.camera
        images.extras, images.samples = self.extras, self.samples
        return images

    @property
    def launch(self) -> tuple[int, int, int, int]:
        """Launch of one thread a pixel, in blocks of `BLOCK_DIM`."""
        return tiles(len(self.views), self.intrinsics)


def empty_samples(count: int, arrays: NewArrays, *, with_surfaces: bool) -> shading.Samples:
    """Return room for samples; `surface` and `normal` are empty unless asked for."""
    details = count if with_surfaces else 0
    return arrays.struct(shading.Samples, count, surface=details, normal=details)


def trace_samples(
    scene: DeviceScene,
    views: Views,
    intrinsics: Intrinsics,
    range_m: float,
    alpha_cutouts: "shading.AppearanceTable | None" = None,
    *,
    with_surfaces: bool = True,
    arrays: NewArrays | None = None,
    on_device: "structs.Views | None" = None,
    further: int | None = None,
) -> SampleBuffer:
    """Trace one ray through the center of every pixel, (u + 0.5, v + 0.5).

    Args:
        scene: Town and vehicles, with the views' frames loaded.
        views: Camera poses (x along the optical axis, y left, z up), A rows.
        intrinsics: Image size, focal length and lens.
        range_m: Longest depth along the optical axis [m].
        alpha_cutouts: Appearance of a scene with cut-out textures, whose holes rays pass; None where it has none.
        with_surfaces: Keep surface ids and normals too, which pictures need and depth does not.
        arrays: Source of arrays; new ones if absent.
        on_device: The views on the device, if they are there.
        further: Further samples that there is room for, if not `ROOM_FOR_EXTRAS`.

    Raises:
        ValueError: If a view's frame is not loaded in the scene.
    """
    arrays = arrays or NewArrays(scene.device)
    count = len(views) * intrinsics.height * intrinsics.width
    nothing = RowList(no_rows(scene.device), no_count(scene.device))
    if further is None:
        further = int(ROOM_FOR_EXTRAS * count) if with_surfaces else 0
    samples = empty_samples(count + further, arrays, with_surfaces=with_surfaces)
    camera = device_camera(intrinsics, range_m)
    if on_device is None:
        on_device = views.for_scene(scene)
    candidates = _tile_candidates(scene, on_device, len(views), intrinsics, camera, arrays)
    none = _extras(count, nothing, ())
    buffer = SampleBuffer(scene, views, on_device, intrinsics, camera, samples, none, candidates, alpha_cutouts, arrays)
    _trace(buffer, 0, buffer.threads)
    return buffer


def empty_candidates(groups: int, scene: DeviceScene, arrays: NewArrays) -> structs.Candidates:
    """Return room for the instances that groups of rays can hit, with none."""
    shape = (groups, max(scene.struct.instance_count, 1))
    candidates = arrays.struct(structs.Candidates, groups, instance=shape)
    if groups:
        candidates.count.zero_()
    return candidates


def _tile_candidates(
    scene: DeviceScene,
    views: structs.Views,
    count: int,
    intrinsics: Intrinsics,
    camera: camera_kernels.Camera,
    arrays: NewArrays,
) -> structs.Candidates:
    shape = tiles(count, intrinsics)[:3]
    candidates = empty_candidates(int(np.prod(shape)), scene, arrays)
    if count and scene.struct.instance_count:
        kernel, inputs = candidate_kernels.tile_candidates_kernel, [scene.struct, views, camera]
        wp.launch(kernel, shape, inputs, [candidates], device=scene.device)
    return candidates


def _extras(first: int, edges: RowList, offsets: tuple) -> shading.Extras:
    """Return the further rays of the pixels of some rows, before it is known whose light they bring."""
    device = str(edges.row.device)
    extras = shading.Extras()
    extras.first, extras.row, extras.count = first, edges.row, edges.count
    extras.offset = _offsets(offsets, device)
    extras.source = extras.shaded = no_rows(device)
    extras.shaded_count = no_count(device)
    return extras


@cache
def _offsets(offsets: tuple, device: str) -> wp.array:
    at = np.array(offsets, dtype=np.float32).reshape(-1, 2)
    return wp.array(at, dtype=wp.vec2, device=device)


@cache
def no_rows(device: str) -> wp.array:
    """Return an array of row numbers without any."""
    return wp.empty(0, dtype=int, device=device)


@cache
def no_count(device: str) -> wp.array:
    """Return the number of rows of a list without any, shape [1]."""
    return wp.zeros(1, dtype=int, device=device)


def _trace(buffer: SampleBuffer, first: int, threads: int) -> None:
    """Trace the samples of some threads."""
    if threads:
        scene, device = buffer.scene.struct, buffer.scene.device
        kernel, inputs = kernels.visibility_kernel, [scene, buffer.picture, buffer.candidates, first]
        if buffer.alpha_cutouts is not None:
            kernel = kernels.visibility_through_holes_kernel
            inputs = [scene, buffer.alpha_cutouts, buffer.picture, first]
        wp.launch(kernel, dim=threads, inputs=inputs, outputs=[buffer.samples], device=device, block_dim=BLOCK_DIM)


def depth_images(
    buffer: SampleBuffer, *, with_metres: bool, with_objects: bool, range_m: float | None = None
) -> depth_kernels.DepthImages:
    """Return depth and objects of what the pixels see, on the scene's device.

    Depth is measured along the optical axis, so a wall square to it has one depth everywhere. Depths below 5 mm read
    1 cm, since 0 means no return; depths beyond 655.35 m are 0 in centimeters.

    Args:
        buffer: What the pixels see.
        with_metres: Fill `depth_m`, which is empty otherwise.
        with_objects: Fill `object_id`, which is empty otherwise.
        range_m: Longest depth [m], at most that of the buffer, which it is if absent.
    """
    shape, none, device = buffer.shape, (0, 0, 0), buffer.scene.device
    metres, objects = shape if with_metres else none, shape if with_objects else none
    images = buffer.arrays.struct(depth_kernels.DepthImages, shape, depth_m=metres, object_id=objects)
    if len(buffer.views):
        longest = buffer.camera.range if range_m is None else range_m
        inputs = [buffer.scene.struct, buffer.camera, buffer.samples, longest]
        wp.launch(depth_kernels.depth_kernel, buffer.launch, inputs, [images], device=device, block_dim=BLOCK_DIM)
    return images


def with_extras(buffer: SampleBuffer, per_pixel: int, lists: RowLists) -> SampleBuffer:
    """Return a buffer with further rays through the pixels on edges, after the pixel centers in its samples.

    The pixel centers are those of the other buffer, not a copy, while there is room behind them.

    Args:
        buffer: What the pixel centers see, with surfaces.
        per_pixel: Samples in a pixel on an edge, a key of `EXTRA_OFFSETS` above 1.
        lists: Lists of the launch.
    """
    arrays, scene = buffer.arrays, buffer.scene.struct
    is_edge = empty_flags(arrays, buffer.threads)
    _launch(kernels.edge_kernel, buffer.threads, [scene, buffer.picture], [is_edge])
    edges = lists.list("edges", buffer, is_edge, buffer.threads)
    extras = _extras(buffer.count, edges, EXTRA_OFFSETS[per_pixel])
    both = replace(buffer, extras=extras)
    if both.count > len(buffer.samples.t):
        both = replace(both, samples=empty_samples(both.count, arrays, with_surfaces=True))
        for name in ("t", "face", "instance", "surface", "normal"):
            wp.copy(getattr(both.samples, name), getattr(buffer.samples, name), count=buffer.count)
    extras.source = arrays.empty(both.further, int)
    is_traced = empty_flags(arrays, both.further)
    if buffer.alpha_cutouts is None:
        _launch(kernels.guess_kernel, both.further, [scene, both.picture], [extras.source, is_traced])
    else:
        _launch(kernels.trace_all_kernel, both.further, [extras], [extras.source, is_traced])
    traced = lists.list("traced", both, is_traced, both.further, buffer.threads)
    extras.shaded, extras.shaded_count = traced.row, traced.count
    both = replace(both)
    _trace(both, buffer.threads, len(traced))
    is_shaded = empty_flags(arrays, len(traced))
    _launch(kernels.source_kernel, len(traced), [scene, both.picture], [extras.source, is_shaded])
    shaded = lists.list("shaded", both, is_shaded, len(traced), buffer.threads)
    extras.shaded, extras.shaded_count = shaded.row, shaded.count
    return replace(both)


def _launch(kernel: wp.Kernel, threads: int, inputs: list, outputs: list) -> None:
    if threads:
        wp.launch(kernel, dim=threads, inputs=inputs, outputs=outputs, device=outputs[0].device, block_dim=BLOCK_DIM)
