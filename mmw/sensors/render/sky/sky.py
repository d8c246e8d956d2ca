"""Bake the sky of a weather into maps: clear air, clouds, fog and rain, the sun and the night."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import functools
import math
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.kernels.shading.aerial_perspective import HORIZON, Air
from mmw.kernels.shading.sky import BLURS, Sky
from mmw.physics.weather.optics import CONTRAST_THRESHOLD, fog_extinction, rain_extinction
from mmw.physics.weather.weather import FOG_VISIBILITY_M, Weather
from mmw.sensors.render.sky import atmosphere
from mmw.sensors.render.sky.clouds import heaps, sheet
from mmw.sensors.render.sky.prefilter import ROWS as ROWS_BLURRED
from mmw.sensors.render.sky.prefilter import blur, directions, octahedral, shrink, solid_angles

ROWS = 512
"""Rows of the sharp map; it has twice as many columns, 0.35 degrees each."""

SUN_RADIUS = math.radians(0.53) / 2.0
"""Angular radius of the sun [rad]. Source: 31.5 to 32.5 arc minutes across, Astronomical Almanac."""

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Share of each color in luminance. Source: ITU-R BT.709."""

HAZE_VISIBILITY_M = 10_000.0
"""Haze of the whole sky goes down to this visibility [m]; what takes more lies in a shallow layer, as mist and fog do.
Design value."""

LAYER_M = 250.0
"""Depth of fog, and of the rain that dims the sky near the horizon [m]. Design value."""

CARLA_HAZE, CARLA_BLUE = Weather.mie_scattering_scale, Weather.rayleigh_scattering_scale
"""CARLA's scales of haze and blue at which the air is natural: its defaults."""

RAYLEIGH_550 = 13.558e-6
"""Scattering of the gas at 550 nm, which every visibility includes [1/m]. Source: `atmosphere.RAYLEIGH_PER_M`."""

HAZE_COLOURS = (np.array([610.0, 550.0, 465.0]) / 550.0) ** -atmosphere.HAZE_EXPONENT
"""Extinction of haze in red, green and blue over that at 550 nm: at the middles of the three colors."""

NIGHT_KLUX = 0.2e-3
"""Illuminance of level ground by a clear night sky over a town without moon [klux]: glow of lights, more than the 0.05
lux of Berlin's clear sky to stand for what lights spill. Source: C. Kyba et al., PLoS ONE 6, 2011; design value."""

NIGHT_CLOUD_GAIN = 4.0
"""Factor by which an overcast sky brightens the night of a town. Source: Kyba et al. 2011: 10 in the
city, 3 in suburbs."""

NIGHT_COLOUR = np.array([0.80, 1.02, 1.39])
"""Color of the night sky, luminance 1. Design value."""

CLOUD_TINT = 0.4
"""Share of the color of daylight that an overcast sky has. Design value."""

CLOUD_AIR_SHARE = 0.8
"""Share of the gas above the clouds; haze, which is lower, counts as its cube. Source: exp(-1.7 km / 8 km)."""

SHEET_CONTRAST = 0.22
"""Largest deviation of an overcast sky from the smooth one. Design value."""

KEY_KLUX, KEY_POWER = 100.0, 0.17
"""Illuminance of level ground under which white is white [klux], and how slowly pictures get darker below it: the key
is (illuminance / 100 klux)^0.17. Design values."""


@dataclass(frozen=True)
class BakedSky:
    """The sky of a weather in NumPy; directions as in `mmw.kernels.shading.sky`, colors as in
    `mmw.sensors.render.sky.atmosphere`."""

    map: np.ndarray
    """Luminance [kcd/m2], shape [R, 2 R, 3], float32."""
    small: np.ndarray
    """The same, shape [64, 128, 3], float64."""
    sun_illuminance: np.ndarray
    """Illuminance by the sun of a plane that faces it [klux], shape [3]."""
    horizontal_klux: float
    """Illuminance of level ground by sun and sky [klux]."""
    horizon: np.ndarray
    """Airlight of level directions [kcd/m2], shape [`HORIZON`, 3]; see `mmw.kernels.shading.aerial_perspective.Air`."""
    upward: np.ndarray
    """More airlight upward [kcd/m2], shape [3]."""
    downward: np.ndarray
    """Less airlight downward [kcd/m2], shape [3]."""
    glow: np.ndarray
    """Sunlight that fog scatters [klux], shape [3]."""


def sun_direction(weather: Weather) -> np.ndarray:
    """Return the unit vector to the sun, scene frame (x east, y north, z up), shape [3], float64."""
    altitude, azimuth = math.radians(weather.sun_altitude_deg), math.radians(weather.sun_azimuth_deg)
    level = math.cos(altitude)
    return np.array([level * math.sin(azimuth), level * math.cos(azimuth), math.sin(altitude)])


def clear_air(weather: Weather) -> atmosphere.Air:
    """Return the gas and the haze of the whole sky: what the visibility says, and CARLA's two scales."""
    sight = max(weather.visibility_m, HAZE_VISIBILITY_M)
    haze = max(-math.log(CONTRAST_THRESHOLD) / sight - RAYLEIGH_550, 0.0)
    gas = atmosphere.RAYLEIGH_PER_M * (weather.rayleigh_scattering_scale / CARLA_BLUE)
    haze = atmosphere.HAZE_SPECTRUM * (haze * weather.mie_scattering_scale / CARLA_HAZE)
    return atmosphere.Air(tuple(gas.tolist()), tuple(haze.tolist()))


def layer_depth(weather: Weather) -> float:
    """Return the optical depth straight up of the fog and rain that the clear sky does not hold [-]."""
    thick = fog_extinction(weather, 550) - fog_extinction(Weather(visibility_m=HAZE_VISIBILITY_M), 550)
    height = LAYER_M
    if weather.fog_falloff_per_m > 0.0:
        height = -math.expm1(-weather.fog_falloff_per_m * LAYER_M) / weather.fog_falloff_per_m
    return max(thick, 0.0) * height + rain_extinction(weather.rain_mm_h, 550) * LAYER_M


def smooth_step(low: float, high: float, x: np.ndarray | float) -> np.ndarray:
    """Return 0 below `low`, 1 above `high` and 3 t^2 - 2 t^3 between."""
    t = np.clip((np.asarray(x, dtype=float) - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def overcast_share(cloudiness: float) -> float:
    """Return global illuminance under clouds over that of the clear sky: 1 - 0.75 c^3.4.

    Source: F. Kasten and G. Czeplak, Solar Energy 24, 1980.
    """
    return 1.0 - 0.75 * cloudiness**3.4


def rain_share(rain_mm_h: float) -> float:
    """Return illuminance under rain clouds over that under dry ones: 1 / (1 + 0.5 R^0.6).

    Design: 0.43 at 5 mm/h, 0.23 at 25, 0.16 at 50, which takes a noon under clouds to 11, 6 and 4 klux.
    """
    return 1.0 / (1.0 + 0.5 * rain_mm_h**0.6)


def beam_share(cloudiness: float) -> float:
    """Return how much of the sun's beam clouds let through: all up to 0.4, nothing from 0.8. Design."""
    return 1.0 - float(smooth_step(0.4, 0.8, cloudiness))


def exposure(horizontal_klux: float) -> float:
    """Return the fixed exposure [m2/kcd] of a weather, as an incident-light meter on level ground sets it.

    A level gray of 18 % becomes 0.18 x key: exposure = pi key / E with the key (E / 100 klux)^0.17, which is 1 at a
    clear noon, 0.8 under clouds, 0.6 in heavy rain, 0.2 under street lights, and 0.11 at night without them. A meter
    without key would set EV100 = log2(100 E / C), E in lux, C = 250.

    Source of C: ISO 2720, flat receptor. Key: design.
    """
    return math.pi / horizontal_klux * (horizontal_klux / KEY_KLUX) ** KEY_POWER


def on_ground(image: np.ndarray) -> np.ndarray:
    """Return the illuminance of level ground by the upper half of a map [klux], shape [3]."""
    rows = image.shape[0]
    weight = solid_angles(rows) * np.maximum(directions(rows)[:, 0, 2], 0.0)
    return np.einsum("r,rck->k", weight, image)


def bake(weather: Weather, seed: int = 0, rows: int = ROWS) -> BakedSky:
    """Return the sky of a weather; the last ones are kept."""
    return _bake(weather, seed, rows)


@functools.lru_cache(maxsize=16)
def _bake(weather: Weather, seed: int, rows: int) -> BakedSky:
    to_sun = sun_direction(weather)
    air = clear_air(weather)
    altitude = math.radians(weather.sun_altitude_deg)
    cover = weather.cloudiness
    at = directions(rows)[: rows // 2]

    clear = _clear(weather, air, at)
    sun = atmosphere.sun_illuminance(air, altitude)
    total = _ground_of_half(clear) + sun * max(to_sun[2], 0.0)
    # An overcast sky in the color of all the light that reaches the clouds, less deep: their tops stand above haze.
    grey = total * overcast_share(1.0)
    grey = grey * CLOUD_TINT + (grey @ LUMINANCE) * (1.0 - CLOUD_TINT)
    share = float(smooth_step(0.6, 1.0, cover))
    upper = _with_heaps(weather, air, at, clear, total, seed) if share < 1.0 else np.zeros_like(clear)
    if share > 0.0:
        overcast = overcast_luminance(grey, at[..., 2:]) * (1.0 + SHEET_CONTRAST * sheet(at, seed)[..., None])
        overcast *= grey / _ground_of_half(overcast)
        upper = upper * (1.0 - share) + overcast * share
    upper = upper * rain_share(weather.rain_mm_h)
    sun = sun * beam_share(cover) * rain_share(weather.rain_mm_h)
    night = NIGHT_COLOUR * NIGHT_KLUX * (1.0 + (NIGHT_CLOUD_GAIN - 1.0) * cover**2)
    upper = upper + night * (1.0 - 0.5 * at[..., 2:]) / (math.pi * (1.0 - 1.0 / 3.0))
    return _with_fog(weather, upper, sun, to_sun)


def overcast_luminance(klux: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return the luminance of an overcast sky [kcd/m2] that lights level ground with so much.

    Args:
        klux: Illuminance of level ground [klux].
        up: Sine of the elevation.

    Source: CIE's overcast sky, P. Moon and D. Spencer 1942: L = Lz (1 + 2 sin(elevation)) / 3, which gives 7 / 9 pi Lz.
    """
    return klux / (7.0 / 9.0 * math.pi) * ((1.0 + 2.0 * up) / 3.0)


def _with_heaps(
    weather: Weather, air: atmosphere.Air, at: np.ndarray, clear: np.ndarray, total: np.ndarray, seed: int
) -> np.ndarray:
    """Return the upper half of a clear sky with heaped clouds in it, shape [R, C, 3].

    Haze and gas before a cloud take light away and add that of the sky, as for everything far away.
    """
    if weather.cloudiness <= 0.0:
        return clear
    to_sun = sun_direction(weather)
    light = heaps(at, to_sun, weather.cloudiness, seed)
    aloft = CLOUD_AIR_SHARE
    high = atmosphere.Air(tuple(aloft * g for g in air.rayleigh), tuple(aloft**3 * h for h in air.haze))
    beam = atmosphere.sun_illuminance(high, math.radians(weather.sun_altitude_deg))
    around = (_ground_of_half(clear) + atmosphere.GROUND_ALBEDO * total) / (2.0 * math.pi)
    cloud = light[..., :1] * beam + light[..., 1:2] * around
    extinction = (np.array(air.haze) * 0.7 + np.array(air.rayleigh)) @ np.maximum(atmosphere.TO_RGB, 0.0)
    passed = np.exp(-light[..., 3:] * extinction)
    return clear * (1.0 - light[..., 2:3] * passed) + cloud * passed


def _clear(weather: Weather, air: atmosphere.Air, at: np.ndarray) -> np.ndarray:
    """Return the clear sky's luminance in directions of the upper half, shape [R, C, 3]."""
    elevation = np.linspace(0.0, 1.0, 49) ** 2 * math.pi / 2.0
    azimuth = np.linspace(0.0, 1.0, 49) ** 1.5 * math.pi
    table = atmosphere.sky_radiance(air, math.radians(weather.sun_altitude_deg), elevation, azimuth)
    columns = at.shape[1]
    off = np.abs(np.remainder((np.arange(columns) + 0.5) / columns - weather.sun_azimuth_deg / 360.0 + 0.5, 1.0) - 0.5)
    row = np.sqrt(np.arcsin(at[:, 0, 2]) / (math.pi / 2.0)) * 48
    column = (off * 2.0) ** (1.0 / 1.5) * 48
    i, j = np.minimum(row.astype(int), 47), np.minimum(column.astype(int), 47)
    fi, fj = (row - i)[:, None, None], (column - j)[:, None]
    lines = table[i] * (1.0 - fi) + table[i + 1] * fi
    return lines[:, j] * (1.0 - fj) + lines[:, j + 1] * fj


def _ground_of_half(upper: np.ndarray) -> np.ndarray:
    """Return the illuminance of level ground by the upper half of a map [klux], shape [3]."""
    rows = 2 * upper.shape[0]
    at = directions(rows)[: rows // 2, 0, 2]
    return np.einsum("r,rck->k", solid_angles(rows)[: rows // 2] * at, upper)


def _with_fog(weather: Weather, upper: np.ndarray, sun: np.ndarray, to_sun: np.ndarray) -> BakedSky:
    """Return the whole sky with ground below and the layer of fog and rain in front of both."""
    depth = layer_depth(weather)
    half, columns = upper.shape[:2]
    at = directions(2 * half)
    rows = np.concatenate((upper, np.empty_like(upper)))
    diffuse = _ground_of_half(upper)
    total = diffuse + sun * max(to_sun[2], 0.0)
    # Fog does not absorb: what it does not send back comes down (two streams, g = 0.85).
    inside = total / (1.0 + 0.75 * depth * 0.15)
    sun = sun * math.exp(-depth / max(to_sun[2], 0.02)) if to_sun[2] > -SUN_RADIUS else np.zeros(3)

    # Level airlight: the clear horizon by azimuth, and the more fog the more the mean of all directions.
    foggy = -math.expm1(-depth)
    sine = np.linspace(0.0, 1.0, HORIZON)
    turn = np.degrees(2.0 * np.arcsin(sine)) + weather.sun_azimuth_deg
    column = np.remainder(turn / 360.0 * columns - 0.5, columns)
    c, f = column.astype(int) % columns, (column - np.floor(column))[:, None]
    last = upper[-1]
    clear_horizon = last[c] * (1.0 - f) + last[(c + 1) % columns] * f
    mean = inside / math.pi
    horizon = clear_horizon * (1.0 - foggy) + 0.6 * mean * foggy
    up, down = 0.6 * mean * foggy, 0.4 * mean * foggy
    glow = sun * foggy * weather.scattering_intensity

    level = np.hypot(at[..., 0], at[..., 1]) * math.hypot(to_sun[0], to_sun[1])
    cosine = (at[..., 0] * to_sun[0] + at[..., 1] * to_sun[1]) / np.maximum(level, 1e-12)
    s = np.sqrt(np.clip(0.5 - 0.5 * cosine[0], 0.0, 1.0)) * (HORIZON - 1)
    i = np.minimum(s.astype(int), HORIZON - 2)
    f = (s - i)[:, None]
    light = (horizon[i] * (1.0 - f) + horizon[i + 1] * f)[None]
    z = at[..., 2:]
    light = light + up * np.maximum(z, 0.0) + down * np.minimum(z, 0.0)
    if glow.any():
        to = np.clip(at @ to_sun, -1.0, 1.0)
        light = light + glow * ((1.0 - 0.85**2) / (4.0 * math.pi * (1.0 + 0.85**2 - 1.7 * to) ** 1.5))[..., None]

    ground = atmosphere.GROUND_ALBEDO * (inside if depth > 0.0 else total) / math.pi
    below = smooth_step(0.0, math.sin(math.radians(4.0)), -z[half:])
    rows[half:] = light[half:] * (1.0 - below) + ground * below
    passed = np.exp(-depth / np.maximum(np.abs(z), 1e-4))
    rows = rows * passed + light * (1.0 - passed)
    small = shrink(rows)
    lit = float((on_ground(small) + sun * max(to_sun[2], 0.0)) @ LUMINANCE)
    return BakedSky(rows.astype(np.float32), small, sun, lit, horizon, up, down, glow)


def ground_radiance(weather: Weather, seed: int = 0) -> np.ndarray:
    """Return the mean luminance of open ground under sun and sky [kcd/m2], shape [3]."""
    return on_ground(bake(weather, seed).small[::-1]) / math.pi


def mean_radiance(weather: Weather, seed: int = 0) -> np.ndarray:
    """Return the mean luminance of all directions, ground included, sun excluded [kcd/m2], shape [3]."""
    small = bake(weather, seed).small
    return np.einsum("r,rck->k", solid_angles(small.shape[0]), small) / (4.0 * math.pi)


def make_sky(weather: Weather, device: str, seed: int = 0, rows: int = ROWS, lights_klux: float = 0.0) -> Sky:
    """Return the sky of a weather on a device; equal weathers share one.

    Args:
        weather: The weather.
        device: Warp device.
        seed: Of the clouds.
        rows: Of the sharp map, a multiple of 128.
        lights_klux: Illuminance of level ground by lights [klux]; the exposure counts it with that by sun and sky.
    """
    return _make_sky(weather, str(device), seed, rows, lights_klux)


@functools.lru_cache(maxsize=16)
def _make_sky(weather: Weather, device: str, seed: int, rows: int, lights_klux: float) -> Sky:
    baked = bake(weather, seed, rows)
    scale = float((baked.small @ LUMINANCE).mean())
    blurred = [blur(baked.small, (k + 1) / BLURS) for k in range(BLURS)] + [blur(baked.small, None)]
    sky = Sky()
    sky.map = _texels(octahedral(baked.map / scale, 3 * rows // 2), device)
    sky.blurred = _texels(np.stack([octahedral(image / scale, 2 * ROWS_BLURRED) for image in blurred]), device)
    sky.scale = scale
    sky.sun_direction = wp.vec3(*sun_direction(weather))
    sky.sun_illuminance = wp.vec3(*baked.sun_illuminance)
    sky.sun_radius = SUN_RADIUS
    sky.exposure = exposure(baked.horizontal_klux + lights_klux)
    return sky


def _texels(values: np.ndarray, device: str) -> wp.array:
    """Return maps as an array of four halves a texel in one word, the fourth 0."""
    texels = np.zeros((*values.shape[:-1], 4), np.float16)
    texels[..., :3] = np.minimum(values, 60_000.0)
    return wp.array(texels.view(np.uint64)[..., 0], dtype=wp.uint64, device=device)


def make_air(weather: Weather, device: str, ground_z: float = 0.0, seed: int = 0, rows: int = ROWS) -> Air:
    """Return the air of a weather on a device, which fades to the horizon of `make_sky`.

    Below a visibility of 1 km fog is gray; up to `HAZE_VISIBILITY_M` haze takes on its color (it scatters blue more).
    Green has the extinction at 550 nm that every other sensor has.

    Args:
        weather: The weather.
        device: Warp device.
        ground_z: Height of the ground, scene frame [m].
        seed: Of the clouds.
        rows: Of the sharp map of `make_sky`.
    """
    baked = bake(weather, seed, rows)
    tint = float(smooth_step(FOG_VISIBILITY_M, HAZE_VISIBILITY_M, weather.visibility_m))
    air = Air()
    air.rain_extinction = rain_extinction(weather.rain_mm_h, 550)
    air.fog_extinction = wp.vec3(*(fog_extinction(weather, 550) * HAZE_COLOURS**tint))
    air.fog_start = weather.fog_start_m
    air.fog_falloff = weather.fog_falloff_per_m
    air.ground_z = ground_z
    air.horizon = wp.array(baked.horizon.astype(np.float32), dtype=wp.vec3, device=str(device))
    air.upward, air.downward = wp.vec3(*baked.upward), wp.vec3(*baked.downward)
    air.glow = wp.vec3(*baked.glow)
    return air
