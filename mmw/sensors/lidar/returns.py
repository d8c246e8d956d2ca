"""Find the returns of traced LiDAR rays in one weather, on the device, and gather them."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.recorded_work import Same
from mmw.core.remember import remembered
from mmw.core.repeated_launch import launch_again
from mmw.kernels.lidar import returns as lidar_returns
from mmw.kernels.lidar import trace as lidar
from mmw.kernels.lidar.precipitation import Air
from mmw.physics.materials.material import Material, wet_reflectance
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import VIEW_TYPES
from mmw.sensors.lidar.config import Lidar
from mmw.sensors.lidar.precipitation import make_air
from mmw.sensors.lidar.sweep_arrays import SweepArrays
from mmw.sensors.samples import Array, Output

RETURNS = {
    "strongest": lidar_returns.STRONGEST, "last": lidar_returns.LAST, "dual": lidar_returns.DUAL,
}  # fmt: skip
"""`returns` of the configuration -> what the kernel takes."""

BEYOND = 1e30
"""Slope of an overlap that begins and is full at one distance [1/m]."""

KEY_COLUMN = len(VIEW_TYPES) + 1
"""Place of the keys of random numbers in `SweepArrays.given`."""

BLOCK_DIM = 64
"""Threads of a block that looks for echoes: rays of a block differ in length of work, and a small block waits less."""


@dataclass(frozen=True)
class LidarHits:
    """First hits of the rays of a batch, on the device; geometry only, so it serves every weather. A views, R rays
    each."""

    config: Lidar
    arrays: SweepArrays
    """Poses, motion and hits; the next sweep into the same arrays overwrites them."""

    scene: DeviceScene | None = None
    """None; else the rays are not traced yet: that is launched together with the returns of the first weather."""

    @property
    def traced(self) -> "LidarHits":
        """The same, traced: what the other weathers take."""
        return replace(self, scene=None)

    @property
    def rays(self) -> lidar.LidarRays:
        """First hits, shape [A, R]; ray r belongs to channel r // points_per_channel."""
        return self.arrays.rays

    @property
    def shape(self) -> tuple[int, int]:
        """Views, and rays of a view."""
        return self.arrays.shape


def shade_on_device(
    hits: LidarHits,
    materials: Sequence[Material],
    weather: Weather,
    keys: np.ndarray,
    patch_key: tuple[int, int],
    output: Output = "warp",
) -> tuple[np.ndarray, Array]:
    """Return the first point of every view, and N, shape [A + 1], int32; and the points, see `SweepArrays.read`.

    See `mmw.sensors.lidar.simulate.find_lidar_returns`.
    """
    arrays = hits.arrays
    if hits.shape[0] == 0:
        none = np.zeros(0, np.uint8) if output == "numpy" else wp.empty(0, dtype=wp.uint8, device=arrays.device)
        return np.zeros(1, dtype=np.int32), none
    finder = _Finder(hits, materials, weather, keys, patch_key)

    def launch() -> None:
        finder.launch()
        arrays.gather()

    arrays.run(finder.key, launch)
    return arrays.read(output)


def find_returns(
    hits: LidarHits, materials: Sequence[Material], weather: Weather, keys: np.ndarray, patch_key: tuple[int, int]
) -> tuple[wp.array, wp.array]:
    """Return the returns of every ray, shape [A, R, 1 or 2], and how many they are, shape [A, R].

    See `mmw.sensors.lidar.simulate.find_lidar_returns`.
    """
    _Finder(hits, materials, weather, keys, patch_key).launch()
    return hits.arrays.returns, hits.arrays.count


class _Finder:
    """Launches what finds the returns of traced rays in a weather.

    Attributes:
        key: All that decides what `launch` does, beside the values in arrays.
    """

    def __init__(
        self,
        hits: LidarHits,
        materials: Sequence[Material],
        weather: Weather,
        keys: np.ndarray,
        patch_key: tuple[int, int],
    ) -> None:
        """Write the keys of random numbers, and prepare the arguments."""
        if not materials:
            raise ValueError(
                "find_lidar_returns: no materials; every id of the scene needs one; pass arrays.materials[weather]"
            )
        config, arrays, views = hits.config, hits.arrays, hits.shape[0]
        if keys.shape != (views, 2):
            raise ValueError(
                f"find_lidar_returns: keys of shape {keys.shape}; {views} views need ({views}, 2); use view_keys"
            )
        arrays.given.host[KEY_COLUMN][:] = keys
        self._hits, device = hits, str(arrays.device)
        outputs = [arrays.returns, arrays.count]
        if config.mode == "carla":
            physics: list[Any] = [_carla(config)]
            self._arguments = [arrays.rays, *physics, arrays.key, *outputs]
        else:
            physics = [
                _reflectance(config, weather, materials, device),
                _air(config, weather, device, patch_key),
                detector(config),
            ]
            traced = [arrays.rays, arrays.views, arrays.sweep, arrays.time_s, arrays.pattern[0]]
            self._arguments = [*traced, *physics, arrays.key, *outputs]
        scene = None if hits.scene is None else hits.scene.struct
        self.key = tuple(map(Same, (scene, *physics)))

    def launch(self) -> None:
        """Copy what the host gives, and launch."""
        hits, arrays = self._hits, self._hits.arrays
        arrays.given.upload()
        if hits.scene is not None:
            arrays.trace(hits.scene)
        if hits.config.mode == "carla":
            launch_again(lidar_returns.carla_kernel, hits.shape, self._arguments, str(arrays.device))
        else:
            kernel = lidar_returns.physical_kernel
            launch_again(kernel, hits.shape, self._arguments, str(arrays.device), BLOCK_DIM)


@remembered(owners=2, size=32)
def _air(config: Lidar, weather: Weather, device: str, patch_key: tuple[int, int]) -> Air:
    return make_air(weather, config.lidar_optics(), config.range_m, device, patch_key)


@remembered(owners=3, size=32)
def _reflectance(config: Lidar, weather: Weather, materials: Sequence[Material], device: str) -> wp.array:
    """Return the reflectance of every material, dry and as it is in a weather, on a device, shape [2, M]."""
    wavelength_nm = config.lidar_optics().wavelength_nm
    dry = [material.lidar_reflectance for material in materials]
    wet = [wet_reflectance(material, weather.wetness, wavelength_nm) for material in materials]
    return wp.array(np.array([dry, wet], dtype=np.float32), dtype=float, device=device)


@remembered(size=32)
def detector(config: Lidar) -> lidar_returns.Detector:
    """Return what decides over a return in `physical`.

    `absolute` is the link budget: a surface returns if its power P is above the threshold Pmin. With `relative` nothing
    is lost in clear dry air: the threshold of a surface is the lower of Pmin and its power in clear dry air less the
    margin. So what stands above Pmin must stay above it, and a weaker surface, which is there by this rule alone, goes
    when wetness and extinction take more than the margin from it. A lower Pmin would keep such surfaces too, but it
    would fill the sky with echoes of rain that the sensor does not have.
    """
    optics = config.lidar_optics()
    found = lidar_returns.Detector()
    found.min_power = optics.min_power
    found.kept_share = math.inf if config.detection == "absolute" else 10.0 ** (-config.detection_margin_db / 10.0)
    found.range_resolution = optics.range_resolution_m
    found.pulse_length = 0.5 * SPEED_OF_LIGHT * optics.pulse_s
    width = optics.overlap_full_m - optics.overlap_start_m
    found.overlap_start = optics.overlap_start_m
    found.overlap_per_m = 1.0 / width if width > 0.0 else BEYOND
    found.overlap_exponent = optics.overlap_exponent
    found.returns = RETURNS[config.returns]
    return found


@remembered(size=32)
def _carla(config: Lidar) -> lidar_returns.CarlaLidar:
    given = config.carla
    carla = lidar_returns.CarlaLidar()
    carla.attenuation = given.atmosphere_attenuation_rate
    carla.general_loss = given.dropoff_general_rate
    carla.intensity_limit = given.dropoff_intensity_limit
    carla.zero_loss = given.dropoff_zero_intensity
    carla.noise = given.noise_stddev
    return carla
