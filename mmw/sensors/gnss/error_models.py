"""Simulate a satellite navigation receiver by models of its errors: position, velocity, heading from float64 poses.

carla    CARLA's GNSS sensor and the published dataset's navigation unit: latitude, longitude and altitude by CARLA's
          Mercator map, each with white noise; speed and heading with white noise. The error of the speed lies along
          the motion (along the heading at rest) in the velocity.
physical  WGS-84 by the tangent plane at the reference point. The error of the position, in meters along the world's
          axes, is white noise plus a drift: first-order Gauss-Markov noise of the given spread and correlation time.
          White noise on every axis of the velocity; speed is the length of its horizontal part.

Heading is that of the sensor's x axis, not of the motion. East, north and up are the world's x, y and z. Velocity is a
central difference (`mmw.core.kinematics`) of the mounted sensor, so a lever arm counts. Errors are
functions of (seed, scenario, agent, sensor, time), whichever frames are asked for, and at any rate of frames or
samples; weather and buildings do not change them. Mode `ray_traced` takes velocity, speed and heading of `physical`,
and finds positions itself (`ray_traced`).

Source: CARLA 0.9.15 `sensor.other.gnss`; error model as in R. G. Brown and P. Y. C. Hwang, "Introduction to Random
Signals and Applied Kalman Filtering" (2012), chapter 9.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import warp as wp

from mmw.core.constants import FRAME_DT
from mmw.core.frame_rate import instants
from mmw.core.geodesy import earth_map
from mmw.core.random_series import gauss_markov
from mmw.core.remember import remembered
from mmw.kernels.navigation import gnss as kernels
from mmw.scene.scene_data import SceneData
from mmw.scene.views import Views
from mmw.sensors.gnss.config import Gnss
from mmw.sensors.mounted_motion import agent_names, mounted_samples, series_keys, view_grid
from mmw.sensors.samples import Samples

COLUMNS = 11
"""Numbers of a sample of the kernel: those of `GnssSample` in their order."""

SLOWEST = 0.01
"""Speed from which motion has a direction [m/s]; design value."""


@dataclass(frozen=True)
class GnssSample(Samples):
    """GNSS samples of A views, or the one of a single view; float64."""

    geodetic: np.ndarray
    """Measured latitude [deg], longitude [deg] and altitude [m], shape [A, 3]."""
    geodetic_true: np.ndarray
    """The same without errors, shape [A, 3]."""
    velocity: np.ndarray
    """Measured velocity to the east, to the north and up [m/s], shape [A, 3]."""
    speed: np.ndarray
    """Measured horizontal speed [m/s], shape [A]; `carla`'s noise can make it negative near rest."""
    heading: np.ndarray
    """Measured heading of the sensor's x axis, clockwise from north, 0 to 2 pi [rad], shape [A]."""

    @property
    def latitude_deg(self) -> np.ndarray:
        """Measured latitude, north positive [deg], shape [A]."""
        return self.geodetic[..., 0]

    @property
    def longitude_deg(self) -> np.ndarray:
        """Measured longitude, east positive [deg], shape [A]."""
        return self.geodetic[..., 1]

    @property
    def altitude_m(self) -> np.ndarray:
        """Measured height: above the ellipsoid (`physical`), reference plus z (`carla`) [m], shape [A]."""
        return self.geodetic[..., 2]


def make_gnss(arrays: SceneData, views: Views, config: Gnss, seed: int, scenario: str) -> GnssSample:
    """Return the GNSS samples of some views in mode `carla` or `physical`; in another mode as in `physical`.

    The frames around those of the views are differentiated too, so give all batches the same recording.

    Raises:
        ValueError: If the scene does not cover a frame.
    """
    drift = _no_drift() if config.mode == "carla" else _drift(arrays, views, config, seed, scenario)
    errors = [drift, _model(config), earth_map(config.mode == "carla", config.reference)]
    values = mounted_samples(kernels.gnss_kernel, arrays, views, config, (seed, scenario), errors, COLUMNS)
    return GnssSample(*(values[at : at + 3].T for at in (0, 3, 6)), *values[9:])


def _drift(arrays: SceneData, views: Views, config: Gnss, seed: int, scenario: str) -> wp.array:
    """Return the drift of each view, of spread 1: an argument of the kernel."""
    grid = view_grid(views)
    keys = series_keys(config, seed, scenario, agent_names(arrays, grid.actors), "drift")
    base, parts = instants(grid.frames, arrays.rate_hz)
    series = gauss_markov(keys, base, 3, config.drift_correlation_s / FRAME_DT, parts)
    return wp.array(series[grid.place], dtype=wp.vec3d, device="cpu")


@cache
def _no_drift() -> wp.array:
    return wp.empty(0, dtype=wp.vec3d, device="cpu")


@remembered()
def _model(config: Gnss) -> kernels.GnssModel:
    model = kernels.GnssModel()
    model.slowest, model.heading_std = SLOWEST, np.radians(config.heading_noise_std_deg)
    if config.mode == "carla":
        model.noise_std = wp.vec3d(
            config.latitude_noise_std_deg, config.longitude_noise_std_deg, config.altitude_noise_std_m
        )
        model.speed_std = config.speed_noise_std_m_s
    else:
        across, up = config.horizontal_noise_std_m, config.vertical_noise_std_m
        model.noise_std = wp.vec3d(across, across, up)
        model.drift_std = wp.vec3d(
            config.horizontal_drift_std_m, config.horizontal_drift_std_m, config.vertical_drift_std_m
        )
        model.speed_std = config.velocity_noise_std_m_s
    return model
