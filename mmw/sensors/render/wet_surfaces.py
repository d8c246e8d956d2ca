"""Make the water on the surfaces of a scene from the weather."""

import numpy as np

from mmw.kernels.shading import wet_surfaces as wet
from mmw.physics.weather.weather import Weather

ORIGIN_PERIOD_M = 4096.0
"""The origin of a scene far away is taken modulo this [m], so that float32 still resolves a puddle's rim."""


def make_wet(weather: Weather, origin: np.ndarray) -> wet.Wet:
    """Return what kernels need of the water on surfaces.

    Args:
        weather: The weather.
        origin: World position of the scene frame's origin [m], shape [3] (`Scene.origin`).
    """
    result = wet.Wet()
    result.wetness = weather.wetness
    result.puddles = weather.puddles
    result.rain_mm_h = weather.rain_mm_h
    result.origin = tuple(float(x) for x in np.fmod(origin, ORIGIN_PERIOD_M))
    return result
