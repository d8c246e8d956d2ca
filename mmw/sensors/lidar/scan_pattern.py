"""Make ray patterns in the sensor frame (x forward, y left, z up): pure NumPy, float64."""

import functools
import math

import numpy as np

from mmw.sensors.lidar.config import Lidar


def lidar_elevations(channels: int, upper_fov_deg: float, lower_fov_deg: float) -> np.ndarray:
    """Return the elevation of every channel [rad], shape [channels]; channel 0 is the highest.

    Evenly spaced, `upper - i (upper - lower) / (channels - 1)`; a single channel looks along the upper limit.

    Source: CARLA 0.9.15 `sensor.lidar.ray_cast`.
    """
    step = (upper_fov_deg - lower_fov_deg) / max(channels - 1, 1)
    return np.radians(upper_fov_deg - step * np.arange(channels))


def lidar_azimuths(points_per_channel: int, horizontal_fov_deg: float = 360.0) -> np.ndarray:
    """Return the azimuth of every firing of one turn [rad], counter-clockwise from forward, shape [points_per_channel].

    Firing j looks along fov / 2 - j fov / n. With the whole circle the first one points backward (pi) and the turn
    runs clockwise seen from above: backward, left, forward, right. That is CARLA's sweep from -fov / 2 with growing
    yaw, written in our frame, where y points left. All channels fire at the same azimuths.

    Source: CARLA 0.9.15 `sensor.lidar.ray_cast` with one turn a tick.
    """
    return math.radians(horizontal_fov_deg) * (0.5 - np.arange(points_per_channel) / points_per_channel)


def lidar_directions(elevations: np.ndarray, azimuths: np.ndarray) -> np.ndarray:
    """Return the unit direction of every LiDAR ray, shape [channels * points_per_channel, 3].

    Channel-major: ray r belongs to channel (ring) `r // points_per_channel` and firing `r % points_per_channel`.

    Args:
        elevations: Elevation of every channel [rad], shape [channels].
        azimuths: Azimuth of every firing [rad], shape [points_per_channel].
    """
    elevation, azimuth = elevations[:, None], azimuths[None, :]
    x = np.cos(elevation) * np.cos(azimuth)
    y = np.cos(elevation) * np.sin(azimuth)
    z = np.broadcast_to(np.sin(elevation), x.shape)
    return np.stack([x, y, z], axis=-1).reshape(-1, 3)


def lidar_pattern(config: Lidar) -> np.ndarray:
    """Return the unit direction of every ray of a configured LiDAR, shape [channels * points_per_channel, 3]."""
    elevations = (
        lidar_elevations(config.channels, config.upper_fov_deg, config.lower_fov_deg)
        if config.elevations_deg is None
        else np.radians(config.elevations_deg)
    )
    return lidar_directions(elevations, lidar_azimuths(config.points_per_channel, config.horizontal_fov_deg))


@functools.lru_cache(maxsize=16)
def lidar_order(channels: int, points_per_channel: int) -> np.ndarray:
    """Return the ray indices in the order of the threads, shape [channels * points_per_channel], int32.

    Blocks of 8 channels x 4 firings stay together, about 3 x 3 deg of the usual pattern, so that the 32 threads of a
    warp traverse the same part of the BVHs. The order decides speed only: results are stored by ray index.
    It is made once and must not be written to.
    """
    channel, firing = np.divmod(np.arange(channels * points_per_channel), points_per_channel)
    order = np.lexsort((channel, firing, firing // 4, channel // 8)).astype(np.int32)
    order.flags.writeable = False
    return order
