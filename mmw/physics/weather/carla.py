"""Map CARLA's weather parameters and presets to physical values.

CARLA publishes no formula from its parameters to physical quantities: they steer the look of its RGB camera and nothing
else. The mapping here is our convention (design); docstrings name what it rests on.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

from mmw.core.errors import InputError
from mmw.physics.weather.weather import Weather

RANGES: dict[str, tuple[float, float]] = {
    "cloudiness": (0.0, 100.0),
    "precipitation": (0.0, 100.0),
    "precipitation_deposits": (0.0, 100.0),
    "wind_intensity": (0.0, 100.0),
    "sun_azimuth_angle": (0.0, 360.0),
    "sun_altitude_angle": (-90.0, 90.0),
    "fog_density": (0.0, 100.0),
    "fog_distance": (0.0, 10_000.0),
    "fog_falloff": (0.0, 100.0),
    "wetness": (0.0, 100.0),
    "scattering_intensity": (0.0, 100.0),
    "mie_scattering_scale": (0.0, 100.0),
    "rayleigh_scattering_scale": (0.0, 100.0),
    "dust_storm": (0.0, 100.0),
}
"""CARLA's 14 parameters, in the order of its constructor, and their smallest and largest value: percent, the two sun
angles in degrees, `fog_distance` in meters, the rest without unit. CARLA documents no upper end of `fog_distance`,
`fog_falloff` and the three scatterings; theirs is a design value. Source: CARLA, PythonAPI/docs/weather.yml."""

UNSET = -1.0
"""Value of a parameter that CARLA's presets leave to the map, the sun's azimuth in all of them."""

_SKY = (1.0, 0.03, 0.0331)
_ROWS: dict[str, tuple[float, ...]] = {
    "Default": (-1, -1, -1, -1, -1, -1, -1, -1, -1, -1, *_SKY, 0),
    "ClearNoon": (5, 0, 0, 10, -1, 45, 2, 0.75, 0.1, 0, *_SKY, 0),
    "CloudyNoon": (60, 0, 0, 10, -1, 45, 3, 0.75, 0.1, 0, *_SKY, 0),
    "WetNoon": (5, 0, 50, 10, -1, 45, 3, 0.75, 0.1, 0, *_SKY, 0),
    "WetCloudyNoon": (60, 0, 50, 10, -1, 45, 3, 0.75, 0.1, 0, *_SKY, 0),
    "MidRainyNoon": (60, 60, 60, 60, -1, 45, 3, 0.75, 0.1, 0, *_SKY, 0),
    "HardRainNoon": (100, 100, 90, 100, -1, 45, 7, 0.75, 0.1, 0, *_SKY, 0),
    "SoftRainNoon": (20, 30, 50, 30, -1, 45, 3, 0.75, 0.1, 0, *_SKY, 0),
    "ClearSunset": (5, 0, 0, 10, -1, 15, 2, 0.75, 0.1, 0, *_SKY, 0),
    "CloudySunset": (60, 0, 0, 10, -1, 15, 3, 0.75, 0.1, 0, *_SKY, 0),
    "WetSunset": (5, 0, 50, 10, -1, 15, 2, 0.75, 0.1, 0, *_SKY, 0),
    "WetCloudySunset": (60, 0, 50, 10, -1, 15, 2, 0.75, 0.1, 0, *_SKY, 0),
    "MidRainSunset": (60, 60, 60, 60, -1, 15, 3, 0.75, 0.1, 0, *_SKY, 0),
    "HardRainSunset": (100, 100, 90, 100, -1, 15, 7, 0.75, 0.1, 0, *_SKY, 0),
    "SoftRainSunset": (20, 30, 50, 30, -1, 15, 2, 0.75, 0.1, 0, *_SKY, 0),
    "ClearNight": (5, 0, 0, 10, -1, -90, 60, 75, 1, 0, *_SKY, 0),
    "CloudyNight": (60, 0, 0, 10, -1, -90, 60, 0.75, 0.1, 0, *_SKY, 0),
    "WetNight": (5, 0, 50, 10, -1, -90, 60, 75, 1, 60, *_SKY, 0),
    "WetCloudyNight": (60, 0, 50, 10, -1, -90, 60, 0.75, 0.1, 60, *_SKY, 0),
    "SoftRainNight": (60, 30, 50, 30, -1, -90, 60, 0.75, 0.1, 60, *_SKY, 0),
    "MidRainyNight": (80, 60, 60, 60, -1, -90, 60, 0.75, 0.1, 80, *_SKY, 0),
    "HardRainNight": (100, 100, 90, 100, -1, -90, 100, 0.75, 0.1, 100, *_SKY, 0),
    "DustStorm": (100, 0, 0, 100, -1, 45, 2, 0.75, 0.1, 0, *_SKY, 100),
}
CARLA_PRESETS: dict[str, dict[str, float]] = {
    name: dict(zip(RANGES, map(float, row), strict=True)) for name, row in _ROWS.items()
}
"""CARLA's presets by name. Their rain does not wet the road: noon and sunset have wetness 0 even in hard rain, and they
stay so here. Source: CARLA's LibCarla/source/carla/rpc/WeatherParameters.cpp of 2024 (facts, MIT); other releases have
other numbers."""


def carla_preset(name: str) -> dict[str, float]:
    """Return the 14 parameters of one of CARLA's presets.

    Raises:
        InputError: If CARLA has no such preset.
    """
    if name not in CARLA_PRESETS:
        raise InputError(f"is no preset of CARLA's; it has {', '.join(CARLA_PRESETS)}; name one of them")
    return CARLA_PRESETS[name]


def check_parameter(name: str, value: float) -> None:
    """Check one parameter of CARLA's.

    Raises:
        InputError: If it is neither within its range nor -1, CARLA's unset.
    """
    low, high = RANGES[name]
    if not (low <= value <= high or value == UNSET):
        raise InputError(f"{low:g} to {high:g}, or -1 for unset, is needed; correct it")


def rain_rate(precipitation: float) -> float:
    """Return the rain rate [mm/h] of a precipitation of 0 to 100: 0 for 0, else 10^(precipitation / 50).

    Design: CARLA's soft (30), mid (60) and hard (100) rain become 4, 16 and 100 mm/h: moderate, heavy and violent rain
    in WMO's terms.
    """
    return 10.0 ** (precipitation / 50.0) if precipitation > 0.0 else 0.0


def fog_visibility(fog_density: float) -> float:
    """Return the meteorological optical range [m] of a fog density of 0 to 100: 10 km (30 m / 10 km)^(density / 100).

    Without fog (0) it is the clear air of `Weather`. Design: even steps of density are even ratios of visibility; the 2
    to 7 of CARLA's presets by day stay haze, 100 is a fog of 30 m.
    """
    return 1e4 * (30.0 / 1e4) ** (fog_density / 100.0) if fog_density > 0.0 else Weather.visibility_m


def dust_visibility(dust_storm: float) -> float:
    """Return the meteorological optical range [m] in dust alone: 500 m x 100 / dust_storm; inf without dust.

    Design: extinction grows as the amount of dust. A dust storm is dust that lowers the visibility below 1 km, a strong
    one below 500 m. Source of these limits: WMO International Cloud Atlas; China's GB/T 20480-2017.
    """
    return 500.0 * 100.0 / dust_storm if dust_storm > 0.0 else math.inf


def fog_decay(fog_falloff: float) -> float:
    """Return the decay of the fog's density with height [1/m] of a falloff: ln(2) x falloff / 10.

    The falloff is that of Unreal's exponential height fog, where density halves every 1000 / falloff centimeters: 10 m
    for CARLA's 1 ("reaches normal-sized buildings"), 2 m for its 5 (ground fog). Source: Unreal Engine 4, its fog
    component's conversion and documentation.
    """
    return math.log(2.0) * fog_falloff / 10.0


def from_carla(parameters: Mapping[str, float], base: Weather) -> Weather:
    """Return a weather with the physical values of CARLA's parameters.

    The sun's azimuth counts clockwise from north. CARLA calls its zero "an arbitrary North", and its compass has north
    at -y, which is our +y. Dust is dry: it lowers the visibility and not the liquid water.

    Args:
        parameters: Names of `RANGES` -> value; others, and those that are -1, are those of `base`.
        base: What gives everything else: air, fog type, wind direction.

    Raises:
        InputError: If a value is out of its range.
    """
    given = {name: value for name, value in parameters.items() if value != UNSET}
    for name, value in given.items():
        try:
            check_parameter(name, value)
        except InputError as error:
            raise InputError(f"carla.{name} = {value:g}: {error}") from None
    values = {key: mapped(given[name]) for name, (key, mapped) in _MAPPING.items() if name in given}
    weather = replace(base, **values)
    dust = dust_visibility(given.get("dust_storm", 0.0))
    if dust < math.inf:
        visibility = 1.0 / (1.0 / weather.visibility_m + 1.0 / dust)
        weather = replace(weather, visibility_m=visibility, lwc_g_m3=weather.liquid_water_g_m3)
    return weather


def _fraction(percent: float) -> float:
    return percent / 100.0


_MAPPING = {
    "cloudiness": ("cloudiness", _fraction),
    "precipitation": ("rain_mm_h", rain_rate),
    "precipitation_deposits": ("puddles", _fraction),
    "wind_intensity": ("wind_m_s", lambda intensity: 0.2 * intensity),
    "sun_azimuth_angle": ("sun_azimuth_deg", float),
    "sun_altitude_angle": ("sun_altitude_deg", float),
    "fog_density": ("visibility_m", fog_visibility),
    "fog_distance": ("fog_start_m", float),
    "fog_falloff": ("fog_falloff_per_m", fog_decay),
    "wetness": ("wetness", _fraction),
    "scattering_intensity": ("scattering_intensity", float),
    "mie_scattering_scale": ("mie_scattering_scale", float),
    "rayleigh_scattering_scale": ("rayleigh_scattering_scale", float),
}
"""CARLA's parameter -> the key of `Weather` that it sets, and how. Dust, the 14th, is in `from_carla`. The wind of
20 m/s at 100 is a gale (Beaufort 8): design."""
