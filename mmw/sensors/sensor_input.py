"""Give a sensor what it needs of a batch of frames."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from mmw.core.kinematics import Motion
from mmw.core.random_series import white_series
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import Views, view_keys
from mmw.sensors.samples import Output

T = TypeVar("T")


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
    output: Output = "numpy"
    """`warp` asks a sensor with `SensorSpec.warp_output` to leave its arrays on the device."""
    cache: dict[Any, Any] = field(default_factory=dict)
    """Store of sensors for later batches of the scene, see `cached`."""
    radio_scene: DeviceScene | None = None
    """The scene as radio waves meet it, with hulls of crowns where `scene` has leaves; None if it is `scene`."""
    scene_seed: int | None = None
    """Seed of what all sensors see alike, such as clouds and patches of fog; None for `seed`."""

    @property
    def seed_of_scene(self) -> int:
        """`scene_seed`, or `seed` without one."""
        return self.seed if self.scene_seed is None else self.scene_seed

    def cached(self, key: Any, make: Callable[[], T]) -> T:
        """Return what a sensor keeps for all batches of the scene, such as textures; it is made at the first call.

        Poses may change between batches, and weathers may come; geometry and materials stay.

        Args:
            key: Names it among those of all sensors.
            make: Makes it.
        """
        if key not in self.cache:
            self.cache[key] = make()
        return self.cache[key]

    def keys(self, *stream: str | int) -> np.ndarray:
        """Return the key of each view's random numbers, shape [A, 2], uint32, from seed, scenario, agent and frame.

        Args:
            stream: Further names of the stream: the weather, if the numbers depend on it, and the sensor.
        """
        return view_keys(self.scene.arrays, self.views, self.seed, self.scenario, *stream)

    def normal(self, sensor: str, *stream: str | int, count: int = 1) -> np.ndarray:
        """Return standard normal numbers of each view, shape [A, count], float64.

        They depend on seed, scenario, sensor, agent and frame alone, not on the batches of frames.

        Args:
            sensor: Name of the sensor.
            stream: Names that distinguish several series of one sensor.
            count: Numbers of a view.
        """
        return white_series(self.keys(sensor, *stream), [0], count)[:, 0]
