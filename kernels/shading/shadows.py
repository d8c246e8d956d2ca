"""Trace the light that reaches what a camera sees, for all weathers with the same sun: shadows and open sky.

Every second pixel sends a ray to the sun, the others where their neighbors disagree, and every ninth one to the sky.
Neighbors use other directions out of 16, the same in every frame, and filters that stop at edges average them: soft
shadows without noise that moves.
"""

import warp as wp

from mmw.kernels.camera.camera import tile_column, tile_row
from mmw.kernels.camera.image_samples import Picture, ray_at, ray_of, row_of_thread, sample_row
from mmw.kernels.camera.instance_culling import Sun, sun_group
from mmw.kernels.core.compiler import PICTURE_RAYS
from mmw.kernels.core.noise import uniform4
from mmw.kernels.core.packing import unpack_unit
from mmw.kernels.core.structs import Scene
from mmw.kernels.core.trace import PICTURE_REGISTERS, occluded, occluded_among

wp.set_module_options(PICTURE_RAYS)

SKY_STEP = wp.constant(3)
"""Columns and rows of pixels between rays to the sky [px]; a filter fills in the others. Design value."""

OFF_SURFACE_M = wp.constant(1.0e-3)
"""Rays leave a surface this far from it [m], and 1e-5 of the distance to the camera more, the step of float32."""

SUN_FAR_M = wp.constant(2.0e3)
"""Length of a ray to the sun [m]: no town is wider."""

SKY_FAR_M = wp.constant(60.0)
"""Length of a ray to the sky [m]; what is farther hides a part of the horizon only. Design value."""

GROUND_NEAR_M = wp.constant(1.2)
"""Length of a ray below the horizon [m]: the ground itself shines back, so only what is close by darkens, such as the
body of a car over its wheels. Design value."""


@wp.func
def stratum_point(u: int, v: int, salt: int) -> wp.vec2:
    """Return a pixel's point of the unit disc: 4 x 4 neighbors have one in each of 16 cells of equal area.

    Source of the map from the square: P. Shirley and K. Chiu, "A low distortion map between disk and square", 1997.
    """
    # Cells in an order in which pixels side by side appearance far apart: bit-reversed rows and columns.
    column = (u % 2) * 2 + (u // 2) % 2
    row = (v % 2) * 2 + (v // 2) % 2
    column = (column + row) % 4
    # Within its cell a point moves from square to square by a sequence that fills it evenly (R2 and R3).
    start = uniform4(wp.vec2ui(wp.uint32(u % 4), wp.uint32(v % 4)), salt, 0)
    block_u = float(u // 4)
    block_v = float(v // 4)
    jitter = wp.vec2(
        wp.frac(start[0] + 0.754877666 * block_u + 0.569840291 * block_v),
        wp.frac(start[1] + 0.819172513 * block_u + 0.671043607 * block_v),
    )
    a = 2.0 * (float(column) + jitter[0]) / 4.0 - 1.0
    b = 2.0 * (float(row) + jitter[1]) / 4.0 - 1.0
    radius = a
    angle = 0.7853981633974483 * b / wp.where(wp.abs(a) > 1.0e-9, a, 1.0e-9)
    if wp.abs(b) > wp.abs(a):
        radius = b
        angle = 1.5707963267948966 - 0.7853981633974483 * a / b
    return wp.vec2(radius * wp.cos(angle), radius * wp.sin(angle))


@wp.func
def across(axis: wp.vec3, point: wp.vec2) -> wp.vec3:
    """Return x and y of a point along two unit vectors square to a unit axis, which vary smoothly but at one pole.

    Source: T. Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017.
    """
    sign = wp.where(axis[2] >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + axis[2])
    b = axis[0] * axis[1] * a
    first = wp.vec3(1.0 + sign * axis[0] * axis[0] * a, sign * b, -sign * axis[0])
    second = wp.vec3(b, sign + axis[1] * axis[1] * a, -axis[1])
    return first * point[0] + second * point[1]


@wp.func
def lift(point: wp.vec3, normal: wp.vec3, t: float) -> wp.vec3:
    """Return where a ray starts that leaves a surface, which a camera sees from the distance t [m]."""
    return point + normal * (OFF_SURFACE_M + 1.0e-5 * t)


@wp.func
def sees_sun(scene: Scene, batch_index: int, start: wp.vec3, normal: wp.vec3, sun: Sun, point: wp.vec2) -> wp.bool:
    """Return whether a point of the sun's disc is in sight.

    Args:
        scene: Town and vehicles.
        batch_index: Position of the frame in the batch.
        start: Where the ray starts, scene frame [m].
        normal: Unit normal of the face.
        sun: The sun.
        point: Point of the unit disc.
    """
    direction = wp.normalize(sun.direction + sun.radius * across(sun.direction, point))
    is_lit = wp.dot(normal, direction) > 0.0
    if is_lit:
        group = sun_group(sun.grid, batch_index, start)
        is_lit = not occluded_among(scene, batch_index, start, direction, SUN_FAR_M, sun.candidates, group)
    return is_lit


@wp.func
def sees_sky(scene: Scene, batch_index: int, start: wp.vec3, normal: wp.vec3, point: wp.vec2) -> wp.bool:
    """Return whether one direction about a normal is open; points of the unit disc that are spread evenly give
    directions with the density of the cosine."""
    height = wp.sqrt(wp.max(1.0 - wp.dot(point, point), 0.0))
    direction = wp.normalize(normal * height + across(normal, point))
    far = wp.where(direction[2] >= 0.0, SKY_FAR_M, GROUND_NEAR_M)
    return not occluded(scene, batch_index, start, direction, far, -1)


@wp.func
def faces_sun(picture: Picture, sun: Sun, row: int) -> wp.bool:
    """Return whether a sample shows a surface that some point of the sun's disc can light."""
    is_facing = wp.bool(False)
    if picture.samples.t[row] < wp.inf:
        is_facing = wp.dot(unpack_unit(picture.samples.normal[row]), sun.direction) > -sun.radius
    return is_facing


@wp.func
def sun_of_row(scene: Scene, picture: Picture, sun: Sun, row: int) -> wp.bool:
    """Return whether the ray that a sample sends to the sun arrives."""
    is_lit = wp.bool(False)
    if faces_sun(picture, sun, row):
        t = picture.samples.t[row]
        normal = unpack_unit(picture.samples.normal[row])
        ray = ray_of(picture, row)
        stratum = stratum_point(int(ray.u), int(ray.v), 3)
        start = lift(ray.origin + t * ray.direction, normal, t)
        is_lit = sees_sun(scene, ray.batch_index, start, normal, sun, stratum)
    return is_lit


@wp.kernel(cuda_max_registers=PICTURE_REGISTERS)
def sun_kernel(
    scene: Scene,
    picture: Picture,
    sun: Sun,
    # out
    sun_out: wp.array[wp.uint8],
):
    """Send one ray to the sun from every second pixel, as on a chessboard: 255 where it arrives, else 0.

    Launch: dim=(A, ceil(H / 8), ceil(W / 16), 64), block_dim=64.
    """
    view, down, aside, lane = wp.tid()
    v = tile_row(down, lane)
    u = 2 * tile_column(aside, lane) + v % 2
    if u >= picture.camera.width or v >= picture.camera.height:
        return
    row = sample_row(picture.camera, view, u, v)
    sun_out[row] = wp.where(sun_of_row(scene, picture, sun, row), wp.uint8(255), wp.uint8(0))


@wp.kernel(cuda_max_registers=PICTURE_REGISTERS)
def sun_between_kernel(
    scene: Scene,
    picture: Picture,
    sun: Sun,
    # out
    sun_out: wp.array[wp.uint8],
):
    """Fill in the other pixels: those that face the sun get the value of their four neighbors where these agree.

    The others, at edges of shadows, send a ray of their own. Neighbors that face away from the sun or show the sky say
    nothing.

    Launch: dim=(A, ceil(H / 8), ceil(W / 16), 64), block_dim=64.
    """
    view, down, aside, lane = wp.tid()
    v = tile_row(down, lane)
    u = 2 * tile_column(aside, lane) + 1 - v % 2
    if u >= picture.camera.width or v >= picture.camera.height:
        return
    row = sample_row(picture.camera, view, u, v)
    asked = wp.int32(0)
    lit = wp.int32(0)
    is_lit = faces_sun(picture, sun, row)
    if is_lit:
        for side in range(4):
            x = u + wp.where(side == 0, 1, 0) - wp.where(side == 1, 1, 0)
            y = v + wp.where(side == 2, 1, 0) - wp.where(side == 3, 1, 0)
            if x >= 0 and y >= 0 and x < picture.camera.width and y < picture.camera.height:
                beside = sample_row(picture.camera, view, x, y)
                if faces_sun(picture, sun, beside):
                    asked += 1
                    lit += wp.where(sun_out[beside] > wp.uint8(0), 1, 0)
        is_lit = lit > 0
        if asked < 2 or (lit > 0 and lit < asked):
            is_lit = sun_of_row(scene, picture, sun, row)
    sun_out[row] = wp.where(is_lit, wp.uint8(255), wp.uint8(0))


@wp.kernel(cuda_max_registers=PICTURE_REGISTERS)
def further_sun_kernel(
    scene: Scene,
    picture: Picture,
    sun: Sun,
    thread_offset: int,
    # out
    sun_out: wp.array[wp.uint8],
):
    """Send one ray to the sun from every further sample that is shaded: 255 where it arrives, else 0.

    Launch: dim=room for further samples that are shaded, block_dim=64.
    """
    row = row_of_thread(picture, wp.tid() + thread_offset)
    if row < 0:
        return
    sun_out[row] = wp.where(sun_of_row(scene, picture, sun, row), wp.uint8(255), wp.uint8(0))


@wp.kernel(cuda_max_registers=PICTURE_REGISTERS)
def sky_kernel(
    scene: Scene,
    picture: Picture,
    # out
    sky_out: wp.array3d[wp.uint8],
):
    """Send one ray to the sky from every `SKY_STEP`-th pixel of every such line: 255 where it arrives, else 0.

    Launch: dim=(A, tile rows, tile columns, 64) of the rays, block_dim=64.
    """
    view, down, aside, lane = wp.tid()
    i = tile_row(down, lane)
    j = tile_column(aside, lane)
    if i >= sky_out.shape[1] or j >= sky_out.shape[2]:
        return
    u = SKY_STEP * j
    v = SKY_STEP * i
    row = sample_row(picture.camera, view, u, v)
    t = picture.samples.t[row]
    is_open = wp.bool(True)
    if t < wp.inf:
        ray = ray_at(picture, view, float(u) + 0.5, float(v) + 0.5)
        normal = unpack_unit(picture.samples.normal[row])
        start = lift(ray.origin + t * ray.direction, normal, t)
        is_open = sees_sky(scene, ray.batch_index, start, normal, stratum_point(j, i, 2))
    sky_out[view, i, j] = wp.where(is_open, wp.uint8(255), wp.uint8(0))
