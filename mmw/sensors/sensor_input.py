"""Give a sensor what it needs of a batch of frames."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mmw.core.kinematics import Motion
from mmw.core.random_series import white_series
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import Views, view_keys


@dataclass(frozen=True)
class SensorInput:
    """Scene, views and weathers of one sensor in one batch. A is the number of views."""

    scene: DeviceScene
    """Scene with the frames of the batch on the device."""
    motion: Motion
    """Velocities of the actors."""
    views: Views
    """Poses of the sensor: one row for each frame that is sampled and each agent that carries it."""
    weathers: Mapping[str, Weather]
    """Physical values of each weather by name."""
    seed: int
    """Seed of the configuration."""
    scenario: str
    """Name of the scenario."""

    def normal(self, sensor: str, *stream: str | int, count: int = 1) -> np.ndarray:
        """Return standard normal numbers of each view, shape [A, count], float64.

        They depend on seed, scenario, sensor, agent and frame alone, not on the batches of frames.

        Args:
            sensor: Name of the sensor.
            stream: Names that distinguish several series of one sensor.
            count: Numbers of a view.
        """
        keys = view_keys(self.scene.arrays, self.views, self.seed, self.scenario, sensor, *stream)
        return white_series(keys, [0], count)[:, 0]
