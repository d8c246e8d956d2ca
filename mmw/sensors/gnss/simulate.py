"""Simulate GNSS receivers by the mode that is configured."""

from mmw.sensors.gnss.config import Gnss
from mmw.sensors.gnss.error_models import GnssSample, make_gnss
from mmw.sensors.gnss.ray_traced import make_ray_traced
from mmw.sensors.sensor_input import SensorInput


def simulate(data: SensorInput, config: Gnss) -> dict[str, GnssSample]:
    """Return the samples of all views by weather; they differ between weathers in mode `ray_traced` alone.

    Raises:
        InputError: If satellites are traced and an antenna is inside an object, or a material is not known at L1.
    """
    if config.mode == "ray_traced":
        return {**make_ray_traced(data, config)}
    samples = make_gnss(data.scene.arrays, data.views, config, data.seed, data.scenario)
    return dict.fromkeys(data.weathers, samples)
