"""`air.<name>.carla`: a weather in CARLA's terms, as its 14 parameters or the name of one of its presets."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator

from mmw.config.section import Section
from mmw.physics.weather.carla import carla_preset, check_parameter

CarlaPresetName = Literal[
    "Default", "ClearNoon", "CloudyNoon", "WetNoon", "WetCloudyNoon", "MidRainyNoon", "HardRainNoon", "SoftRainNoon",
    "ClearSunset", "CloudySunset", "WetSunset", "WetCloudySunset", "MidRainSunset", "HardRainSunset", "SoftRainSunset",
    "ClearNight", "CloudyNight", "WetNight", "WetCloudyNight", "SoftRainNight", "MidRainyNight", "HardRainNight",
    "DustStorm",
]  # fmt: skip


class CarlaWeatherConfig(Section):
    """CARLA's weather parameters. What is left out, or -1, changes nothing; see `mmw.physics.weather.carla` for the
    mapping."""

    cloudiness: float | None = Field(default=None, description="cover of clouds, 0 to 100 [%]")
    precipitation: float | None = Field(default=None, description="rain, 0 to 100 [%]")
    precipitation_deposits: float | None = Field(default=None, description="puddles, 0 to 100 [%]")
    wind_intensity: float | None = Field(default=None, description="wind, 0 to 100 [%]")
    sun_azimuth_angle: float | None = Field(
        default=None, description="sun's direction, clockwise from north, 0 to 360 [deg]"
    )
    sun_altitude_angle: float | None = Field(default=None, description="sun's height, -90 to 90; -1 is unset [deg]")
    fog_density: float | None = Field(default=None, description="fog, 0 to 100 [%]")
    fog_distance: float | None = Field(default=None, description="distance at which fog begins, for pictures only [m]")
    fog_falloff: float | None = Field(
        default=None, description="fall-off of the fog with height, for pictures only [-]"
    )
    wetness: float | None = Field(default=None, description="wetness of the ground, 0 to 100 [%]")
    scattering_intensity: float | None = Field(
        default=None, description="light that fog scatters, for pictures only [-]"
    )
    mie_scattering_scale: float | None = Field(default=None, description="haze of the sky, for pictures only [-]")
    rayleigh_scattering_scale: float | None = Field(default=None, description="blue of the sky, for pictures only [-]")
    dust_storm: float | None = Field(default=None, description="dust in the air, 0 to 100 [%]")

    @field_validator("*")
    @classmethod
    def _in_range(cls, value: float | None, info: ValidationInfo) -> float | None:
        if value is not None:
            check_parameter(str(info.field_name), value)
        return value


def _named(value: Any) -> Any:
    return CarlaWeatherConfig.model_validate(carla_preset(value)) if isinstance(value, str) else value


CarlaWeather = Annotated[
    CarlaWeatherConfig | None,
    BeforeValidator(_named, json_schema_input_type=CarlaPresetName | CarlaWeatherConfig | None),
]
"""The section, which a file may give as the name of one of CARLA's presets."""
