"""Give a sensor what it needs of a batch of frames."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mmw.core.kinematics import Motion
from mmw.core.random_keys import random_generator
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import Views


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

    def normal(self, sensor: str, *stream: str | int, size: int | tuple[int, ...] = ()) -> np.ndarray:
        """Return standard normal numbers of each view, shape [A, *size], float64.

        They depend on seed, scenario, sensor, agent and frame alone, not on how frames are batched.

        Args:
            sensor: Name of the sensor.
            stream: Names that tell several series of one sensor apart.
            size: Shape for each view.
        """
        shape = (size,) if isinstance(size, int) else size
        found = np.empty((len(self.views), *shape))
        for row, (actor, frame) in enumerate(zip(self.views.actor, self.views.frame, strict=True)):
            agent = self.scene.arrays.actors[actor].name
            key = (self.seed, self.scenario, sensor, *stream, agent, int(frame))
            found[row] = random_generator(*key).standard_normal(shape)
        return found
