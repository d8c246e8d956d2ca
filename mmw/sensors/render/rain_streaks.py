"""Draw streaks of the rain drops within a few meters of a camera; farther ones are part of the air.

Source: K. Garg, S. K. Nayar, "Vision and Rain", International Journal of Computer Vision 75(1), 2007.
"""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import math

import warp as wp

from mmw.core.camera_models import Intrinsics
from mmw.core.recorded_work import NewArrays
from mmw.kernels.camera import camera as camera_kernels
from mmw.kernels.camera import rain_streaks as kernels
from mmw.kernels.core import structs
from mmw.physics.weather.optics import marshall_palmer
from mmw.physics.weather.weather import Weather
from mmw.sensors.render.image_config import ImageConfig

DROP_REFLECTANCE = 0.94
"""Luminance of a drop over the mean luminance of the field of 165 deg that it refracts. Source: Garg and Nayar 2007."""

RANGE_M = 3.0
"""Farthest drop that is drawn by itself [m]: beyond, one covers less than 0.5 % of a pixel (fx 224 px, 5 ms)."""

NEAREST_M = 0.15
"""Nearest drop [m]; a housing keeps nearer ones away. Design value."""

SMALLEST_MM = 0.5
"""Smallest drop that is drawn [mm]: smaller ones hold 9 % of the area at 25 mm/h. Design value."""

LARGEST_MM = 8.0
"""Largest drop [mm]; larger ones break up. Source: as `mmw.physics.weather.optics.RAIN_EXTINCTION`."""

APERTURE_M = 0.002
"""Opening of the lens [m]: 4 mm at f/2, focused far away. It softens the streaks of near drops. Design value."""

MARGIN_RAD = 0.15
"""Drops are placed this far beyond the image's corners too, so that their streaks reach in [rad]. Design value."""


def make_rain(weather: Weather, config: ImageConfig, intrinsics: Intrinsics) -> kernels.Rain:
    """Return the drops around a camera, for kernels."""
    reach = intrinsics.reach()
    angle = min((reach if intrinsics.distortion.model == "fisheye" else math.atan(reach)) + MARGIN_RAD, math.pi)
    rain = kernels.Rain()
    rain.nearest, rain.range = NEAREST_M, RANGE_M
    rain.smallest, rain.largest = SMALLEST_MM, LARGEST_MM
    rain.cos_reach = math.cos(angle)
    n0, rain.slope = marshall_palmer(weather.rain_mm_h) if weather.rain_mm_h > 0.0 else (0.0, 1.0)
    volume = 2.0 * math.pi / 3.0 * (1.0 - rain.cos_reach) * RANGE_M**3
    rain.count = volume * n0 / rain.slope * math.exp(-rain.slope * SMALLEST_MM)
    rain.wind = wp.vec3(*weather.wind)
    rain.shutter = 0.001 * config.shutter_ms
    rain.aperture = APERTURE_M
    return rain


def streak_cover(
    views: structs.Views,
    twists: tuple[wp.array, wp.array],
    keys: wp.array,
    camera: camera_kernels.Camera,
    t: wp.array,
    rain: kernels.Rain,
    arrays: NewArrays | None = None,
) -> wp.array:
    """Return the opacity of the streaks in each pixel, times `kernels.streaks.COVER_SCALE`, shape [A, H, W], int32.

    Args:
        views: Camera poses, scene frame.
        twists: Velocity and angular velocity of each view (`mmw.sensors.render.optical_flow.device_twists`).
        keys: Random numbers of each view, shape [A], vec2ui.
        camera: The camera.
        t: Distance of what each pixel shows [m], row (view * H + v) * W + u; inf for sky (`SampleBuffer.samples.t`).
        rain: The drops; see `make_rain`.
        arrays: Source of arrays; new ones if absent.
    """
    arrays = arrays or NewArrays(keys.device)
    cover = arrays.full((len(keys), camera.height, camera.width), 0, int)
    most = math.ceil(rain.count + 6.0 * math.sqrt(rain.count))  # a Poisson number stays below, but once in 1e9
    if len(keys) and most:
        inputs = [views, *twists, keys, camera, t, rain]
        wp.launch(kernels.streaks_kernel, (len(keys), most), inputs, [cover], device=keys.device)
    return cover


def drop_light(environment: wp.vec3) -> wp.vec3:
    """Return the luminance of a falling drop [kcd/m2] from the mean luminance around the camera [kcd/m2]."""
    return DROP_REFLECTANCE * environment
