"""Filters that average the rays to sun and sky of neighbouring pixels on the same smooth surface.

Source: H. Dammertz et al., "Edge-avoiding A-Trous wavelet transform", High Performance Graphics 2010.
"""

import warp as wp

from mmw.kernels.camera import Camera, camera_ray, tile_column, tile_row
from mmw.kernels.lighting import SKY_STEP
from mmw.kernels.looks import Samples
from mmw.kernels.packing import unpack_unit
from mmw.kernels.structs import Views
from mmw.kernels.visibility import sample_row

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": True})

SHADE_STEP = wp.constant(64.0)
"""Difference of the sky in sight, in 255ths, from which later passes of the filter keep apart. Design value: noise of
the first pass stays below half of it."""

FLATNESS = wp.constant(0.01)
"""Distance from a plane that still belongs to its surface, over the range and at least of 1 m [-]. Design value."""


@wp.func
def likeness(
    camera: Camera, samples: Samples, row: int, u: int, v: int, point: wp.vec3, normal: wp.vec3,
    normal_in_scene: wp.vec3, slack: float,
) -> float:  # fmt: skip
    """Return how much a pixel lies on the same smooth surface as a point: 0 to 1.

    Args:
        camera: The camera.
        samples: What the pixels see.
        row: The pixel.
        u: Its column.
        v: Its row in the image.
        point: The point, sensor frame [m].
        normal: Its normal, sensor frame.
        normal_in_scene: The same, scene frame.
        slack: One over the distance from the plane that still counts [1/m].
    """
    t = samples.t[row]
    weight = wp.float32(0.0)
    if t < wp.inf:
        there = t * camera_ray(camera, float(u) + 0.5, float(v) + 0.5)
        alike = wp.max(wp.dot(normal_in_scene, unpack_unit(samples.normal[row])), 0.0)
        alike = alike * alike
        alike = alike * alike
        weight = alike * alike * wp.max(1.0 - wp.abs(wp.dot(there - point, normal)) * slack, 0.0)
    return weight


@wp.kernel
def smooth_sky_kernel(
    views: Views,
    camera: Camera,
    samples: Samples,
    sky: wp.array3d[wp.uint8],
    reach: int,
    # out
    sky_out: wp.array3d[wp.uint8],
):
    """Average the sky's rays over 5 x 5 of them, `reach` rays apart, that left the same smooth surface.

    Launch: dim=(A, tile rows, tile columns, 64) of the rays, block_dim=64.
    """
    view, down, aside, lane = wp.tid()
    i = tile_row(down, lane)
    j = tile_column(aside, lane)
    if i >= sky.shape[1] or j >= sky.shape[2]:
        return
    row = sample_row(camera, view, SKY_STEP * j, SKY_STEP * i)
    t = samples.t[row]
    if t == wp.inf:
        sky_out[view, i, j] = wp.uint8(255)
        return
    in_scene = unpack_unit(samples.normal[row])
    normal = wp.transform_vector(wp.transform_inverse(views.pose[view]), in_scene)
    point = t * camera_ray(camera, float(SKY_STEP * j) + 0.5, float(SKY_STEP * i) + 0.5)
    slack = 1.0 / (FLATNESS * t + FLATNESS)
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
                beside = sample_row(camera, view, SKY_STEP * x, SKY_STEP * y)
                weight = likeness(camera, samples, beside, SKY_STEP * x, SKY_STEP * y, point, normal, in_scene, slack)
                # The 16 directions of 4 x 4 rays count the same: those at both ends of the square share one.
                weight *= wp.where(wp.abs(a) == 2, 0.5, 1.0) * wp.where(wp.abs(b) == 2, 0.5, 1.0)
                value = float(sky[view, y, x])
                if reach > 1:  # what the first pass made differs by noise or by a near thing's shade, which stays
                    weight *= wp.max(1.0 - wp.abs(value - own) / SHADE_STEP, 0.0)
                total += weight
                is_open += weight * value
    sky_out[view, i, j] = wp.uint8(int(wp.rint(wp.min(is_open / total, 255.0))))


@wp.kernel
def gather_kernel(
    views: Views,
    camera: Camera,
    samples: Samples,
    sun: wp.array[wp.uint8],
    sky: wp.array3d[wp.uint8],
    with_sun: wp.bool,
    # out
    sun_out: wp.array[wp.uint8],
    sky_out: wp.array[wp.uint8],
):
    """Average the sun over 5 x 5 pixels where a shadow ends, and the nearest rays to the sky, on one surface.

    Launch: dim=(A, ceil(H / 8), ceil(W / 8), 64), block_dim=64.
    """
    view, down, aside, lane = wp.tid()
    v = tile_row(down, lane)
    u = tile_column(aside, lane)
    if u >= camera.width or v >= camera.height:
        return
    row = sample_row(camera, view, u, v)
    t = samples.t[row]
    if t == wp.inf:
        return
    in_scene = unpack_unit(samples.normal[row])
    normal = wp.transform_vector(wp.transform_inverse(views.pose[view]), in_scene)
    point = t * camera_ray(camera, float(u) + 0.5, float(v) + 0.5)
    slack = 1.0 / (FLATNESS * t + FLATNESS)
    if with_sun:
        own = sun[row]
        same = wp.bool(True)
        for k in range(8):  # two pixels away all round: away from a shadow's edge there is nothing to average
            x = wp.clamp(u + 2 * (wp.where(k < 3, 1, 0) - wp.where(k > 2 and k < 6, 1, 0)), 0, camera.width - 1)
            y = wp.clamp(v + 2 * (k % 3 - 1), 0, camera.height - 1)
            if k > 5:
                x = u
                y = wp.clamp(v + 2 * (2 * k - 13), 0, camera.height - 1)
            same = same and sun[sample_row(camera, view, x, y)] == own
        share = float(own)
        if not same:
            total = wp.float32(0.01)
            lit = 0.01 * float(own)
            for a in range(-2, 3):
                for b in range(-2, 3):
                    y = v + a
                    x = u + b
                    if y >= 0 and x >= 0 and y < camera.height and x < camera.width:
                        beside = sample_row(camera, view, x, y)
                        weight = likeness(camera, samples, beside, x, y, point, normal, in_scene, slack)
                        # The 16 points of the disc that 4 x 4 pixels look at count the same.
                        weight *= wp.where(wp.abs(a) == 2, 0.5, 1.0) * wp.where(wp.abs(b) == 2, 0.5, 1.0)
                        total += weight
                        lit += weight * float(sun[beside])
            share = lit / total
        sun_out[row] = wp.uint8(int(wp.rint(wp.min(share, 255.0))))
    if sky.shape[0] > 0:
        total = wp.float32(0.0)
        is_open = wp.float32(0.0)
        plain = wp.float32(0.0)
        plain_total = wp.float32(0.0)
        for a in range(2):
            for b in range(2):
                y = wp.min(v // SKY_STEP + a, sky.shape[1] - 1)
                x = wp.min(u // SKY_STEP + b, sky.shape[2] - 1)
                beside = sample_row(camera, view, SKY_STEP * x, SKY_STEP * y)
                weight = (1.0 - wp.abs(float(u) / float(SKY_STEP) - float(x))) * (
                    1.0 - wp.abs(float(v) / float(SKY_STEP) - float(y))
                )
                weight = wp.max(weight, 1.0e-3)
                plain += weight * float(sky[view, y, x])
                plain_total += weight
                weight *= likeness(camera, samples, beside, SKY_STEP * x, SKY_STEP * y, point, normal, in_scene, slack)
                total += weight
                is_open += weight * float(sky[view, y, x])
        if total < 1.0e-4:  # nothing like it nearby: a pole between two rays
            is_open = plain
            total = plain_total
        sky_out[row] = wp.uint8(int(wp.rint(wp.min(is_open / total, 255.0))))
