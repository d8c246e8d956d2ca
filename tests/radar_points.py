"""Rays of a radar made up by hand, without a scene."""

import numpy as np
import warp as wp

from mmw.config import RadarConfig
from mmw.kernels.radar import RadarRays
from mmw.random_keys import random_keys
from mmw.sensors.radar_batch import RadarBatch
from mmw.sensors.radar_cells import RadarCells, sort_into_cells, sum_cells
from mmw.sensors.radar_detection import detect

FIELDS = ("range", "azimuth", "elevation", "velocity", "power", "rcs", "object_id")


def make_rays(device: str, views: list[np.ndarray]) -> RadarRays:
    """Return rays; a view is an array [R, 7] of `FIELDS`; shorter views are filled up with rays that meet nothing."""
    table = np.zeros((len(views), max([len(view) for view in views] + [1]), len(FIELDS)))
    table[:, :, 0], table[:, :, 6] = np.inf, -1
    for row, view in zip(table, views, strict=True):
        row[: len(view)] = np.reshape(view, (-1, len(FIELDS)))
    rays = RadarRays()
    for i, name in enumerate(FIELDS[:-1]):
        setattr(rays, name, wp.array(table[:, :, i].astype(np.float32), dtype=float, device=device))
    rays.object_id = wp.array(table[:, :, 6].astype(np.int32), dtype=int, device=device)
    return rays


def target(
    config: RadarConfig, cell: tuple[float, float, float, float], snr_db: float, object_id: int = 1
) -> list[float]:
    """Return a ray by its place in steps of (range, velocity, y, z), of 10 m2."""
    r, v, y, z = cell
    elevation = np.arcsin(z * 2.0 / config.elevation_antennas)
    azimuth = np.arcsin(y * 2.0 / config.azimuth_antennas / np.cos(elevation))
    power = config.noise_w * 10.0 ** (snr_db / 10.0)
    return [r * config.range_resolution, azimuth, elevation, v * config.velocity_resolution, power, 10.0, object_id]


def make_keys(count: int, name: str = "test") -> np.ndarray:
    return random_keys((name, i) for i in range(count))


def make_cells(config: RadarConfig, device: str, views: list[np.ndarray]) -> RadarCells:
    rays = make_rays(device, views)
    return sum_cells(sort_into_cells(config, rays), rays)


def detections(config: RadarConfig, device: str, views: list[np.ndarray], name: str = "test") -> RadarBatch:
    return detect(config, make_cells(config, device, views), None, make_keys(len(views), name), device)
