"""Map light to an image: blur, rain before the lens, exposure, noise, tone map, sRGB, 8 bits.

All steps are one kernel, because a plain picture is read and written once. What is not asked for costs a comparison
that is the same for all threads.
"""

import warp as wp

from mmw.kernels.camera.rain_streaks import COVER_SCALE
from mmw.kernels.core.compiler import FAST
from mmw.kernels.core.noise import normal2, uniform4

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "fast_math": True, "cpu_compiler_flags": FAST}
)

TONE_NONE = wp.constant(0)
TONE_ACES = wp.constant(1)

BLUR_TAPS = wp.constant(8)
"""Places along the motion that a blurred pixel averages. Design value."""

MIN_BLUR = wp.constant(0.25)
"""Motion while the shutter is open below which a pixel is not blurred [px]. Design value."""

DARKEST = wp.constant(1.0e-6)
"""Luminance added before the logarithm of the metering [kcd/m2]: starlight, so that black counts. Design value."""

BRIGHTEST = wp.constant(1.0e6)
"""Exposed value beyond which the tone map is not evaluated: its squares would overflow, and it is white long before."""

MIDDLE_GREY = wp.constant(0.18)
"""Exposed value that the mean of a metered picture gets. Source: 18 % gray card, E. Reinhard et al., "Photographic Tone
Reproduction for Digital Images", SIGGRAPH 2002."""

NOISE_DRAW = wp.constant(0)
"""Draw of a view's stream of the sensor noise; streaks use the others."""


@wp.struct
class Film:
    """Parameters of the conversion of radiance to images. Arrays of shape 0 leave their step out."""

    exposure: wp.array[float]
    """Factor on kcd/m2 that makes 1 white before the tone map, shape [A]."""
    key: wp.array[wp.vec2ui]
    """Random numbers of each view, shape [A]; read by the noise only."""
    motion: wp.array3d[wp.vec2]
    """Image motion while the shutter is open over `blur_share` [px], shape [A, H, W]."""
    blur_share: float
    """Exposure time over the time of `motion` [-]."""
    cover: wp.array3d[int]
    """Opacity of rain streaks times `COVER_SCALE`, shape [A, H, W]."""
    drop_light: wp.vec3
    """Luminance of a rain drop [kcd/m2]."""
    full_well: float
    """Electrons of an exposed value of 1; 0 for no noise [e-]."""
    read_noise: float
    """Standard deviation of the read noise [e-]."""
    tone_map: int
    """`TONE_NONE` or `TONE_ACES`."""


@wp.func
def luminance(color: wp.vec3) -> float:
    """Return the luminance of linear RGB. Source: ITU-R BT.709-6."""
    return 0.2126 * color[0] + 0.7152 * color[1] + 0.0722 * color[2]


@wp.func
def aces(x: float) -> float:
    """Return the tone-mapped value, 0 to 1, of an exposed one.

    Source: K. Narkowicz, "ACES Filmic Tone Mapping Curve", 2015.
    """
    y = wp.max(x, 0.0)
    return wp.clamp((y * (2.51 * y + 0.03)) / (y * (2.43 * y + 0.59) + 0.14), 0.0, 1.0)


@wp.func
def srgb(x: float) -> float:
    """Return the sRGB value of a linear one, both 0 to 1. Source: IEC 61966-2-1."""
    if x <= 0.0031308:
        return 12.92 * x
    return 1.055 * wp.pow(x, 1.0 / 2.4) - 0.055


@wp.func
def display(x: float, tone_map: int) -> wp.uint8:
    """Return the 8-bit sRGB value of an exposed one."""
    shown = wp.clamp(x, 0.0, 1.0)
    if tone_map == TONE_ACES:
        shown = aces(wp.min(x, BRIGHTEST))
    return wp.uint8(int(255.0 * srgb(shown) + 0.5))


@wp.func
def between_pixels(image: wp.array3d[wp.vec3], view: int, u: float, v: float) -> wp.vec3:
    """Return an image at any place, by the four nearest pixels; the outermost pixels go on beyond the edges.

    Args:
        image: Shape [A, H, W].
        view: View.
        u: Column [px], pixel centers at +0.5.
        v: Row [px].
    """
    x = wp.clamp(u - 0.5, 0.0, float(image.shape[2] - 1))
    y = wp.clamp(v - 0.5, 0.0, float(image.shape[1] - 1))
    left = wp.min(int(x), wp.max(image.shape[2] - 2, 0))
    top = wp.min(int(y), wp.max(image.shape[1] - 2, 0))
    right = wp.min(left + 1, image.shape[2] - 1)
    low = wp.min(top + 1, image.shape[1] - 1)
    a = x - float(left)
    b = y - float(top)
    upper = (1.0 - a) * image[view, top, left] + a * image[view, top, right]
    lower = (1.0 - a) * image[view, low, left] + a * image[view, low, right]
    return (1.0 - b) * upper + b * lower


@wp.func
def blurred(radiance: wp.array3d[wp.vec3], view: int, u: int, v: int, motion: wp.vec2) -> wp.vec3:
    """Return the mean radiance along the motion of a pixel.

    Args:
        radiance: Light [kcd/m2], shape [A, H, W].
        view: View.
        u: Column of the pixel.
        v: Row of the pixel.
        motion: Motion while the shutter is open [px]; the shutter is half open at the frame's instant.
    """
    if wp.dot(motion, motion) < MIN_BLUR * MIN_BLUR:
        return radiance[view, v, u]
    total = wp.vec3()
    for tap in range(BLUR_TAPS):
        place = (float(tap) + 0.5) / float(BLUR_TAPS) - 0.5
        total += between_pixels(radiance, view, float(u) + 0.5 + place * motion[0], float(v) + 0.5 + place * motion[1])
    return total / float(BLUR_TAPS)


@wp.kernel
def tone_mapping_kernel(
    radiance: wp.array3d[wp.vec3],
    film: Film,
    # out
    image_out: wp.array4d[wp.uint8],
):
    """Write sRGB images [A, H, W, 3] of radiance [kcd/m2].

    Launch: dim=(A, H, W).
    """
    view, v, u = wp.tid()
    light = radiance[view, v, u]
    if film.motion.shape[0] > 0:
        light = blurred(radiance, view, u, v, film.blur_share * film.motion[view, v, u])
    if film.cover.shape[0] > 0:
        cover = wp.min(float(film.cover[view, v, u]) / COVER_SCALE, 1.0)
        light += cover * (film.drop_light - light)
    value = film.exposure[view] * light
    if film.full_well > 0.0:
        draw = uniform4(film.key[view], v * radiance.shape[2] + u, NOISE_DRAW)
        first = normal2(draw[0], draw[1])
        second = normal2(draw[2], draw[3])
        random = wp.vec3(first[0], first[1], second[0])
        for channel in range(3):
            electrons = wp.max(value[channel], 0.0) * film.full_well
            spread = wp.sqrt(electrons + film.read_noise * film.read_noise) / film.full_well
            value[channel] = value[channel] + spread * random[channel]
    for channel in range(3):
        image_out[view, v, u, channel] = display(value[channel], film.tone_map)


@wp.kernel
def meter_kernel(
    radiance: wp.array3d[wp.vec3],
    # out
    log_sum_out: wp.array2d[float],
):
    """Write the sum of the logarithms of the luminances of each column [ln kcd/m2], shape [A, W].

    Launch: dim=(A, W).
    """
    view, u = wp.tid()
    total = wp.float32(0.0)
    for v in range(radiance.shape[1]):
        total += wp.log(wp.max(luminance(radiance[view, v, u]), 0.0) + DARKEST)
    log_sum_out[view, u] = total


@wp.kernel
def auto_exposure_kernel(
    log_sum: wp.array2d[float],
    height: int,
    brighter: float,
    least: float,
    most: float,
    # out
    exposure_out: wp.array[float],
):
    """Write the exposure that brings each view's geometric mean to middle gray.

    Args:
        log_sum: From `meter_kernel`, shape [A, W].
        height: Rows of an image.
        brighter: Compensation, a factor.
        least: Smallest exposure before the compensation [1/(kcd/m2)].
        most: Largest exposure before the compensation [1/(kcd/m2)].
        exposure_out: Exposure, shape [A].

    Launch: dim=(A,).
    """
    view = wp.tid()
    total = wp.float32(0.0)
    for u in range(log_sum.shape[1]):
        total += log_sum[view, u]
    mean = wp.exp(total / float(log_sum.shape[1] * height))
    exposure_out[view] = brighter * wp.clamp(MIDDLE_GREY / mean, least, most)
