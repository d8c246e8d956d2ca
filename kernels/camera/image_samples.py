"""Assign samples of a batch of images to threads, and find the rays through them."""

import warp as wp

from mmw.kernels.camera.camera import TILE, Camera, camera_ray, tile_column, tile_row
from mmw.kernels.core.structs import Views
from mmw.kernels.shading.structs import Extras, Samples

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": True})


@wp.struct
class Picture:
    """Images of one camera from several places, and the hits of their samples."""

    views: Views
    camera: Camera
    extras: Extras
    samples: Samples


@wp.struct
class SampleRay:
    """The ray through a sample."""

    view: int
    batch_index: int
    """Slot of the view's frame."""
    u: float
    """Column of the sample [px], pixel edges at whole numbers."""
    v: float
    """Row [px]."""
    origin: wp.vec3
    """The camera, scene frame [m]."""
    direction: wp.vec3
    """Unit direction, scene frame."""
    forward: float
    """Part of the direction along the optical axis."""


@wp.func
def sample_row(camera: Camera, view: int, u: int, v: int) -> int:
    """Return the row of a pixel's center in the samples of an image."""
    return (view * camera.height + v) * camera.width + u


@wp.func
def row_of_thread(picture: Picture, thread: int) -> int:
    """Return the row of the sample that a thread works on, -1 for none.

    The first threads process the pixels tile by tile, so that neighbors in a warp are neighbors in the image; the
    others process the further samples in order: those that are shaded, or all where that is not known yet.
    """
    camera = picture.camera
    views = picture.views.batch_index.shape[0]
    down = (camera.height + TILE - 1) // TILE
    across = (camera.width + TILE - 1) // TILE
    tile = thread // (TILE * TILE)
    lane = thread - tile * TILE * TILE
    view = tile // (down * across)
    if view >= views:
        further = thread - views * down * across * TILE * TILE
        if picture.extras.shaded.shape[0] > 0:
            if further >= picture.extras.shaded_count[0]:
                return -1
            return picture.extras.shaded[further]
        return picture.extras.first + further
    inside = tile - view * down * across
    v = tile_row(inside // across, lane)
    u = tile_column(inside % across, lane)
    if u >= camera.width or v >= camera.height:
        return -1
    return sample_row(camera, view, u, v)


@wp.func
def ray_at(picture: Picture, view: int, u: float, v: float) -> SampleRay:
    """Return the ray through a point of an image."""
    pose = picture.views.pose[view]
    in_sensor = camera_ray(picture.camera, u, v)
    ray = SampleRay()
    ray.view = view
    ray.batch_index = picture.views.batch_index[view]
    ray.u = u
    ray.v = v
    ray.origin = wp.transform_get_translation(pose)
    ray.direction = wp.transform_vector(pose, in_sensor)
    ray.forward = in_sensor[0]
    return ray


@wp.func
def ray_of(picture: Picture, row: int) -> SampleRay:
    """Return the ray through the sample of a row."""
    pixel = row
    offset = wp.vec2(0.5, 0.5)
    if row >= picture.extras.first:
        count = picture.extras.offset.shape[0]
        extra = row - picture.extras.first
        pixel = picture.extras.row[extra // count]
        offset = picture.extras.offset[extra % count] + offset
    line = pixel // picture.camera.width
    view = line // picture.camera.height
    u = float(pixel - line * picture.camera.width) + offset[0]
    v = float(line - view * picture.camera.height) + offset[1]
    return ray_at(picture, view, u, v)


@wp.func
def tile_of(camera: Camera, ray: SampleRay) -> int:
    """Return the number of the tile that a sample lies in, its group of `Candidates`."""
    down = (camera.height + TILE - 1) // TILE
    across = (camera.width + TILE - 1) // TILE
    return (ray.view * down + int(ray.v) // TILE) * across + int(ray.u) // TILE


@wp.kernel
def flag_count_kernel(
    flag: wp.array[wp.uint64],
    # out
    count_out: wp.array[int],
):
    """Count the flags in each word of eight threads' flags, a byte each, 0 or 1. Launch: dim=words."""
    word = wp.tid()
    # The product adds the eight bytes up in the topmost one.
    count_out[word] = int((flag[word] * wp.uint64(0x0101010101010101)) >> wp.uint64(56))


@wp.kernel
def flagged_row_kernel(
    picture: Picture,
    flag: wp.array[wp.uint64],
    first: wp.array[int],
    thread_offset: int,
    # out
    row_out: wp.array[int],
):
    """List the rows of flagged threads in their order; the first of a word goes to its place `first`.

    Those for which there is no room are left out.

    Launch: dim=words.
    """
    word = wp.tid()
    flags = flag[word]
    if flags == wp.uint64(0):
        return
    place = first[word]
    for byte in range(8):
        if ((flags >> wp.uint64(8 * byte)) & wp.uint64(1)) == wp.uint64(1) and place < row_out.shape[0]:
            row_out[place] = row_of_thread(picture, thread_offset + 8 * word + byte)
            place += 1
