"""Average the rays to sun and sky of neighboring pixels on the same smooth surface.

Source: H. Dammertz et al., "Edge-avoiding A-Trous wavelet transform", High Performance Graphics 2010.
"""

import warp as wp

from mmw.kernels.camera.camera import camera_ray, tile_column, tile_row
from mmw.kernels.camera.image_samples import Picture, sample_row
from mmw.kernels.core.compiler import PICTURE_SHADING
from mmw.kernels.core.packing import unpack_unit
from mmw.kernels.shading.shadows import SKY_STEP

wp.set_module_options(PICTURE_SHADING)

SHADE_STEP = wp.constant(64.0)
"""Difference of the sky in sight, in 255ths, from which later passes of the filter keep apart. Design value: noise of
the first pass stays below half of it."""

EVEN_SKY = wp.constant(6)
"""Difference between neighboring rays to the sky, in 255ths, up to which they are blended wherever they left: half of
it, the error at worst, is not visible. Design value."""

FLATNESS = wp.constant(0.01)
"""Distance from a plane that still belongs to its surface, over the range and at least of 1 m [-]. Design value."""


@wp.struct
class Spot:
    """A point on a smooth surface whose light is averaged."""

    point: wp.vec3
    """Sensor frame [m]."""
    normal: wp.vec3
    """Unit normal, sensor frame."""
    normal_in_scene: wp.vec3
    """The same, scene frame."""
    surface: int
    """Surface id."""
    slack: float
    """One over the distance from the plane that still counts [1/m]."""


@wp.func
def spot_of(picture: Picture, view: int, u: int, v: int, row: int) -> Spot:
    """Return what the center of a pixel shows; it must show something."""
    t = picture.samples.t[row]
    spot = Spot()
    spot.normal_in_scene = unpack_unit(picture.samples.normal[row])
    spot.normal = wp.transform_vector(wp.transform_inverse(picture.views.pose[view]), spot.normal_in_scene)
    spot.point = t * camera_ray(picture.camera, float(u) + 0.5, float(v) + 0.5)
    spot.surface = picture.samples.surface[row]
    spot.slack = 1.0 / (FLATNESS * t + FLATNESS)
    return spot


@wp.func
def likeness(picture: Picture, row: int, u: int, v: int, spot: Spot) -> float:
    """Return how much a pixel, by row, column and line, lies on the same smooth surface as a spot: 0 to 1."""
    if picture.samples.surface[row] == spot.surface:  # flat, by what a surface is
        return 1.0
    t = picture.samples.t[row]
    weight = wp.float32(0.0)
    if t < wp.inf:
        there = t * camera_ray(picture.camera, float(u) + 0.5, float(v) + 0.5)
        alike = wp.max(wp.dot(spot.normal_in_scene, unpack_unit(picture.samples.normal[row])), 0.0)
        alike = alike * alike
        alike = alike * alike
        weight = alike * alike * wp.max(1.0 - wp.abs(wp.dot(there - spot.point, spot.normal)) * spot.slack, 0.0)
    return weight


@wp.kernel(cuda_max_registers=56)
def smooth_sky_kernel(
    picture: Picture,
    sky: wp.array3d[wp.uint8],
    reach: int,
    # out
    sky_out: wp.array3d[wp.uint8],
):
    """Average the sky's rays over 5 x 5 of them, `reach` rays apart, that left the same smooth surface.

    Launch: dim=(A, tile rows, tile columns, 64) of the rays, block_dim=256.
    """
    view, down, aside, lane = wp.tid()
    i = tile_row(down, lane)
    j = tile_column(aside, lane)
    if i >= sky.shape[1] or j >= sky.shape[2]:
        return
    row = sample_row(picture.camera, view, SKY_STEP * j, SKY_STEP * i)
    if picture.samples.t[row] == wp.inf:
        sky_out[view, i, j] = wp.uint8(255)
        return
    spot = spot_of(picture, view, SKY_STEP * j, SKY_STEP * i, row)
    own = float(sky[view, i, j])
    total = wp.float32(0.01)
    is_open = 0.01 * own
    # At a border the square moves inwards, so that it is whole there too.
    middle_i = wp.clamp(i, 2 * reach, wp.max(sky.shape[1] - 1 - 2 * reach, 2 * reach))
    middle_j = wp.clamp(j, 2 * reach, wp.max(sky.shape[2] - 1 - 2 * reach, 2 * reach))
    for a in range(-2, 3):
        for b in range(-2, 3):
            y = middle_i + a * reach
            x = middle_j + b * reach
            if y >= 0 and x >= 0 and y < sky.shape[1] and x < sky.shape[2]:
                beside = sample_row(picture.camera, view, SKY_STEP * x, SKY_STEP * y)
                weight = likeness(picture, beside, SKY_STEP * x, SKY_STEP * y, spot)
                # The 16 directions of 4 x 4 rays count the same: those at both ends of the square share one.
                weight *= wp.where(wp.abs(a) == 2, 0.5, 1.0) * wp.where(wp.abs(b) == 2, 0.5, 1.0)
                value = float(sky[view, y, x])
                if reach > 1:  # values of the first pass differ by noise or by a near shadow, which stays
                    weight *= wp.max(1.0 - wp.abs(value - own) / SHADE_STEP, 0.0)
                total += weight
                is_open += weight * value
    sky_out[view, i, j] = wp.uint8(int(wp.rint(wp.min(is_open / total, 255.0))))


@wp.func
def is_at_shadow_edge(picture: Picture, sun: wp.array[wp.uint8], view: int, u: int, v: int, own: wp.uint8) -> wp.bool:
    """Return whether one of eight pixels two away all round sees more or less of the sun."""
    is_edge = wp.bool(False)
    for k in range(8):
        a = (k + wp.where(k >= 4, 1, 0)) % 3 - 1
        b = (k + wp.where(k >= 4, 1, 0)) // 3 - 1
        x = wp.clamp(u + 2 * a, 0, picture.camera.width - 1)
        y = wp.clamp(v + 2 * b, 0, picture.camera.height - 1)
        is_edge = is_edge or sun[sample_row(picture.camera, view, x, y)] != own
    return is_edge


@wp.func
def smooth_sun(picture: Picture, sun: wp.array[wp.uint8], view: int, u: int, v: int, row: int) -> float:
    """Return the sun in sight, averaged over 5 x 5 pixels that show the same smooth surface, in 255ths."""
    spot = spot_of(picture, view, u, v, row)
    own = float(sun[row])
    total = wp.float32(0.01)
    lit = 0.01 * own
    for a in range(-2, 3):
        for b in range(-2, 3):
            y = v + a
            x = u + b
            if y >= 0 and x >= 0 and y < picture.camera.height and x < picture.camera.width:
                beside = sample_row(picture.camera, view, x, y)
                weight = likeness(picture, beside, x, y, spot)
                # The 16 points of the disc that 4 x 4 pixels appearance at count the same.
                weight *= wp.where(wp.abs(a) == 2, 0.5, 1.0) * wp.where(wp.abs(b) == 2, 0.5, 1.0)
                total += weight
                lit += weight * float(sun[beside])
    return lit / total


@wp.func
def blended_sky(picture: Picture, sky: wp.array3d[wp.uint8], view: int, u: int, v: int, row: int) -> float:
    """Return the sky in sight between the four rays about a pixel, those from its surface if they differ, in 255ths."""
    i = v // SKY_STEP
    j = u // SKY_STEP
    i_next = wp.min(i + 1, sky.shape[1] - 1)
    j_next = wp.min(j + 1, sky.shape[2] - 1)
    down = float(v - SKY_STEP * i) / float(SKY_STEP)
    aside = float(u - SKY_STEP * j) / float(SKY_STEP)
    a = int(sky[view, i, j])
    b = int(sky[view, i, j_next])
    c = int(sky[view, i_next, j])
    d = int(sky[view, i_next, j_next])
    plain = wp.lerp(wp.lerp(float(a), float(b), aside), wp.lerp(float(c), float(d), aside), down)
    if wp.max(wp.max(a, b), wp.max(c, d)) - wp.min(wp.min(a, b), wp.min(c, d)) <= EVEN_SKY:
        return plain
    spot = spot_of(picture, view, u, v, row)
    total = wp.float32(0.0)
    is_open = wp.float32(0.0)
    for k in range(4):
        y = wp.where(k >= 2, i_next, i)
        x = wp.where(k % 2 == 1, j_next, j)
        weight = wp.where(k >= 2, down, 1.0 - down) * wp.where(k % 2 == 1, aside, 1.0 - aside)
        beside = sample_row(picture.camera, view, SKY_STEP * x, SKY_STEP * y)
        weight = wp.max(weight, 1.0e-3) * likeness(picture, beside, SKY_STEP * x, SKY_STEP * y, spot)
        total += weight
        is_open += weight * float(sky[view, y, x])
    # Nothing like it nearby: a pole between two rays.
    return wp.where(total < 1.0e-4, plain, is_open / wp.max(total, 1.0e-4))


@wp.kernel(cuda_max_registers=48)
def gather_kernel(
    picture: Picture,
    sun: wp.array[wp.uint8],
    sky: wp.array3d[wp.uint8],
    with_sun: wp.bool,
    # out
    sun_out: wp.array[wp.uint8],
    sky_out: wp.array[wp.uint8],
):
    """Average the sun over 5 x 5 pixels where a shadow ends, and the nearest rays to the sky, on one surface.

    Launch: dim=(A, ceil(H / 8), ceil(W / 8), 64), block_dim=256.
    """
    view, down, aside, lane = wp.tid()
    v = tile_row(down, lane)
    u = tile_column(aside, lane)
    if u >= picture.camera.width or v >= picture.camera.height:
        return
    row = sample_row(picture.camera, view, u, v)
    if picture.samples.t[row] == wp.inf:
        return
    if with_sun:
        share = float(sun[row])
        if is_at_shadow_edge(picture, sun, view, u, v, sun[row]):
            share = smooth_sun(picture, sun, view, u, v, row)
        sun_out[row] = wp.uint8(int(wp.rint(wp.min(share, 255.0))))
    if sky.shape[0] > 0:
        is_open = blended_sky(picture, sky, view, u, v, row)
        sky_out[row] = wp.uint8(int(wp.rint(wp.min(is_open, 255.0))))
