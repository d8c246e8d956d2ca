"""Map radiance to 8-bit sRGB images: exposure and the steps of `kernels/camera/tone_mapping.py`."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import warp as wp

from mmw.core.constants import FRAME_DT
from mmw.core.recorded_work import NewArrays
from mmw.kernels.camera import tone_mapping as kernels
from mmw.sensors.render.image_config import ExposureConfig, ImageConfig

SATURATION = 1.2
"""Luminance that is just white at EV100 0 [cd/m2]: L = 78 / (S q) 2^EV with S = 100 and q = 0.65 of a lens.

Source: saturation-based speed of ISO 12232; S. Lagarde, C. de Rousiers, "Moving Frostbite to Physically Based
Rendering", SIGGRAPH 2014, section 5.1."""


def exposure_of_ev100(ev100: float) -> float:
    """Return the factor on kcd/m2 of an exposure value at ISO 100 [1/(kcd/m2)]: 1 / (0.0012 x 2^EV)."""
    return 1000.0 / (SATURATION * 2.0**ev100)


def make_exposure(
    config: ExposureConfig, radiance: wp.array, weather_exposure: float, arrays: NewArrays | None = None
) -> wp.array:
    """Return the exposure of each picture, the factor on kcd/m2 that makes 1 white, shape [A], float32.

    `fixed` takes `ev100`, or else the weather's own exposure. `auto` brings the geometric mean of the luminance of each
    picture, all pixels alike, to middle gray (0.18) within the limits of EV100. It remembers nothing: the exposure of a
    frame does not depend on the frames before it, so it is the same for any batch. The compensation comes last.

    Args:
        config: Exposure section.
        radiance: Light [kcd/m2], shape [A, H, W], vec3.
        weather_exposure: Fixed exposure of the weather (`kernels.sky.Sky.exposure`) [1/(kcd/m2)].
        arrays: Source of arrays; new ones if absent.
    """
    arrays = arrays or NewArrays(radiance.device)
    (views, height, width), device = radiance.shape, radiance.device
    brighter = 2.0**config.ev_compensation
    if config.mode == "fixed":
        own = weather_exposure if config.ev100 is None else exposure_of_ev100(config.ev100)
        return arrays.full(views, brighter * own, float)
    exposure = arrays.empty(views, float)
    if views:
        log_sum = arrays.empty((views, width), float)
        wp.launch(kernels.meter_kernel, (views, width), [radiance], [log_sum], device=device)
        limits = (exposure_of_ev100(config.max_ev100), exposure_of_ev100(config.min_ev100))
        wp.launch(kernels.auto_exposure_kernel, views, [log_sum, height, brighter, *limits], [exposure], device=device)
    return exposure


def tone_map(
    radiance: wp.array,
    config: ImageConfig,
    exposure: wp.array,
    *,
    keys: wp.array | None = None,
    motion: wp.array | None = None,
    cover: wp.array | None = None,
    drop_light: wp.vec3 | None = None,
    arrays: NewArrays | None = None,
) -> wp.array:
    """Return pictures, sRGB, shape [A, H, W, 3], uint8, on the device of the light.

    In this order: motion blur, rain streaks, exposure, sensor noise, tone map, sRGB, rounding. What is None or off is
    left out.

    Args:
        radiance: Light [kcd/m2], linear Rec. 709, shape [A, H, W], vec3.
        config: Image section.
        exposure: Factor of each picture, shape [A]; see `make_exposure`.
        keys: Random numbers of each view, shape [A], vec2ui (`mmw.scene.views.view_keys`); for noise.
        motion: Image motion in one frame time [px], shape [A, H, W], vec2 (`mmw.sensors.render.optical_flow`), for
            blur.
        cover: Opacity of streaks, shape [A, H, W], int (`mmw.sensors.render.rain_streaks`).
        drop_light: Luminance of a falling drop [kcd/m2]; with `cover`.
        arrays: Source of arrays; new ones if absent.

    Raises:
        ValueError: If a step is on and what it needs is missing.
    """
    needs = (
        ("noise.enabled", config.noise.enabled, "keys", keys),
        ("motion_blur", config.motion_blur, "motion", motion),
        ("streaks", cover is not None, "drop_light", drop_light),
    )
    for key, is_on, name, value in needs:
        if is_on and value is None:
            raise ValueError(
                f"tone_map: {key} is on and {name} is None; the step needs it; pass {name}, or turn it off"
            )
    arrays = arrays or NewArrays(radiance.device)
    film = kernels.Film()
    film.exposure = exposure
    film.key = keys if config.noise.enabled else arrays.empty(0, wp.vec2ui)
    film.motion = motion if config.motion_blur else arrays.empty((0, 0, 0), wp.vec2)
    film.blur_share = 0.001 * config.shutter_ms / FRAME_DT
    film.cover = arrays.empty((0, 0, 0), int) if cover is None else cover
    film.drop_light = wp.vec3() if drop_light is None else drop_light
    film.full_well = config.noise.full_well if config.noise.enabled else 0.0
    film.read_noise = config.noise.read_noise
    film.tone_map = kernels.TONE_ACES if config.tone_map == "aces" else kernels.TONE_NONE
    image = arrays.empty((*radiance.shape, 3), wp.uint8)
    if image.size:
        wp.launch(kernels.tone_mapping_kernel, radiance.shape, [radiance, film], [image], device=arrays.device)
    return image
