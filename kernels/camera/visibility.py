"""Trace the first hits of all pixels of a camera once for color, depth, segmentation and all weathers."""

import warp as wp

from mmw.kernels.camera.camera import Camera
from mmw.kernels.camera.image_samples import Picture, SampleRay, ray_at, ray_of, row_of_thread, sample_row, tile_of
from mmw.kernels.core.compiler import PICTURE_RAYS
from mmw.kernels.core.faces import material_of
from mmw.kernels.core.packing import pack_unit, unpack_unit
from mmw.kernels.core.structs import Candidates, RawHit, Scene
from mmw.kernels.core.trace import (
    PICTURE_REGISTERS,
    closest_hit_raw,
    closest_hit_raw_among,
    object_of,
    surface_of,
    world_normal,
)
from mmw.kernels.shading.structs import AppearanceTable, Extras, Samples
from mmw.kernels.shading.surface_point import distance_to_face, is_cut_out, ray_hit

wp.set_module_options(PICTURE_RAYS)

FOLD = wp.constant(0.7)
"""Cosine between the normals of two faces of one object below which the line between them is drawn smoothly: 45 deg."""

STEP = wp.constant(0.02)
"""Distance of a neighbor from the plane of a pixel's surface, over its range, from which there is an edge [-]."""

MAX_HOLES = wp.constant(16)
"""Holes of cut-out textures that one ray passes at most; behind so many leaves the last one is taken for solid."""

PAST_HOLE = wp.constant(1.0e-4)
"""A ray goes on this far behind a hole, over the distance so far and at least of 1 m [-]."""


@wp.func
def ray_length(camera: Camera, forward: float) -> float:
    """Return the longest distance along a ray whose direction has this part along the optical axis [m].

    Depth ends at `Camera.range`; rays more than 89 deg from the axis, which only a fisheye has, end where those do.
    """
    return camera.range / wp.max(forward, 0.02)


@wp.func
def store(
    scene: Scene, batch_index: int, near: RawHit, direction: wp.vec3, row: int,
    # out
    samples_out: Samples,
):  # fmt: skip
    """Write what a ray hit to a row of the samples."""
    samples_out.t[row] = near.t
    samples_out.face[row] = near.face
    samples_out.instance[row] = near.instance
    if samples_out.surface.shape[0] > 0:
        samples_out.surface[row] = surface_of(scene, near)
        normal = wp.vec3(0.0, 0.0, 1.0)
        if near.face >= 0:
            normal = world_normal(scene, batch_index, near)
            if wp.dot(normal, normal) < 0.5:  # a face without area
                normal = -direction
            normal = wp.where(wp.dot(normal, direction) > 0.0, -normal, normal)
        samples_out.normal[row] = pack_unit(normal)


@wp.kernel(cuda_max_registers=PICTURE_REGISTERS)
def visibility_kernel(
    scene: Scene,
    picture: Picture,
    candidates: Candidates,
    thread_offset: int,
    # out
    samples_out: Samples,
):
    """Trace the rays of samples: pixel centers, or with an offset of the thread those of pixels on edges.

    Launch: dim=threads, block_dim=64.
    """
    row = row_of_thread(picture, wp.tid() + thread_offset)
    if row < 0:
        return
    ray = ray_of(picture, row)
    near = closest_hit_raw_among(
        scene, ray.batch_index, ray.origin, ray.direction, ray_length(picture.camera, ray.forward),
        picture.views.ignore[ray.view], candidates, tile_of(picture.camera, ray),
    )  # fmt: skip
    store(scene, ray.batch_index, near, ray.direction, row, samples_out)


@wp.kernel
def visibility_through_holes_kernel(
    scene: Scene,
    table: AppearanceTable,
    picture: Picture,
    thread_offset: int,
    # out
    samples_out: Samples,
):
    """Trace the rays of samples in a scene with cut-out textures, whose holes they pass; see `visibility_kernel`.

    Launch: dim=threads, block_dim=64.
    """
    row = row_of_thread(picture, wp.tid() + thread_offset)
    if row < 0:
        return
    ray = ray_of(picture, row)
    ignore = picture.views.ignore[ray.view]
    t_max = ray_length(picture.camera, ray.forward)
    near = closest_hit_raw(scene, ray.batch_index, ray.origin, ray.direction, t_max, ignore)
    behind = wp.float32(0.0)
    for _ in range(MAX_HOLES):
        is_hole = wp.bool(False)
        if near.face >= 0:
            t = behind + near.t
            hit = ray_hit(ray.batch_index, ray.origin, ray.direction, t, near.face, near.instance)
            is_hole = is_cut_out(scene, table, hit, 1.0 / picture.camera.fx)
        if not is_hole:
            break
        behind += near.t + PAST_HOLE * wp.max(1.0, behind + near.t)
        start = ray.origin + behind * ray.direction
        near = closest_hit_raw(scene, ray.batch_index, start, ray.direction, t_max - behind, ignore)
    near.t += behind
    store(scene, ray.batch_index, near, ray.direction, row, samples_out)


@wp.func
def stored_hit(samples: Samples, row: int) -> RawHit:
    """Return a stored sample as the tracer found it, without its normal."""
    near = RawHit()
    near.t = samples.t[row]
    near.face = samples.face[row]
    near.instance = samples.instance[row]
    return near


@wp.func
def is_other_thing(scene: Scene, samples: Samples, row: int, other: int) -> wp.bool:
    """Return whether two samples show different objects or materials, or two sides of a fold."""
    near = stored_hit(samples, row)
    next_to = stored_hit(samples, other)
    if near.face < 0 or next_to.face < 0:
        return True
    if object_of(scene, near) != object_of(scene, next_to):
        return True
    if material_of(scene, near.face, near.instance) != material_of(scene, next_to.face, next_to.instance):
        return True
    return wp.dot(unpack_unit(samples.normal[row]), unpack_unit(samples.normal[other])) < FOLD


@wp.func
def is_step(samples: Samples, row: int, other: int, ray: SampleRay, beside: SampleRay) -> wp.bool:
    """Return whether what one sample shows lies before or behind the surface of the other."""
    t = samples.t[row]
    normal = unpack_unit(samples.normal[row])
    return wp.abs(wp.dot(samples.t[other] * beside.direction - t * ray.direction, normal)) > STEP * t


@wp.kernel
def edge_kernel(
    scene: Scene,
    picture: Picture,
    # out
    is_edge_out: wp.array[wp.uint8],
):
    """Find the pixels that a line crosses: those whose neighbor shows another object, material, fold or depth.

    Launch: dim=threads of all tiles, block_dim=64; a thread's flag has its number.
    """
    thread = wp.tid()
    row = row_of_thread(picture, thread)
    is_edge_out[thread] = wp.uint8(0)
    if row < 0:
        return
    camera = picture.camera
    samples = picture.samples
    surface = samples.surface[row]
    line = row // camera.width
    view = line // camera.height
    u = row - line * camera.width
    v = line - view * camera.height
    is_edge = wp.bool(False)
    for side in range(4):
        beside_u = u + wp.where(side == 0, 1, 0) - wp.where(side == 1, 1, 0)
        beside_v = v + wp.where(side == 2, 1, 0) - wp.where(side == 3, 1, 0)
        if not is_edge and beside_u >= 0 and beside_v >= 0 and beside_u < camera.width and beside_v < camera.height:
            other = sample_row(camera, view, beside_u, beside_v)
            if samples.surface[other] != surface:
                is_edge = is_other_thing(scene, samples, row, other)
                if not is_edge:
                    ray = ray_at(picture, view, float(u) + 0.5, float(v) + 0.5)
                    beside = ray_at(picture, view, float(beside_u) + 0.5, float(beside_v) + 0.5)
                    is_edge = is_step(samples, row, other, ray, beside)
    is_edge_out[thread] = wp.where(is_edge, wp.uint8(1), wp.uint8(0))


@wp.func
def row_about(picture: Picture, extra: int, k: int) -> int:
    """Return the row of a pixel about a further sample, -1 outside of the image.

    Of its own for k = 0, of the one to its side, 1, of that above or below it, 2, and of that across the corner, 3.
    """
    camera = picture.camera
    pixel = picture.extras.row[extra // picture.extras.offset.shape[0]]
    offset = picture.extras.offset[extra % picture.extras.offset.shape[0]]
    line = pixel // camera.width
    view = line // camera.height
    x = pixel - line * camera.width + wp.where(k % 2 == 1, wp.where(offset[0] > 0.0, 1, -1), 0)
    y = line - view * camera.height + wp.where(k >= 2, wp.where(offset[1] > 0.0, 1, -1), 0)
    if x < 0 or y < 0 or x >= camera.width or y >= camera.height:
        return -1
    return sample_row(camera, view, x, y)


@wp.kernel
def guess_kernel(
    scene: Scene,
    picture: Picture,
    # out
    source_out: wp.array[int],
    is_traced_out: wp.array[wp.uint8],
):
    """Find what further samples show among the faces that the pixels about them show.

    The nearest of these faces on its ray is what a sample shows, unless one of another object lies before it in a pixel
    about it: the sample may show another face of that object, as at the outline of a round pole. Those samples, and
    the ones whose rays miss all four faces, are traced: their flag is 1, and a source without a face is their own row.

    Launch: dim=room for further samples, block_dim=64.
    """
    extra = wp.tid()
    if extra >= picture.extras.count[0] * picture.extras.offset.shape[0]:
        is_traced_out[extra] = wp.uint8(0)
        return
    samples = picture.samples
    ray = ray_of(picture, picture.extras.first + extra)
    source = wp.int32(-1)
    found = float(wp.inf)
    front = float(wp.inf)
    front_row = wp.int32(-1)
    face_own = wp.int32(-1)
    instance_own = wp.int32(-1)
    face_last = wp.int32(-1)
    instance_last = wp.int32(-1)
    for k in range(4):
        row = row_about(picture, extra, k)
        if row >= 0:
            face = samples.face[row]
            if face >= 0:
                if samples.t[row] < front:
                    front = samples.t[row]
                    front_row = row
                instance = samples.instance[row]
                # Most neighbors show one of two faces.
                if (face != face_own or instance != instance_own) and (face != face_last or instance != instance_last):
                    t = distance_to_face(scene, ray.batch_index, face, instance, ray.origin, ray.direction)
                    if t < found:
                        found = t
                        source = row
                    face_last = face
                    instance_last = instance
                    if k == 0:
                        face_own = face
                        instance_own = instance
    is_known = wp.bool(False)
    if source >= 0:
        is_known = found <= front * (1.0 + STEP)
        if not is_known:
            is_known = object_of(scene, stored_hit(samples, source)) == object_of(scene, stored_hit(samples, front_row))
    source_out[extra] = wp.where(source >= 0, source, picture.extras.first + extra)
    is_traced_out[extra] = wp.where(is_known, wp.uint8(0), wp.uint8(1))


@wp.kernel
def trace_all_kernel(
    extras: Extras,
    # out
    source_out: wp.array[int],
    is_traced_out: wp.array[wp.uint8],
):
    """Let all further samples be traced: 1 for those that there are. Launch: dim=room for further samples."""
    extra = wp.tid()
    source_out[extra] = extras.first + extra
    is_traced_out[extra] = wp.where(extra < extras.count[0] * extras.offset.shape[0], wp.uint8(1), wp.uint8(0))


@wp.kernel
def source_kernel(
    scene: Scene,
    picture: Picture,
    # out
    source_out: wp.array[int],
    is_shaded_out: wp.array[wp.uint8],
):
    """Find the pixel about each further sample that was traced which shows the same, whose light it uses.

    A sample without such a pixel is shaded for itself: its source is its own row and its flag 1.

    Launch: dim=room for further samples that were traced, in `Extras.shaded`; block_dim=64.
    """
    thread = wp.tid()
    if thread >= picture.extras.shaded_count[0]:
        is_shaded_out[thread] = wp.uint8(0)
        return
    row = picture.extras.shaded[thread]
    extra = row - picture.extras.first
    samples = picture.samples
    source = wp.int32(-1)
    for k in range(4):
        if source < 0:
            beside = row_about(picture, extra, k)
            if beside >= 0:
                is_same = samples.surface[beside] == samples.surface[row]
                if not is_same and not is_other_thing(scene, samples, beside, row):
                    is_same = not is_step(samples, beside, row, ray_of(picture, beside), ray_of(picture, row))
                if is_same:
                    source = beside
    source_out[extra] = wp.where(source >= 0, source, row)
    is_shaded_out[thread] = wp.where(source >= 0, wp.uint8(0), wp.uint8(1))
