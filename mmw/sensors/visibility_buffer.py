"""What the pixels of a batch of camera views see, traced once for colour, depth and segmentation in every weather."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from mmw.kernels import camera as camera_kernels
from mmw.kernels import candidates as candidate_kernels
from mmw.kernels import depth as depth_kernels
from mmw.kernels import looks, structs
from mmw.kernels import visibility as kernels
from mmw.lens import Intrinsics
from mmw.scene import Scene
from mmw.sensors.camera import BLOCK_DIM, device_camera, tiles
from mmw.views import Views

EXTRA_OFFSETS = {
    1: (),
    4: ((-0.301, 0.342), (-0.083, -0.392), (0.384, 0.050)),
    9: (
        (0.05, 0.27), (0.27, -0.05), (-0.05, -0.27), (-0.27, 0.05),
        (0.16, 0.44), (0.44, -0.16), (-0.16, -0.44), (-0.44, 0.16),
    ),
}  # fmt: skip
"""Samples in a pixel on an edge -> places of those beside its centre [px]: all rows and columns differ, so that nearly
level and nearly upright edges are smooth too. Design values."""


@dataclass(frozen=True)
class SampleBuffer:
    """The first surface in every pixel of a batch of views, on the device."""

    scene: Scene
    views: Views
    on_device: structs.Views
    intrinsics: Intrinsics
    camera: camera_kernels.Camera
    samples: looks.Samples
    """Rows (view * H + v) * W + u of the pixel centres, A * H * W of them, then those of `extras`."""
    extras: looks.Extras
    """Further rays of pixels on edges; none unless asked for (`with_extras`)."""
    candidates: structs.Candidates
    """Instances that the rays of each tile can meet."""
    cut_outs: "looks.Appearance | None"
    """Appearance of a scene with cut-out textures."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Views, rows and columns: [A, H, W]."""
        return (len(self.views), self.intrinsics.height, self.intrinsics.width)

    @property
    def threads(self) -> int:
        """Threads that work on the pixel centres, in whole tiles."""
        return int(np.prod(self.launch))

    @property
    def launch(self) -> tuple[int, int, int, int]:
        """Launch of one thread a pixel, in blocks of `BLOCK_DIM`."""
        return tiles(len(self.views), self.intrinsics)


def empty_samples(count: int, device: str, *, with_surfaces: bool) -> looks.Samples:
    """Return room for samples on a device; `surface` and `normal` are empty unless asked for."""
    samples = looks.Samples()
    samples.t = wp.empty(count, dtype=float, device=device)
    samples.face = wp.empty(count, dtype=int, device=device)
    samples.instance = wp.empty(count, dtype=int, device=device)
    samples.surface = wp.empty(count if with_surfaces else 0, dtype=int, device=device)
    samples.normal = wp.empty(count if with_surfaces else 0, dtype=wp.uint32, device=device)
    return samples


def trace_samples(
    scene: Scene,
    views: Views,
    intrinsics: Intrinsics,
    range_m: float,
    cut_outs: "looks.Appearance | None" = None,
    *,
    with_surfaces: bool = True,
) -> SampleBuffer:
    """Trace one ray through the centre of every pixel, (u + 0.5, v + 0.5).

    Args:
        scene: Town and vehicles, with the views' frames loaded.
        views: Camera poses (x along the optical axis, y left, z up), A rows.
        intrinsics: Image size, focal length and lens.
        range_m: Longest depth along the optical axis [m].
        cut_outs: Appearance of a scene with cut-out textures, whose holes rays pass; None where it has none.
        with_surfaces: Keep surface ids and normals too, which pictures need and depth does not.

    Raises:
        ValueError: If a view's frame is not loaded in the scene.
    """
    count = len(views) * intrinsics.height * intrinsics.width
    none = looks.Extras()
    none.first = count
    none.row = wp.empty(0, dtype=int, device=scene.device)
    none.offset = wp.empty(0, dtype=wp.vec2, device=scene.device)
    samples = empty_samples(count, scene.device, with_surfaces=with_surfaces)
    camera = device_camera(intrinsics, range_m)
    on_device = views.for_scene(scene)
    met = _tile_candidates(scene, on_device, len(views), intrinsics, camera)
    buffer = SampleBuffer(scene, views, on_device, intrinsics, camera, samples, none, met, cut_outs)
    _trace(buffer, 0, buffer.threads)
    return buffer


def empty_candidates(groups: int, scene: Scene) -> structs.Candidates:
    """Return room for the instances that groups of rays can meet."""
    met = structs.Candidates()
    met.count = wp.zeros(groups, dtype=int, device=scene.device)
    met.instance = wp.empty((groups, max(scene.struct.instance_count, 1)), dtype=wp.int16, device=scene.device)
    return met


def _tile_candidates(
    scene: Scene, views: structs.Views, count: int, intrinsics: Intrinsics, camera: camera_kernels.Camera
) -> structs.Candidates:
    shape = tiles(count, intrinsics)[:3]
    met = empty_candidates(int(np.prod(shape)), scene)
    if count and scene.struct.instance_count:
        wp.launch(
            candidate_kernels.tile_candidates_kernel, dim=shape, inputs=[scene.struct, views, camera], outputs=[met],
            device=scene.device,
        )  # fmt: skip
    return met


def _trace(buffer: SampleBuffer, first: int, threads: int) -> None:
    """Trace the samples of some threads."""
    if threads:
        scene, device = buffer.scene.struct, buffer.scene.device
        seen = [buffer.on_device, buffer.camera, buffer.extras]
        if buffer.cut_outs is None:
            kernel, inputs = kernels.visibility_kernel, [scene, *seen, buffer.candidates, first]
        else:
            kernel, inputs = kernels.visibility_through_holes_kernel, [scene, buffer.cut_outs, *seen, first]
        wp.launch(kernel, dim=threads, inputs=inputs, outputs=[buffer.samples], device=device, block_dim=BLOCK_DIM)


def depth_images(
    buffer: SampleBuffer, *, with_metres: bool, with_objects: bool, range_m: float | None = None
) -> depth_kernels.DepthImages:
    """Return depth and objects of what the pixels see, on the scene's device.

    Depth is measured along the optical axis, so a wall square to it has one depth everywhere. Depths below 5 mm read
    1 cm, since 0 means no return; depths beyond 655.35 m are 0 in centimetres.

    Args:
        buffer: What the pixels see.
        with_metres: Fill `depth_m`, which is empty otherwise.
        with_objects: Fill `object_id`, which is empty otherwise.
        range_m: Longest depth [m], at most that of the buffer, which it is if absent.
    """
    shape, none, device = buffer.shape, (0, 0, 0), buffer.scene.device
    images = depth_kernels.DepthImages()
    images.depth = wp.empty(shape, dtype=wp.uint16, device=device)
    images.depth_m = wp.empty(shape if with_metres else none, dtype=float, device=device)
    images.object_id = wp.empty(shape if with_objects else none, dtype=int, device=device)
    if len(buffer.views):
        wp.launch(
            depth_kernels.depth_kernel,
            dim=buffer.launch,
            inputs=[
                buffer.scene.struct,
                buffer.camera,
                buffer.samples,
                buffer.camera.range if range_m is None else range_m,
            ],
            outputs=[images],
            device=device,
            block_dim=BLOCK_DIM,
        )
    return images


def with_extras(buffer: SampleBuffer, per_pixel: int) -> SampleBuffer:
    """Return a buffer with further rays through the pixels on edges, after the pixel centres in its samples.

    Args:
        buffer: What the pixel centres see, with surfaces.
        per_pixel: Samples in a pixel on an edge, a key of `EXTRA_OFFSETS`; 1 finds no edges.
    """
    device, count = buffer.scene.device, len(buffer.samples.t)
    offsets = np.array(EXTRA_OFFSETS[per_pixel], dtype=np.float32).reshape(-1, 2)
    if not count or not len(offsets):
        return buffer
    row = flagged_rows(
        buffer,
        buffer.threads,
        kernels.edge_kernel,
        [buffer.scene.struct, buffer.on_device, buffer.camera, buffer.samples],
    )
    extras = looks.Extras()
    extras.first = count
    extras.row = row
    extras.offset = wp.array(offsets, dtype=wp.vec2, device=device)
    samples = empty_samples(count + len(row) * len(offsets), device, with_surfaces=True)
    for name in ("t", "face", "instance", "surface", "normal"):
        wp.copy(getattr(samples, name), getattr(buffer.samples, name), count=count)
    both = replace(buffer, samples=samples, extras=extras)
    _trace(both, buffer.threads, len(row) * len(offsets))
    return both


def flagged_rows(buffer: SampleBuffer, threads: int, kernel: wp.Kernel, inputs: list) -> wp.array:
    """Return the rows of the samples that a kernel flags, in the order of its threads.

    Args:
        buffer: What the pixels see.
        threads: Threads of the kernel.
        kernel: Writes 1 or 0 for every thread.
        inputs: Of the kernel.
    """
    device = buffer.scene.device
    flag = wp.empty(threads, dtype=int, device=device)
    number = wp.empty(threads, dtype=int, device=device)
    wp.launch(kernel, dim=threads, inputs=inputs, outputs=[flag], device=device, block_dim=BLOCK_DIM)
    wp.utils.array_scan(flag, number, inclusive=False)
    count = int(number[-1:].numpy()[0]) + int(flag[-1:].numpy()[0])
    row = wp.empty(count, dtype=int, device=device)
    if count:
        wp.launch(
            kernels.flagged_row_kernel, dim=threads, inputs=[buffer.camera, len(buffer.views), flag, number],
            outputs=[row], device=device, block_dim=BLOCK_DIM,
        )  # fmt: skip
    return row
