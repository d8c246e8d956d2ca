"""`vary`: what is drawn by `seed`, so that datasets of several seeds show other drives at other places."""

import zlib
from difflib import get_close_matches

import numpy as np
from pydantic import Field, field_validator

from mmw.config.air import AirConfig
from mmw.config.section import Name, Section
from mmw.core.errors import InputError
from mmw.physics.weather.weather import LIMITS

Range = tuple[float, float]
"""Lowest and highest value."""


class VarySpawnConfig(Section):
    """Start positions drawn by seed, instead of the spawn points nearest to `spawn_center_m`."""

    radius_m: float = Field(
        default=150.0,
        ge=20,
        le=5000,
        description="vehicles start at any spawn points within this distance of `spawn_center_m`, and any of them, or "
        "of the nearest `cav_pool`, become CAVs [m]",
    )


class VaryRsuConfig(Section):
    """Places of roadside units drawn by seed, beside the road and with a free view of it."""

    radius_m: float = Field(
        default=50.0,
        ge=5,
        le=1000,
        description="a unit stands at its `position_m`, or beside a road within this distance of it [m]",
    )


class VaryConfig(Section):
    """Draws of each seed; what has no key here is the same in all seeds."""

    spawn: VarySpawnConfig | None = Field(
        default=None, description="start positions, and which vehicles are CAVs; engines idm and sumo (section)"
    )
    rsu: VaryRsuConfig | None = Field(default=None, description="places and headings of roadside units (section)")
    weather: dict[Name, dict[str, Range]] = Field(
        default_factory=dict,
        description="weather -> key of `air` -> lowest and highest value, from which one is drawn for each seed (map)",
    )

    @field_validator("weather")
    @classmethod
    def _known_ranges(cls, value: dict[str, dict[str, Range]]) -> dict[str, dict[str, Range]]:
        for name, ranges in value.items():
            for key, (low, high) in ranges.items():
                if key not in LIMITS:
                    near = get_close_matches(key, LIMITS, n=1)
                    cure = f"did you mean `{near[0]}`?" if near else f"keys are {', '.join(LIMITS)}"
                    raise InputError(f"{name}.{key}: unknown key; {cure}")
                least, most = LIMITS[key]
                if not least <= low <= high <= most:
                    raise InputError(
                        f"{name}.{key} = {[low, high]}: two values from {least:g} to {most:g} are needed, the lower "
                        "one first"
                    )
        return value


def draw_air(air: dict[str, AirConfig], vary: VaryConfig, weathers: tuple[str, ...], seed: int) -> dict[str, AirConfig]:
    """Return weathers with the values that `vary.weather` draws for a seed, uniformly, to four digits.

    Each value depends on the seed, the weather and the key alone.

    Raises:
        InputError: If it names a weather that is not configured.
    """
    drawn = dict(air)
    for name, ranges in vary.weather.items():
        if name not in weathers:
            raise InputError(
                f"vary.weather names {name!r}, and weathers = {list(weathers)}; add it there, or remove it"
            )
        values = {}
        for key, (low, high) in ranges.items():
            generator = np.random.Generator(np.random.PCG64([seed, zlib.crc32(f"{name}.{key}".encode())]))
            values[key] = min(max(float(f"{generator.uniform(low, high):.4g}"), low), high)
        drawn[name] = air.get(name, AirConfig()).model_copy(update=values)
    return drawn
