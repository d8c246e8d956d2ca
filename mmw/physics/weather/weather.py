"""Describe the weather by physical values, from which every sensor derives its own."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

from mmw.core.errors import InputError

FogType = Literal["strong_advection", "moderate_advection", "strong_spray", "radiation", "chu_hogg"]

FOG_WATER_G_M2: dict[str, float] = {
    "strong_advection": 38.80,
    "moderate_advection": 30.90,
    "strong_spray": 11.26,
    "radiation": 5.427,
    "chu_hogg": 12.83,
}
"""Liquid water content [g/m3] times meteorological optical range [m], by fog type: for one drop-size distribution both
scale with the number of drops. From Mie theory at 550 nm with n = 1.333, contrast threshold 5 %.

Source: modified gamma distributions of Rasshofer, Spies and Spies, Adv. Radio Sci. 9, 2011 (`radiation` is its moderate
spray); Chu and Hogg, Bell Syst. Tech. J. 47, 1968."""

FOG_VISIBILITY_M = 1_000.0
"""Fog is what lowers the visibility below this [m]; clearer air holds haze, which is no liquid water. Source: WMO."""

LIMITS = {
    "rain_mm_h": (0.0, 250.0),
    "visibility_m": (10.0, 100_000.0),
    "lwc_g_m3": (0.0, 10.0),
    "temperature_c": (-20.0, 50.0),
    "pressure_hpa": (300.0, 1100.0),
    "relative_humidity": (0.0, 1.0),
    "wetness": (0.0, 1.0),
    "puddles": (0.0, 1.0),
    "wind_m_s": (0.0, 60.0),
    "wind_from_deg": (0.0, 360.0),
    "cloudiness": (0.0, 1.0),
    "sun_altitude_deg": (-90.0, 90.0),
    "sun_azimuth_deg": (0.0, 360.0),
    "fog_start_m": (0.0, 10_000.0),
    "fog_falloff_per_m": (0.0, 10.0),
    "scattering_intensity": (0.0, 100.0),
    "mie_scattering_scale": (0.0, 100.0),
    "rayleigh_scattering_scale": (0.0, 100.0),
}
"""Smallest and largest value of each number of a `Weather`, in its unit."""

WET_GROUND = 0.25
"""Wetness, or share of puddles, from which the ground counts as wet [-]: half of the wetness in fog. Design value."""


@dataclass(frozen=True)
class Weather:
    """One weather, the same everywhere and in all frames of a scenario. The defaults are clear air.

    Examples:
        >>> import mmw
        >>> scene = mmw.load_scene("town03", weather=mmw.Weather(rain_mm_h=12.5, temperature_c=8.0, wetness=1.0))
        >>> scene.weathers["custom"].rain_mm_h
        12.5
    """

    rain_mm_h: float = 0.0
    """Rain rate [mm/h]."""
    visibility_m: float = 20_000.0
    """Meteorological optical range (5 % contrast) in fog or haze, without rain [m]."""
    fog_type: FogType = "moderate_advection"
    """Drop-size distribution of the fog; it decides how much water a visibility means."""
    lwc_g_m3: float | None = None
    """Liquid water content of the fog [g/m3]; None derives it from visibility and fog type."""
    temperature_c: float = 15.0
    """Temperature of air and drops [C]."""
    pressure_hpa: float = 1013.25
    """Air pressure, water vapor included [hPa]."""
    relative_humidity: float = 0.58
    """Water vapor over that of saturated air, 0 to 1 [-]; 0.58 at 15 C is the 7.5 g/m3 of ITU's standard air."""

    wetness: float = 0.0
    """Water in the pores of the ground and of walls, 0 dry to 1 soaked [-]."""
    puddles: float = 0.0
    """Share of level ground under standing water, 0 to 1 [-]."""
    wind_m_s: float = 2.0
    """Wind speed [m/s]."""
    wind_from_deg: float = 270.0
    """Direction from which the wind comes, clockwise from north [deg]: 270 is a west wind."""
    cloudiness: float = 0.1
    """Share of the sky under clouds, 0 to 1 [-]."""
    sun_altitude_deg: float = 65.0
    """Height of the sun above the horizon [deg]."""
    sun_azimuth_deg: float = 180.0
    """Direction of the sun, clockwise from north [deg]."""
    fog_start_m: float = 0.0
    """Distance from a camera at which fog begins [m]: a look of CARLA's, for pictures only."""
    fog_falloff_per_m: float = 0.0
    """Decay of the fog's density with height [1/m], 0 for none: a look of CARLA's, for pictures only."""
    scattering_intensity: float = 1.0
    """Light that fog scatters toward a camera, over the natural one [-]: a look of CARLA's, for pictures only."""
    mie_scattering_scale: float = 0.03
    """CARLA's haze of the sky [-], with its default; for pictures only."""
    rayleigh_scattering_scale: float = 0.0331
    """CARLA's blue of the sky [-], with its default; for pictures only."""

    variant: str | None = None
    """Variant of the stage's materials; None selects it by `variants`."""

    def __post_init__(self) -> None:
        for name, (low, high) in LIMITS.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise InputError(f"weather: {name} = {value:g}; {low:g} to {high:g} is needed; correct it")
        if self.fog_type not in FOG_WATER_G_M2:
            raise InputError(
                f"weather: fog_type = {self.fog_type!r}; one of {', '.join(FOG_WATER_G_M2)} is needed; choose one"
            )

    def variants(self, name: str) -> tuple[str, ...]:
        """Return the variants of a stage's materials that can stand for this weather, the best first.

        It is `variant` alone if that is given. Else it is the weather's own name, and then, on dry ground, `sunny`; on
        wet ground `rainy` and `foggy`, in this order in rain and in the other without rain.

        Args:
            name: Its name in `weathers`.
        """
        if self.variant is not None:
            return (self.variant,)
        if not self.has_wet_ground:
            return (name, "sunny")
        return (name, "rainy", "foggy") if self.rain_mm_h > 0.0 else (name, "foggy", "rainy")

    @property
    def has_wet_ground(self) -> bool:
        """True if the ground is wet or under puddles, so that its materials are the wet ones."""
        return max(self.wetness, self.puddles) >= WET_GROUND

    @property
    def liquid_water_g_m3(self) -> float:
        """Liquid water content of the fog [g/m3]; 0 without fog."""
        if self.lwc_g_m3 is not None:
            return self.lwc_g_m3
        return FOG_WATER_G_M2[self.fog_type] / self.visibility_m if self.visibility_m < FOG_VISIBILITY_M else 0.0

    @property
    def wind(self) -> tuple[float, float, float]:
        """Velocity of the air, world frame [m/s]: where it blows to, x east, y north, z up."""
        angle = math.radians(self.wind_from_deg)
        return -self.wind_m_s * math.sin(angle), -self.wind_m_s * math.cos(angle), 0.0

    @property
    def vapour_pressure_hpa(self) -> float:
        """Partial pressure of the water vapor [hPa].

        Source: ITU-R P.453-14, section 1 (saturation over liquid water, after Buck).
        """
        t = self.temperature_c
        enhancement = 1.0 + 1e-4 * (7.2 + self.pressure_hpa * (0.0320 + 5.9e-6 * t**2))
        saturated = enhancement * 6.1121 * math.exp((18.678 - t / 234.5) * t / (t + 257.14))
        return self.relative_humidity * saturated

    @property
    def water_vapour_g_m3(self) -> float:
        """Water vapor density [g/m3]. Source: ITU-R P.676-13, equation 4."""
        return 216.7 * self.vapour_pressure_hpa / (self.temperature_c + 273.15)

    @property
    def dry_pressure_hpa(self) -> float:
        """Pressure of the air without its water vapor [hPa]."""
        return self.pressure_hpa - self.vapour_pressure_hpa


def choose_variant(variants: Sequence[str], known: Collection[str]) -> str | None:
    """Return the first of the variants that a stage has; None if it has none of them.

    Args:
        variants: Candidates, the best first; see `Weather.variants`.
        known: Names of the stage's variants.
    """
    return next((variant for variant in variants if variant in known), None)


def _rain(rain_mm_h: float) -> Weather:
    return Weather(
        rain_mm_h, temperature_c=10.0, relative_humidity=1.0, wetness=1.0, puddles=0.2, wind_m_s=5.0, cloudiness=1.0
    )


def _fog(visibility_m: float) -> Weather:
    return Weather(
        visibility_m=visibility_m, temperature_c=10.0, relative_humidity=1.0, wetness=0.5, wind_m_s=1.0, cloudiness=1.0
    )


PRESETS: dict[str, Weather] = {
    "sunny": Weather(),
    "light_rain": _rain(5.0),
    "rainy": _rain(25.0),
    "heavy_rain": _rain(50.0),
    "light_fog": _fog(200.0),
    "foggy": _fog(75.0),
    "heavy_fog": _fog(50.0),
}
"""Weather name -> values. Rain and fog come with saturated air of 10 C and an overcast sky. Design values; 25 mm/h is a
heavy shower (WMO: 10 to 50 mm/h)."""
