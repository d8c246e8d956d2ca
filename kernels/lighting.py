"""Light that reaches what a camera sees, the same in every weather with the same sun: shadows, open sky, mirrored rays.

Every second pixel sends a ray to the sun, the others where their neighbours disagree, and every ninth one to the sky.
Neighbours take other directions out of 16, the same in every frame, and filters that stop at edges average them: soft
shadows without noise that moves.
"""

import warp as wp

from mmw.kernels.camera import Camera, tile_column, tile_row
from mmw.kernels.candidates import SunGrid, sun_group
from mmw.kernels.looks import Extras, Samples
from mmw.kernels.packing import unpack_unit
from mmw.kernels.structs import Candidates, Scene, Views
from mmw.kernels.trace import TRACE_REGISTERS, is_blocked, is_blocked_among
from mmw.kernels.visibility import Place, pixel_direction, place_of, sample_row

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": True})

SKY_STEP = wp.constant(3)
"""Columns and rows of pixels between rays to the sky [px]; a filter fills in the others. Design value."""

OFF_SURFACE_M = wp.constant(1.0e-3)
"""Rays leave a surface this far from it [m], and 1e-5 of the distance to the camera more, the step of float32."""

SUN_FAR_M = wp.constant(2.0e3)
"""Length of a ray to the sun [m]: no town is wider."""

SKY_FAR_M = wp.constant(60.0)
"""Length of a ray to the sky [m]; what stands farther hides a part of the horizon only. Design value."""

GROUND_NEAR_M = wp.constant(1.2)
"""Length of a ray below the horizon [m]: the ground itself shines back, so only what is close by darkens, such as the
body of a car over its wheels. Design value."""


@wp.func
def hash_unit(x: int, y: int, salt: int) -> wp.vec2:
    """Return two numbers in [0, 1) that depend on a pixel and nothing else.

    Source: hash pcg3d of M. Jarzynski and M. Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020.
    """
    a = wp.uint32(x) * wp.uint32(1664525) + wp.uint32(1013904223)
    b = wp.uint32(y) * wp.uint32(1664525) + wp.uint32(1013904223)
    c = wp.uint32(salt) * wp.uint32(1664525) + wp.uint32(1013904223)
    a += b * c
    b += c * a
    c += a * b
    a = a ^ (a >> wp.uint32(16))
    b = b ^ (b >> wp.uint32(16))
    c = c ^ (c >> wp.uint32(16))
    a += b * c
    b += c * a
    return wp.vec2(float(a >> wp.uint32(8)) * 5.9604644775390625e-08, float(b >> wp.uint32(8)) * 5.9604644775390625e-08)


@wp.func
def stratum_point(u: int, v: int, salt: int) -> wp.vec2:
    """Return a pixel's point of the unit disc: 4 x 4 neighbours have one in each of 16 cells of equal area.

    Source of the map from the square: P. Shirley and K. Chiu, "A low distortion map between disk and square", 1997.
    """
    # Cells in an order in which pixels side by side look far apart: bit-reversed rows and columns.
    column = (u % 2) * 2 + (u // 2) % 2
    row = (v % 2) * 2 + (v // 2) % 2
    column = (column + row) % 4
    # Within its cell a point moves from square to square by a sequence that fills it evenly (R2 and R3).
    jitter = hash_unit(u % 4, v % 4, salt)
    block_u = float(u // 4)
    block_v = float(v // 4)
    jitter = wp.vec2(
        wp.frac(jitter[0] + 0.754877666 * block_u + 0.569840291 * block_v),
        wp.frac(jitter[1] + 0.819172513 * block_u + 0.671043607 * block_v),
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
def sees_sun(
    scene: Scene, slot: int, start: wp.vec3, normal: wp.vec3, sun: wp.vec3, radius: float, point: wp.vec2,
    grid: SunGrid, candidates: Candidates,
) -> wp.bool:  # fmt: skip
    """Return whether a point of the sun's disc is in sight.

    Args:
        scene: Town and vehicles.
        slot: Slot of the frame.
        start: Where the ray starts, scene frame [m].
        normal: Unit normal of the face.
        sun: Unit direction to the sun's middle.
        radius: Angular radius of the sun [rad].
        point: Point of the unit disc.
        grid: Cells square to the sun.
        candidates: Instances that shade them.
    """
    direction = wp.normalize(sun + radius * across(sun, point))
    is_lit = wp.dot(normal, direction) > 0.0
    if is_lit:
        is_lit = not is_blocked_among(
            scene, slot, start, direction, SUN_FAR_M, candidates, sun_group(grid, slot, start)
        )
    return is_lit


@wp.func
def sees_sky(scene: Scene, slot: int, start: wp.vec3, normal: wp.vec3, point: wp.vec2) -> wp.bool:
    """Return whether one direction about a normal is open; points of the unit disc that are spread evenly give
    directions with the density of the cosine."""
    height = wp.sqrt(wp.max(1.0 - wp.dot(point, point), 0.0))
    direction = wp.normalize(normal * height + across(normal, point))
    far = wp.where(direction[2] >= 0.0, SKY_FAR_M, GROUND_NEAR_M)
    return not is_blocked(scene, slot, start, direction, far, -1)


@wp.func
def row_beside(camera: Camera, extras: Extras, samples: Samples, row: int, place: Place) -> int:
    """Return the row of the pixel about a further sample that shows the same surface, its own first; -1 for none."""
    pixel = extras.row[(row - extras.first) // extras.offset.shape[0]]
    offset = extras.offset[(row - extras.first) % extras.offset.shape[0]]
    surface = samples.surface[row]
    line = pixel // camera.width
    u = pixel - line * camera.width
    v = line - place.view * camera.height
    found = wp.int32(-1)
    for k in range(4):
        x = u + wp.where(k % 2 == 1, wp.where(offset[0] > 0.0, 1, -1), 0)
        y = v + wp.where(k >= 2, wp.where(offset[1] > 0.0, 1, -1), 0)
        if found < 0 and x >= 0 and y >= 0 and x < camera.width and y < camera.height:
            beside = sample_row(camera, place.view, x, y)
            if samples.surface[beside] == surface:
                found = beside
    return found


@wp.func
def sun_of_row(
    scene: Scene, views: Views, camera: Camera, extras: Extras, samples: Samples, sun: wp.vec3, sun_radius: float,
    grid: SunGrid, candidates: Candidates, row: int,
) -> wp.bool:  # fmt: skip
    """Return whether the ray that a sample sends to the sun arrives."""
    t = samples.t[row]
    is_lit = wp.bool(False)
    if t < wp.inf:
        normal = unpack_unit(samples.normal[row])
        if wp.dot(normal, sun) > -sun_radius:
            place = place_of(camera, extras, row)
            pose = views.pose[place.view]
            point = wp.transform_get_translation(pose) + t * pixel_direction(camera, pose, place.u, place.v)
            stratum = stratum_point(int(place.u), int(place.v), 3)
            start = lift(point, normal, t)
            is_lit = sees_sun(scene, views.slot[place.view], start, normal, sun, sun_radius, stratum, grid, candidates)
    return is_lit


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def sun_kernel(
    scene: Scene,
    views: Views,
    camera: Camera,
    extras: Extras,
    samples: Samples,
    sun: wp.vec3,
    sun_radius: float,
    grid: SunGrid,
    candidates: Candidates,
    # out
    sun_out: wp.array[wp.uint8],
):
    """Send one ray to the sun from every second pixel, as on a chessboard: 255 where it arrives, else 0.

    Launch: dim=(A, ceil(H / 8), ceil(W / 16), 64), block_dim=64.
    """
    view, down, aside, lane = wp.tid()
    v = tile_row(down, lane)
    u = 2 * tile_column(aside, lane) + v % 2
    if u >= camera.width or v >= camera.height:
        return
    row = sample_row(camera, view, u, v)
    is_lit = sun_of_row(scene, views, camera, extras, samples, sun, sun_radius, grid, candidates, row)
    sun_out[row] = wp.where(is_lit, wp.uint8(255), wp.uint8(0))


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def sun_between_kernel(
    scene: Scene,
    views: Views,
    camera: Camera,
    extras: Extras,
    samples: Samples,
    sun: wp.vec3,
    sun_radius: float,
    grid: SunGrid,
    candidates: Candidates,
    # out
    sun_out: wp.array[wp.uint8],
):
    """Fill in the other pixels: those whose four neighbours on their surface agree take their value.

    The others, at edges of shadows and surfaces, send a ray of their own.

    Launch: dim=(A, ceil(H / 8), ceil(W / 16), 64), block_dim=64.
    """
    view, down, aside, lane = wp.tid()
    v = tile_row(down, lane)
    u = 2 * tile_column(aside, lane) + 1 - v % 2
    if u >= camera.width or v >= camera.height:
        return
    row = sample_row(camera, view, u, v)
    surface = samples.surface[row]
    agree = wp.int32(0)
    lit = wp.int32(0)
    for side in range(4):
        x = u + wp.where(side == 0, 1, 0) - wp.where(side == 1, 1, 0)
        y = v + wp.where(side == 2, 1, 0) - wp.where(side == 3, 1, 0)
        if x >= 0 and y >= 0 and x < camera.width and y < camera.height:
            beside = sample_row(camera, view, x, y)
            if samples.surface[beside] == surface:
                agree += 1
                lit += int(sun_out[beside])
    is_lit = wp.bool(lit > 0)
    if agree < 4 or (lit > 0 and lit < 4 * 255):
        is_lit = sun_of_row(scene, views, camera, extras, samples, sun, sun_radius, grid, candidates, row)
    sun_out[row] = wp.where(is_lit, wp.uint8(255), wp.uint8(0))


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def extra_sun_kernel(
    scene: Scene,
    views: Views,
    camera: Camera,
    extras: Extras,
    samples: Samples,
    sun: wp.vec3,
    sun_radius: float,
    grid: SunGrid,
    candidates: Candidates,
    # out
    sun_out: wp.array[wp.uint8],
):
    """Fill in the further samples: those on the surface of a pixel beside them take its value.

    The others send a ray of their own.

    Launch: dim=further samples, block_dim=64.
    """
    row = wp.tid() + extras.first
    beside = row_beside(camera, extras, samples, row, place_of(camera, extras, row))
    is_lit = wp.bool(False)
    if beside >= 0:
        is_lit = sun_out[beside] > wp.uint8(0)
    else:
        is_lit = sun_of_row(scene, views, camera, extras, samples, sun, sun_radius, grid, candidates, row)
    sun_out[row] = wp.where(is_lit, wp.uint8(255), wp.uint8(0))


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def sky_kernel(
    scene: Scene,
    views: Views,
    camera: Camera,
    samples: Samples,
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
    row = sample_row(camera, view, u, v)
    t = samples.t[row]
    is_open = wp.bool(True)
    if t < wp.inf:
        pose = views.pose[view]
        normal = unpack_unit(samples.normal[row])
        point = wp.transform_get_translation(pose)
        point += t * pixel_direction(camera, pose, float(u) + 0.5, float(v) + 0.5)
        is_open = sees_sky(scene, views.slot[view], lift(point, normal, t), normal, stratum_point(j, i, 2))
    sky_out[view, i, j] = wp.where(is_open, wp.uint8(255), wp.uint8(0))
