"""Slow drivers down in rain and fog: factors on desired speeds and time gaps."""

from typing import NamedTuple

from mmw.physics.weather.weather import Weather

LIGHT_RAIN_SPEED, HEAVY_RAIN_SPEED = 0.972, 0.925
"""Factors on the free speed in the lightest rain and at `HEAVY_RAIN_MM_H`: the middles of reductions of 2 to 3.6 % and
of 6 to 9 %. Source: H. Rakha et al., Inclement weather impacts on freeway traffic stream behavior, TRR 2071 (2008)."""

HEAVY_RAIN_MM_H = 16.0
"""Highest rate of rain in those measurements [mm/h]; beyond it the factor stays."""

FOG_SPEED = 0.98
"""Factor on the free speed in fog of less than `FOG_VISIBILITY_M`: the middle of 1 to 3 %. Source: H. Hablas, A study
of inclement weather impacts on freeway free-flow speed, Virginia Tech (2007), abstract."""

FOG_VISIBILITY_M = 1200.0
"""Visibility below which fog slows drivers [m]. Source: as `FOG_SPEED`."""

CAPACITY = ((0.0, 1.0), (2.54, 1.0 - 0.0201), (6.35, 1.0 - 0.0724), (float("inf"), 1.0 - 0.1413))
"""Rate of rain up to which it holds [mm/h], and factor on the capacity of a lane. Source: Highway Capacity Manual 2010,
exhibit 10-15; 0.1 and 0.25 in/h."""


class DriverFactors(NamedTuple):
    """Factors on what every driver wants."""

    speed: float = 1.0
    """On the desired speed."""
    headway: float = 1.0
    """On the time gap."""


def driver_factors(weather: Weather) -> DriverFactors:
    """Return how much slower and farther apart people drive in a weather than in the sun.

    The time gap of followers is the inverse of the capacity of a lane, so its factor is the inverse of that on the
    capacity. Fog leaves the time gap: the capacities of the manual in fog do not fall with the visibility.
    """
    rain = weather.rain_mm_h
    share = min(rain / HEAVY_RAIN_MM_H, 1.0)
    speed = LIGHT_RAIN_SPEED + share * (HEAVY_RAIN_SPEED - LIGHT_RAIN_SPEED) if rain > 0.0 else 1.0
    if weather.visibility_m < FOG_VISIBILITY_M:
        speed *= FOG_SPEED
    capacity = next(factor for limit, factor in CAPACITY if rain <= limit)
    return DriverFactors(speed, 1.0 / capacity)
