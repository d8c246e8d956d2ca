"""What every pixel of a camera sees: traced once, then shared by colour, depth, segmentation and all weathers."""

import warp as wp

from mmw.kernels.camera import TILE, Camera, camera_ray, tile_column, tile_row
from mmw.kernels.looks import Appearance, Extras, Samples
from mmw.kernels.packing import pack_unit, unpack_unit
from mmw.kernels.structs import Candidates, Nearest, Scene, Views
from mmw.kernels.surfel import is_cut_out, material_of
from mmw.kernels.trace import (
    TRACE_REGISTERS,
    nearest_surface,
    nearest_surface_among,
    object_of,
    surface_of,
    world_normal,
)

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": True})

FOLD = wp.constant(0.7)
"""Cosine between the normals of two faces of one object below which the line between them is drawn smoothly: 45 deg."""

STEP = wp.constant(0.02)
"""Distance of a neighbour from the plane of a pixel's surface, over its range, from which there is an edge [-]."""

MOST_HOLES = wp.constant(16)
"""Holes of cut-out textures that one ray passes at most; behind so many leaves the last one is taken for solid."""

PAST_HOLE = wp.constant(1.0e-4)
"""A ray goes on this far behind a hole, over the distance so far and at least of 1 m [-]."""


@wp.struct
class Place:
    """Where a sample is: a point of the image of a view."""

    view: int
    u: float
    """Column [px], pixel edges at whole numbers."""
    v: float
    """Row [px]."""


@wp.func
def sample_row(camera: Camera, view: int, u: int, v: int) -> int:
    """Return the row of a pixel's centre in the samples of an image."""
    return (view * camera.height + v) * camera.width + u


@wp.func
def row_of_thread(camera: Camera, views: int, thread: int) -> int:
    """Return the row of the sample that a thread works on, -1 for none.

    The first threads take the pixels tile by tile, so that neighbours in a warp are neighbours in the image; the
    others take the further samples in order.
    """
    down = (camera.height + TILE - 1) // TILE
    across = (camera.width + TILE - 1) // TILE
    tile = thread // (TILE * TILE)
    lane = thread - tile * TILE * TILE
    view = tile // (down * across)
    if view >= views:
        return thread - views * down * across * TILE * TILE + views * camera.height * camera.width
    inside = tile - view * down * across
    v = tile_row(inside // across, lane)
    u = tile_column(inside % across, lane)
    if u >= camera.width or v >= camera.height:
        return -1
    return sample_row(camera, view, u, v)


@wp.func
def place_of(camera: Camera, extras: Extras, row: int) -> Place:
    """Return where the sample of a row is."""
    pixel = row
    offset = wp.vec2(0.5, 0.5)
    if row >= extras.first:
        count = extras.offset.shape[0]
        extra = row - extras.first
        pixel = extras.row[extra // count]
        offset = extras.offset[extra % count] + offset
    place = Place()
    line = pixel // camera.width
    place.view = line // camera.height
    place.u = float(pixel - line * camera.width) + offset[0]
    place.v = float(line - place.view * camera.height) + offset[1]
    return place


@wp.func
def tile_of(camera: Camera, place: Place) -> int:
    """Return the number of the tile that a sample lies in, its group of `Candidates`."""
    down = (camera.height + TILE - 1) // TILE
    across = (camera.width + TILE - 1) // TILE
    return (place.view * down + int(place.v) // TILE) * across + int(place.u) // TILE


@wp.func
def pixel_direction(camera: Camera, pose: wp.transformf, u: float, v: float) -> wp.vec3:
    """Return the unit direction through a point of the image, scene frame."""
    return wp.transform_vector(pose, camera_ray(camera, u, v))


@wp.func
def ray_length(camera: Camera, forward: float) -> float:
    """Return the longest distance along a ray whose direction has this part along the optical axis [m].

    Depth ends at `Camera.range`; rays more than 89 deg from the axis, which only a fisheye has, end where those do.
    """
    return camera.range / wp.max(forward, 0.02)


@wp.func
def store(
    scene: Scene, slot: int, near: Nearest, direction: wp.vec3, row: int,
    # out
    samples_out: Samples,
):  # fmt: skip
    """Write what a ray met to a row of the samples."""
    samples_out.t[row] = near.t
    samples_out.face[row] = near.face
    samples_out.instance[row] = near.instance
    if samples_out.surface.shape[0] > 0:
        samples_out.surface[row] = surface_of(scene, near)
        normal = wp.vec3(0.0, 0.0, 1.0)
        if near.face >= 0:
            normal = world_normal(scene, slot, near)
            if wp.dot(normal, normal) < 0.5:  # a face without area
                normal = -direction
            normal = wp.where(wp.dot(normal, direction) > 0.0, -normal, normal)
        samples_out.normal[row] = pack_unit(normal)


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def visibility_kernel(
    scene: Scene,
    views: Views,
    camera: Camera,
    extras: Extras,
    candidates: Candidates,
    thread_offset: int,
    # out
    samples_out: Samples,
):
    """Trace the rays of samples: pixel centres, or with an offset of the thread those of pixels on edges.

    Launch: dim=threads, block_dim=64.
    """
    row = row_of_thread(camera, views.slot.shape[0], wp.tid() + thread_offset)
    if row < 0:
        return
    place = place_of(camera, extras, row)
    ray = camera_ray(camera, place.u, place.v)
    pose = views.pose[place.view]
    slot = views.slot[place.view]
    direction = wp.transform_vector(pose, ray)
    near = nearest_surface_among(
        scene, slot, wp.transform_get_translation(pose), direction, ray_length(camera, ray[0]),
        views.ignore[place.view], candidates, tile_of(camera, place),
    )  # fmt: skip
    store(scene, slot, near, direction, row, samples_out)


@wp.kernel
def visibility_through_holes_kernel(
    scene: Scene,
    appearance: Appearance,
    views: Views,
    camera: Camera,
    extras: Extras,
    thread_offset: int,
    # out
    samples_out: Samples,
):
    """Trace the rays of samples in a scene with cut-out textures, whose holes they pass; see `visibility_kernel`.

    Launch: dim=threads, block_dim=64.
    """
    row = row_of_thread(camera, views.slot.shape[0], wp.tid() + thread_offset)
    if row < 0:
        return
    place = place_of(camera, extras, row)
    ray = camera_ray(camera, place.u, place.v)
    pose = views.pose[place.view]
    slot = views.slot[place.view]
    origin = wp.transform_get_translation(pose)
    direction = wp.transform_vector(pose, ray)
    t_max = ray_length(camera, ray[0])
    near = nearest_surface(scene, slot, origin, direction, t_max, views.ignore[place.view])
    behind = wp.float32(0.0)
    for _ in range(MOST_HOLES):
        is_hole = wp.bool(False)
        if near.face >= 0:
            is_hole = is_cut_out(
                scene, appearance, slot, origin, direction, behind + near.t, near.face, near.instance, 1.0 / camera.fx
            )
        if not is_hole:
            break
        behind += near.t + PAST_HOLE * wp.max(1.0, behind + near.t)
        start = origin + behind * direction
        near = nearest_surface(scene, slot, start, direction, t_max - behind, views.ignore[place.view])
    near.t += behind
    store(scene, slot, near, direction, row, samples_out)


@wp.func
def seen_again(samples: Samples, row: int) -> Nearest:
    """Return a stored sample as the tracer found it, without its normal."""
    near = Nearest()
    near.t = samples.t[row]
    near.face = samples.face[row]
    near.instance = samples.instance[row]
    return near


@wp.func
def is_edge_between(
    scene: Scene, camera: Camera, samples: Samples, row: int, other: int, ray: wp.vec3, ray_beside: wp.vec3,
    normal: wp.vec3,
) -> wp.bool:  # fmt: skip
    """Return whether a line that a camera should draw smoothly lies between two neighbours of different surfaces.

    Args:
        scene: Town and vehicles.
        camera: The camera.
        samples: What the pixels see.
        row: The pixel.
        other: Its neighbour.
        ray: Unit direction through the pixel, sensor frame.
        ray_beside: Unit direction through the neighbour.
        normal: Normal at the pixel, sensor frame.
    """
    near = seen_again(samples, row)
    beside = seen_again(samples, other)
    if near.face < 0 or beside.face < 0:
        return True
    if object_of(scene, near) != object_of(scene, beside):
        return True
    if material_of(scene, near.face, near.instance) != material_of(scene, beside.face, beside.instance):
        return True
    if wp.dot(unpack_unit(samples.normal[row]), unpack_unit(samples.normal[other])) < FOLD:
        return True
    return wp.abs(wp.dot(beside.t * ray_beside - near.t * ray, normal)) > STEP * near.t


@wp.kernel
def edge_kernel(
    scene: Scene,
    views: Views,
    camera: Camera,
    samples: Samples,
    # out
    is_edge_out: wp.array[int],
):
    """Find the pixels that a line crosses: those whose neighbour shows another object, material, fold or depth.

    Launch: dim=threads of all tiles, block_dim=64; a thread's flag stands at its number.
    """
    thread = wp.tid()
    row = row_of_thread(camera, views.slot.shape[0], thread)
    is_edge_out[thread] = 0
    if row < 0:
        return
    surface = samples.surface[row]
    line = row // camera.width
    view = line // camera.height
    u = row - line * camera.width
    v = line - view * camera.height
    ray = camera_ray(camera, float(u) + 0.5, float(v) + 0.5)
    normal = wp.transform_vector(wp.transform_inverse(views.pose[view]), unpack_unit(samples.normal[row]))
    is_edge = wp.bool(False)
    for side in range(4):
        beside_u = u + wp.where(side == 0, 1, 0) - wp.where(side == 1, 1, 0)
        beside_v = v + wp.where(side == 2, 1, 0) - wp.where(side == 3, 1, 0)
        if not is_edge and beside_u >= 0 and beside_v >= 0 and beside_u < camera.width and beside_v < camera.height:
            other = sample_row(camera, view, beside_u, beside_v)
            if samples.surface[other] != surface:
                there = camera_ray(camera, float(beside_u) + 0.5, float(beside_v) + 0.5)
                is_edge = is_edge_between(scene, camera, samples, row, other, ray, there, normal)
    is_edge_out[thread] = wp.where(is_edge, 1, 0)


@wp.kernel
def flagged_row_kernel(
    camera: Camera,
    views: int,
    flag: wp.array[int],
    number: wp.array[int],
    # out
    row_out: wp.array[int],
):
    """List the rows of flagged samples in the order of their threads. Launch: dim=threads, block_dim=64."""
    thread = wp.tid()
    if flag[thread] == 1:
        row_out[number[thread]] = row_of_thread(camera, views, thread)
