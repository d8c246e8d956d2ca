"""`air`: the physical values behind the names of `weathers`."""

from dataclasses import asdict, replace
from typing import Any, Literal

from pydantic import Field

from mmw.config.carla_weather import CarlaWeather
from mmw.config.section import Section
from mmw.core.errors import InputError
from mmw.physics.weather.carla import from_carla
from mmw.physics.weather.weather import LIMITS, PRESETS, FogType, Weather

PresetName = Literal["sunny", "light_rain", "rainy", "heavy_rain", "light_fog", "foggy", "heavy_fog"]


def _value(name: str, description: str) -> Any:
    low, high = LIMITS[name]
    return Field(default=None, ge=low, le=high, description=description)


class AirConfig(Section):
    """One weather. Missing values come from `preset`, else from the preset of the same name, else from clear air.

    Parameters of `carla` replace values of the preset, and every other key replaces both.
    """

    preset: PresetName | None = Field(default=None, description="preset that fills in what is left out (name)")
    carla: CarlaWeather = Field(
        default=None, description="CARLA's weather parameters, or the name of one of its presets (section or name)"
    )
    variant: str | None = Field(
        default=None,
        min_length=1,
        description="variant of the stage's materials; left out, it is the one of the weather's own name, else one "
        "for wet or dry ground (name)",
    )
    rain_mm_h: float | None = _value("rain_mm_h", description="rain rate [mm/h]")
    visibility_m: float | None = _value(
        "visibility_m", description="meteorological optical range that fog or haze leaves, without the rain's share [m]"
    )
    fog_type: FogType | None = Field(
        default=None, description="drop sizes of the fog: the water that a visibility means (name)"
    )
    lwc_g_m3: float | None = _value(
        "lwc_g_m3",
        description="liquid water content of the fog; left out, it follows from visibility and fog type [g/m3]",
    )
    temperature_c: float | None = _value("temperature_c", description="temperature of air and drops [C]")
    pressure_hpa: float | None = _value("pressure_hpa", description="air pressure [hPa]")
    relative_humidity: float | None = _value(
        "relative_humidity", description="water vapor over that of saturated air, 0 to 1 [-]"
    )

    wetness: float | None = _value(
        "wetness", description="water in the pores of ground and walls, 0 dry to 1 soaked [-]"
    )
    puddles: float | None = _value("puddles", description="share of level ground under standing water, 0 to 1 [-]")
    wind_m_s: float | None = _value("wind_m_s", description="wind speed [m/s]")
    wind_from_deg: float | None = _value(
        "wind_from_deg", description="where the wind comes from, clockwise from north [deg]"
    )
    cloudiness: float | None = _value("cloudiness", description="share of the sky under clouds, 0 to 1 [-]")
    sun_altitude_deg: float | None = _value("sun_altitude_deg", description="height of the sun above the horizon [deg]")
    sun_azimuth_deg: float | None = _value(
        "sun_azimuth_deg", description="direction of the sun, clockwise from north [deg]"
    )
    fog_start_m: float | None = _value(
        "fog_start_m", description="distance from a camera at which fog begins, for pictures only [m]"
    )
    fog_falloff_per_m: float | None = _value(
        "fog_falloff_per_m", description="decay of the fog with height above the ground, for pictures only [1/m]"
    )
    scattering_intensity: float | None = _value(
        "scattering_intensity", description="light that fog scatters, for pictures only [-]"
    )
    mie_scattering_scale: float | None = _value(
        "mie_scattering_scale", description="haze of the sky, for pictures only [-]"
    )
    rayleigh_scattering_scale: float | None = _value(
        "rayleigh_scattering_scale", description="blue of the sky, for pictures only [-]"
    )

    def weather(self, name: str) -> Weather:
        """Return the physical values of this weather."""
        base = PRESETS[self.preset] if self.preset else PRESETS.get(name, Weather())
        given = self.model_dump(exclude={"preset", "carla"}, exclude_none=True)
        if self.carla is not None:
            start = replace(base, fog_type=self.fog_type or base.fog_type)
            mapped = from_carla(self.carla.model_dump(exclude_none=True), start)
            # A given visibility is fog or haze again, not CARLA's dust, and its water follows from it.
            base = mapped if self.visibility_m is None else replace(mapped, lwc_g_m3=base.lwc_g_m3)
        return replace(base, **given)


def resolve_air(air: dict[str, AirConfig], weathers: tuple[str, ...]) -> dict[str, AirConfig]:
    """Return all values of the configured weathers, so that a dataset documents its weather; drop other presets.

    Raises:
        InputError: If a weather is neither in the section nor a preset, or the section describes one that is neither
            configured nor a preset.
    """
    for name in weathers:
        if name not in air and name not in PRESETS:
            raise InputError(
                f"weathers holds {name!r}, of which nothing is known; presets are {', '.join(PRESETS)}; use one of "
                f"them, or describe it here, for example {{{name}: {{rain_mm_h: 10}}}}"
            )
    for name in air:
        if name not in weathers and name not in PRESETS:
            raise InputError(f"{name!r} is described, but weathers = {list(weathers)}; add it there, or remove it here")
    return {name: AirConfig.model_validate(asdict(air.get(name, AirConfig()).weather(name))) for name in weathers}
