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

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmw.core.constants import FRAME_DT
from mmw.core.frame_rate import instants
from mmw.core.geodesy import mercator_from_world, sensor_heading, wgs84_from_world
from mmw.core.random_keys import random_keys
from mmw.core.random_series import gauss_markov, white_series
from mmw.scene.scene_data import SceneData
from mmw.scene.views import Views, frame_rows
from mmw.sensors.gnss.config import Gnss
from mmw.sensors.mounted_motion import mounted_motion, view_grid
from mmw.sensors.samples import Samples

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
    grid = view_grid(views)
    moved = mounted_motion(arrays, config, grid.actors, frame_rows(arrays, grid.frames))
    pose, velocity = (values[moved.at].swapaxes(0, 1) for values in (moved.pose, moved.motion.velocity))
    names = [arrays.actors[index].name for index in grid.actors.tolist()]
    measured = _measure(pose, velocity, instants(grid.frames, arrays.rate_hz), config, (seed, scenario), names)
    return GnssSample(*(values[grid.place] for values in measured))


def _measure(
    pose: np.ndarray,
    velocity: np.ndarray,
    times: tuple[np.ndarray, np.ndarray],
    config: Gnss,
    stream: tuple[str | int, ...],
    agents: Sequence[str],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return measured and true position, velocity, speed and heading, shape [A, F] or [A, F, 3]; times: `instants`."""
    frames, parts = times

    def keys(kind: str) -> np.ndarray:
        return random_keys((*stream, agent, config.name, kind) for agent in agents)

    white = white_series(keys("white"), frames, 8, parts)
    heading_true = sensor_heading(pose[..., 3:])
    heading = np.mod(heading_true + np.radians(config.heading_noise_std_deg) * white[..., 6], 2.0 * np.pi)
    heading = np.where(heading >= 2.0 * np.pi, 0.0, heading)
    if config.mode == "carla":
        true = mercator_from_world(pose[..., :3], config.reference)
        spread = (config.latitude_noise_std_deg, config.longitude_noise_std_deg, config.altitude_noise_std_m)
        speed_true = np.linalg.norm(velocity[..., :2], axis=-1)
        error = config.speed_noise_std_m_s * white[..., 3]
        facing = np.stack([np.sin(heading_true), np.cos(heading_true)], axis=-1)
        moving = velocity[..., :2] / np.maximum(speed_true, SLOWEST)[..., None]
        along = np.where((speed_true >= SLOWEST)[..., None], moving, facing)
        noisy = velocity.copy()
        noisy[..., :2] += error[..., None] * along
        return true + np.array(spread) * white[..., :3], true, noisy, speed_true + error, heading
    drift = gauss_markov(keys("drift"), frames, 3, config.drift_correlation_s / FRAME_DT, parts)
    spread = np.array([config.horizontal_drift_std_m] * 2 + [config.vertical_drift_std_m])
    noise = np.array([config.horizontal_noise_std_m] * 2 + [config.vertical_noise_std_m])
    measured = wgs84_from_world(pose[..., :3] + spread * drift + noise * white[..., :3], config.reference)
    noisy = velocity + config.velocity_noise_std_m_s * white[..., 3:6]
    speed = np.linalg.norm(noisy[..., :2], axis=-1)
    return measured, wgs84_from_world(pose[..., :3], config.reference), noisy, speed, heading
