"""Compute the attenuation of paths by rain, fog and air: Recommendations ITU-R P.838-3, P.840-9 and P.676-13.

Paths here are far shorter than a rain cell, so the specific attenuation is the same all along a path and no path
reduction factor is used; rain turns no polarization noticeably at these lengths. The air's phase delay (300 ppm of the
length) and dispersion are neglected.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.frequency_range import check_frequency_range
from mmw.physics.em.gas_attenuation import gas_attenuation
from mmw.physics.materials.extrapolation import AIR_MIN_HZ, CARRIERS_GHZ
from mmw.physics.weather.weather import Weather

RAIN_GHZ = (1.0, 1000.0)
"""Frequencies of P.838-3 [GHz]."""

FOG_GHZ = (1.0, 200.0)
"""Frequencies of P.840-9 here [GHz]: its droplets are small against the wave up to 200 GHz; 1 GHz is P.676's start."""

VERTICAL_TILT = np.pi / 2
"""Polarization tilt of a vertical antenna: angle of the field against the horizontal [rad]."""

_LOG_K_H = (
    (-5.33980, -0.35351, -0.23789, -0.94158), (-0.10008, 1.26970, 0.86036, 0.64552),
    (1.13098, 0.45400, 0.15354, 0.16817), -0.18961, 0.71147,
)  # fmt: skip
_LOG_K_V = (
    (-3.80595, -3.44965, -0.39902, 0.50167), (0.56934, -0.22911, 0.73042, 1.07319),
    (0.81061, 0.51059, 0.11899, 0.27195), -0.16398, 0.63297,
)  # fmt: skip
_ALPHA_H = (
    (-0.14318, 0.29591, 0.32177, -5.37610, 16.1721), (1.82442, 0.77564, 0.63773, -0.96230, -3.29980),
    (-0.55187, 0.19822, 0.13164, 1.47828, 3.43990), 0.67849, -1.95537,
)  # fmt: skip
_ALPHA_V = (
    (-0.07771, 0.56727, -0.20238, -48.2991, 48.5833), (2.33840, 0.95545, 1.14520, 0.791669, 0.791459),
    (-0.76284, 0.54039, 0.26809, 0.116226, 0.116479), -0.053739, 0.83433,
)  # fmt: skip
_Fit = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...], float, float]


def rain_coefficients(carrier_hz: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return k and alpha of horizontal, then k and alpha of vertical polarization, each of the shape of the carriers.

    Args:
        carrier_hz: Carrier frequencies, 1 to 1000 GHz [Hz].

    Returns:
        k_H, alpha_H, k_V, alpha_V: k R^alpha is in dB/km for a rain rate R in mm/h.

    Raises:
        InputError: If a carrier is outside 1 to 1000 GHz.

    Source: ITU-R P.838-3, equations 2 and 3, tables 1 to 4.
    """
    x = np.log10(check_frequency_range(carrier_hz, *RAIN_GHZ, "rain attenuation", "ITU-R P.838-3"))
    return 10.0 ** _fit(x, _LOG_K_H), _fit(x, _ALPHA_H), 10.0 ** _fit(x, _LOG_K_V), _fit(x, _ALPHA_V)


def _fit(x: np.ndarray, table: _Fit) -> np.ndarray:
    a, b, c = (np.array(column) for column in table[:3])
    slope, offset = table[3:]
    return (a * np.exp(-(((x[..., None] - b) / c) ** 2))).sum(axis=-1) + slope * x + offset


def rain_attenuation(
    rain_mm_h: ArrayLike, carrier_hz: ArrayLike, elevation: ArrayLike = 0.0, tilt: ArrayLike = VERTICAL_TILT
) -> np.ndarray:
    """Return the specific attenuation by rain [dB/km]; the arguments broadcast.

    Args:
        rain_mm_h: Rain rate [mm/h].
        carrier_hz: Carrier frequency, 1 to 1000 GHz [Hz].
        elevation: Angle of the path above the horizontal [rad]; its sign does not matter.
        tilt: Polarization tilt: 0 horizontal, pi/2 vertical, pi/4 circular [rad].

    Raises:
        InputError: If a carrier is outside 1 to 1000 GHz.

    Source: ITU-R P.838-3, equations 1, 4 and 5.
    """
    k_h, alpha_h, k_v, alpha_v = rain_coefficients(carrier_hz)
    mix = np.cos(elevation) ** 2 * np.cos(2.0 * np.asarray(tilt))
    k = (k_h + k_v + (k_h - k_v) * mix) / 2.0
    alpha = (k_h * alpha_h + k_v * alpha_v + (k_h * alpha_h - k_v * alpha_v) * mix) / (2.0 * k)
    return k * np.asarray(rain_mm_h, dtype=np.float64) ** alpha


def fog_attenuation(lwc_g_m3: ArrayLike, carrier_hz: ArrayLike, temperature_c: ArrayLike) -> np.ndarray:
    """Return the specific attenuation by fog or cloud droplets [dB/km]; the arguments broadcast.

    Args:
        lwc_g_m3: Liquid water content [g/m3].
        carrier_hz: Carrier frequency, 1 to 200 GHz [Hz].
        temperature_c: Temperature of the droplets [C].

    Raises:
        InputError: If a carrier is outside 1 to 200 GHz.

    Source: ITU-R P.840-9, section 2 (the same coefficient since P.840-6).
    """
    f = check_frequency_range(carrier_hz, *FOG_GHZ, "fog attenuation", "ITU-R P.840-9")
    theta = 300.0 / (np.asarray(temperature_c, dtype=np.float64) + 273.15) - 1.0
    static, infinite = 77.66 + 103.3 * theta, 3.52
    middle = 0.0671 * static
    f1 = 20.20 - 146.0 * theta + 316.0 * theta**2
    f2 = 39.8 * f1
    first, second = (static - middle) / (1.0 + (f / f1) ** 2), (middle - infinite) / (1.0 + (f / f2) ** 2)
    real, loss = first + second + infinite, f / f1 * first + f / f2 * second
    eta = (2.0 + real) / loss
    return np.asarray(lwc_g_m3) * 0.819 * f / (loss * (1.0 + eta**2))


def path_loss_db(
    weather: Weather,
    carriers_hz: ArrayLike,
    length_m: np.ndarray,
    elevation: ArrayLike,
    tilt: ArrayLike = VERTICAL_TILT,
) -> dict[str, np.ndarray]:
    """Return the one-way losses of each path in rain, fog and air.

    Rain depends a little on how steep a path runs (9 % between horizontal and vertical at 28 GHz, 25 mm/h). The
    elevation of departure is used for the whole path. From 0.5 to 1 GHz the losses are those of 1 GHz, where the three
    Recommendations begin: less than 0.01 dB/km.

    Args:
        weather: The weather.
        carriers_hz: Carrier frequencies [Hz], shape [C].
        length_m: Whole length of each path [m], shape [P].
        elevation: Elevation of departure [rad], one or shape [P]: pi/2 minus the zenith angle.
        tilt: Polarization tilt of the antennas against the horizontal [rad], one or shape [P]: pi/2 for V, 0 for H.

    Returns:
        `rain_db`, `fog_db` and `gas_db` [dB], shape [P, C] each, at least 0; the field gets 10^(-dB / 20). No rain or
        no fog is 0 at any carrier.

    Raises:
        InputError: If a carrier is outside 0.5 to 1000 GHz, or above 200 GHz in fog.
    """
    given = carriers_hz if isinstance(carriers_hz, tuple) else tuple(np.atleast_1d(np.asarray(carriers_hz)).tolist())
    carriers, rain, fog, gas = _same_everywhere(weather, given)
    km = np.asarray(length_m, dtype=np.float64)[:, None] / 1000.0
    if weather.rain_mm_h > 0.0:
        rain = rain_attenuation(
            weather.rain_mm_h, carriers, *(np.reshape(angle, (-1, 1)) for angle in (elevation, tilt))
        )
    return {"rain_db": rain * km, "fog_db": fog * km, "gas_db": gas * km}


@lru_cache(maxsize=256)
def _same_everywhere(weather: Weather, carriers_hz: tuple[float, ...]) -> tuple[np.ndarray, ...]:
    """Return the carriers that the Recommendations are asked for [Hz], and the attenuation at each by no rain, fog, and
    air and vapor [dB/km], shape [C]: for the latter 80 lines that do not change from call to call."""
    carriers = np.array(carriers_hz, dtype=np.float64)
    carriers = np.where((carriers >= CARRIERS_GHZ[0] * 1e9) & (carriers < AIR_MIN_HZ), AIR_MIN_HZ, carriers)
    none = fog = np.zeros(carriers.shape)
    if weather.liquid_water_g_m3 > 0.0:
        fog = fog_attenuation(weather.liquid_water_g_m3, carriers, weather.temperature_c)
    air = weather.dry_pressure_hpa, weather.temperature_c, weather.water_vapour_g_m3
    dry_air, vapour = gas_attenuation(carriers, *air)
    return carriers, none, fog, dry_air + vapour
