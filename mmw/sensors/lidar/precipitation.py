"""Tabulate rain and fog for a LiDAR: power and range of drops, and the mean power of fog over range."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import functools
import math
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.kernels.lidar.precipitation import FOG_SAMPLES, PATCHES, Air, patches_kernel
from mmw.physics.weather.optics import extinction, fog_backscatter, marshall_palmer
from mmw.physics.weather.weather import FOG_VISIBILITY_M, Weather
from mmw.sensors.lidar.optics import LidarOptics

SMALLEST_DROP_MM = 0.05
"""Smallest rain drop [mm]. Source: LISA, arXiv 2107.07004."""

LARGEST_DROP_MM = 8.0
"""Largest rain drop [mm]: larger ones break up. Source: Pruppacher and Klett, "Microphysics of Clouds", 1997."""

PATCHINESS = 0.4
"""Standard deviation of ln power of fog from patch to patch. Design value."""

PATCH_M = 2.0
"""Size of a patch of fog [m]. Design value."""

NOISE_LIMIT = 4.0
"""Standard deviations above which patches and noise are not looked for: fog that needs more to be detected has no
echo."""

RANGES = 4000
"""Ranges of the integrals, equal steps of the logarithm."""

POWERS = 512
"""Powers at which the mean number of drops is integrated."""

ENTRIES = 256
"""Entries of the drop tables, equal steps of the logarithm of the mean number of drops."""

LEVELS = 64
"""Quantiles of range of an entry."""

FEWEST_SHARE = 1e-6
"""First entry of the drop tables, as a share of the drops that can be detected; stronger ones count as this strong."""

FEWEST_DROPS = 1e-9
"""Mean number of drops of a ray that is none: the 24 bits of a random number do not reach it."""

FOG_ENTRIES = 16
"""Entries of the fog table inside a step of range."""


@dataclass(frozen=True)
class RainTable:
    """Strength and distance of the drops on a ray, in a uniform grid of the logarithm of their mean number."""

    mean: float
    """Mean number of detectable drops on a ray without a surface."""
    log_low: float
    """ln of the mean number at the first entry."""
    entries_per_log: float
    """Entries for each unit of that logarithm; the last entry is `mean`."""
    log_power: np.ndarray
    """ln power [1/m2] above which that many drops lie, shape [`ENTRIES`], float64."""
    range: np.ndarray
    """Quantiles of the range of drops of that power [m], shape [`ENTRIES`, `LEVELS`], float64; levels (1 - cos(pi q /
    (LEVELS - 1))) / 2, which are dense at both ends, where the tails are."""


def overlap(range_m: np.ndarray, optics: LidarOptics) -> np.ndarray:
    """Return the share of the beam that the receiver sees at distances, 0 to 1."""
    width = optics.overlap_full_m - optics.overlap_start_m
    if width == 0.0:
        return (range_m >= optics.overlap_full_m).astype(float)
    return np.clip((range_m - optics.overlap_start_m) / width, 0.0, 1.0) ** optics.overlap_exponent


@functools.lru_cache(maxsize=64)
def rain_table(rain_mm_h: float, optics: LidarOptics, extinction_per_m: float, range_m: float) -> RainTable | None:
    """Return the drops that a LiDAR detects, None where there are none.

    A drop of diameter D at range r returns Q D^2 / (4 Db^2) exp(-2 extinction r) / r^2 from a beam of diameter Db =
    aperture + divergence r, evenly lit, if it lies in the part of the beam that the receiver sees; it returns nothing
    from the other. Drops are many and independent, so those above a power are Poisson distributed; their mean number is
    the integral of the drop-size distribution over the part of the beam that is seen.

    Args:
        rain_mm_h: Rain rate [mm/h].
        optics: The sensor.
        extinction_per_m: Of the whole weather [1/m].
        range_m: Farthest echo [m].

    Source: scattering cross section per solid angle Q D^2 / 16 of a drop against rho / pi of a Lambert target, as in
    LISA, arXiv 2107.07004.
    """
    if rain_mm_h <= 0.0:
        return None
    n0, slope = marshall_palmer(rain_mm_h)
    r = np.geomspace(optics.nearest_m, range_m, RANGES)
    beam = optics.aperture_m + optics.divergence * r
    volume = math.pi / 4.0 * beam**2 * np.gradient(r) * overlap(r, optics)
    mm_per_root_power = 2e3 * beam * r * np.exp(extinction_per_m * r) / math.sqrt(optics.drop_efficiency)
    power_max = (LARGEST_DROP_MM / mm_per_root_power.min()) ** 2
    if power_max <= optics.min_power:
        return None

    power = np.geomspace(optics.min_power, power_max, POWERS)
    drop_mm = np.clip(np.sqrt(power)[:, None] * mm_per_root_power, SMALLEST_DROP_MM, LARGEST_DROP_MM)
    mean = (n0 / slope * (np.exp(-slope * drop_mm) - math.exp(-slope * LARGEST_DROP_MM))) @ volume
    if mean[0] < FEWEST_DROPS:
        return None
    some = mean > 0.0
    log_mean = np.linspace(math.log(FEWEST_SHARE * mean[0]), math.log(mean[0]), ENTRIES)
    log_power = np.interp(log_mean, np.log(mean[some][::-1]), np.log(power[some][::-1]))

    drop_mm = np.exp(0.5 * log_power)[:, None] * mm_per_root_power
    inside = (drop_mm > SMALLEST_DROP_MM) & (drop_mm < LARGEST_DROP_MM)
    density = np.where(inside, drop_mm, 0.0) * np.exp(-slope * np.minimum(drop_mm, LARGEST_DROP_MM)) * volume
    share = np.cumsum(density, axis=1) - 0.5 * density
    share /= density.sum(axis=1, keepdims=True)
    level = np.clip(0.5 - 0.5 * np.cos(np.linspace(0.0, math.pi, LEVELS)), 1e-6, 1.0 - 1e-6)
    quantiles = np.array([np.interp(level, row, r) for row in share])
    return RainTable(float(mean[0]), log_mean[0], (ENTRIES - 1) / (log_mean[-1] - log_mean[0]), log_power, quantiles)


def fog_power(
    range_m: np.ndarray, extinction_per_m: float, backscatter: float, optics: LidarOptics, points: int = 512
) -> np.ndarray:
    """Return the mean power that fog returns at ranges as a LiDAR reports them [1/m2], shape of `range_m`.

    The pulse is a squared sine of half-power width tau, whose middle marks the range, so that a surface is reported
    where it is: pi beta Int cos^2(pi x / (2 L)) overlap(r - x) exp(-2 alpha (r - x)) / (r - x)^2 dx from -L to L, where
    L = c tau / 2. Range counts from the middle of the pulse, not from its first light, which adds L.

    Args:
        range_m: Distances [m], shape [N].
        extinction_per_m: alpha [1/m].
        backscatter: beta [1/m/sr].
        optics: The sensor.
        points: Of the integral, midpoint rule.

    Source: R. Rasshofer, M. Spies and H. Spies, Adv. Radio Sci. 9, 2011; M. Hahner et al., ICCV 2021.
    """
    length = 0.5 * SPEED_OF_LIGHT * optics.pulse_s
    if length == 0.0:
        return np.zeros(np.shape(range_m))
    x = ((np.arange(points) + 0.5) / points * 2.0 - 1.0) * length
    distance = np.asarray(range_m)[:, None] - x
    share = np.where(distance > 0.0, overlap(distance, optics), 0.0)
    scattered = share * np.exp(-2.0 * extinction_per_m * distance) / np.where(share > 0.0, distance, 1.0) ** 2
    return math.pi * backscatter * (scattered @ np.cos(math.pi * x / (2.0 * length)) ** 2) * (2.0 * length / points)


@functools.lru_cache(maxsize=64)
def fog_table(
    extinction_per_m: float, backscatter: float, optics: LidarOptics, range_m: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return ranges [m] and mean powers [1/m2] where fog can be detected, shapes [F]; None for nowhere.

    `FOG_SAMPLES` - 1 steps of range, equal in the logarithm, go from the nearest to the farthest range at which a patch
    and noise of up to `NOISE_LIMIT` standard deviations each lift the mean above the threshold; one more follows, in
    which the power is 0. Each holds `FOG_ENTRIES` equal distances; F is their product and 1. See `fog_power` for the
    arguments.
    """
    r = np.geomspace(optics.nearest_m, range_m, 2048)
    lifted = fog_power(r, extinction_per_m, backscatter, optics) * math.exp(
        NOISE_LIMIT * PATCHINESS - 0.5 * PATCHINESS**2
    )
    above = np.flatnonzero(lifted > optics.min_power * (1.0 - NOISE_LIMIT / optics.threshold_snr))
    if len(above) == 0:
        return None
    near, far = r[max(above[0] - 1, 0)], r[min(above[-1] + 1, len(r) - 1)]
    edges = near * (far / near) ** (np.arange(FOG_SAMPLES + 1) / (FOG_SAMPLES - 1))
    ranges = np.interp(np.arange(FOG_SAMPLES * FOG_ENTRIES + 1) / FOG_ENTRIES, np.arange(FOG_SAMPLES + 1), edges)
    power = fog_power(ranges, extinction_per_m, backscatter, optics)
    power[-FOG_ENTRIES:] = 0.0
    return ranges, power


def make_air(
    weather: Weather, optics: LidarOptics, range_m: float, device: str, patch_key: tuple[int, int] = (0, 0)
) -> Air:
    """Return a weather as the LiDAR kernels take it.

    Fog returns an echo below a visibility of 1 km; above it there is haze, whose particles scatter a third of that back
    and lie evenly, and which only attenuates here.

    Args:
        weather: Rain, visibility, fog type and wind.
        optics: The sensor.
        range_m: Farthest echo [m].
        device: Warp device name.
        patch_key: Stream of the fog's patches, of `mmw.core.random_keys.random_key`; the same for all sensors and
            frames of a scenario, which then see the same fog.

    Raises:
        InputError: If the range ends before the sensor's nearest echo.
    """
    if not range_m > optics.nearest_m:
        raise InputError(
            f"LiDAR: range {range_m:g} m and nearest echo {optics.nearest_m:g} m; a longer range is needed; correct one"
        )
    alpha = extinction(weather, optics.wavelength_nm)
    rain = rain_table(weather.rain_mm_h, optics, alpha, range_m)
    is_fog = weather.visibility_m < FOG_VISIBILITY_M
    fog = fog_table(alpha, fog_backscatter(weather, optics.wavelength_nm), optics, range_m) if is_fog else None
    return air_from_tables(alpha, optics, rain, fog, weather.wind, patch_key, device)


def air_from_tables(
    extinction_per_m: float,
    optics: LidarOptics,
    rain: RainTable | None,
    fog: tuple[np.ndarray, np.ndarray] | None,
    wind: tuple[float, float, float],
    patch_key: tuple[int, int],
    device: str,
) -> Air:
    """Return the kernels' struct of the tables of `rain_table` and `fog_table`; see `make_air`."""
    air = Air()
    air.extinction = extinction_per_m
    air.min_power = optics.min_power
    if rain is not None:
        air.drops = rain.mean
        air.drops_log_low = rain.log_low
        air.drops_entries_per_log = rain.entries_per_log
        air.drop_log_power = wp.array(rain.log_power.astype(np.float32), dtype=float, device=device)
        air.drop_range = wp.array(rain.range.astype(np.float32), dtype=float, device=device)
    if fog is not None:
        ranges, power = fog
        air.fog_from = ranges[0]
        air.fog_step = (ranges[-1] / ranges[0]) ** (1.0 / FOG_SAMPLES)
        air.fog_power = wp.array(power.astype(np.float32), dtype=float, device=device)
        air.fog_noise = optics.min_power / optics.threshold_snr
        air.fog_patchiness = PATCHINESS
        air.fog_patches_per_m = 1.0 / PATCH_M
        air.fog_patch = wp.empty((PATCHES,) * 3, dtype=wp.vec2, device=device)
        wp.launch(patches_kernel, air.fog_patch.shape, [wp.vec2ui(*patch_key)], [air.fog_patch], device=device)
        air.wind = wp.vec3(*wind)
    return air
