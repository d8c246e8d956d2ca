"""Simulate a radar: rays traced once a batch, points, maps and samples evaluated in every weather."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mmw.kernels.radar.trace import RadarRays
from mmw.physics.weather.weather import Weather
from mmw.scene.views import view_twists
from mmw.sensors.radar.config import Radar
from mmw.sensors.radar.detection import detect
from mmw.sensors.radar.iq import radar_iq_samples
from mmw.sensors.radar.points import RadarPoints
from mmw.sensors.radar.power_maps import radar_maps
from mmw.sensors.radar.rain_clutter import rain_clutter
from mmw.sensors.radar.resolution_cells import SortedRays, bin_rays, sum_cells
from mmw.sensors.radar.trace import carla_points, dense_points, shade_radar, trace_radar
from mmw.sensors.sensor_input import SensorInput


def simulate(data: SensorInput, config: Radar) -> dict[str, RadarPoints]:
    """Return the points of all views in each weather, with the maps and samples that the radar is configured for."""
    return dict(scans(data, config))


def scans(data: SensorInput, config: Radar) -> Iterator[tuple[str, RadarPoints]]:
    """Trace all views once, and yield what `simulate` returns in one weather after the other.

    Where the rays go does not depend on the weather; fluctuation, noise, rain and false alarms do, each by its own key.
    """
    velocity, _ = view_twists(data.scene.arrays, data.motion, data.views)
    hits = trace_radar(data.scene, data.views, velocity, config, data.keys(config.name))
    needs_cells = config.mode == "physical" and (config.output == "detections" or len(config.maps) > 0)
    order = None
    for name, weather in data.weathers.items():
        if config.mode == "carla":
            yield name, carla_points(hits)
            continue
        rays = shade_radar(hits, data.scene.arrays.materials[name], weather, config)
        if needs_cells and order is None:
            order = bin_rays(config, rays)  # the same in every weather
        yield name, _evaluate(data, config, velocity, weather, data.keys(name, config.name), order, rays)


def _evaluate(
    data: SensorInput,
    config: Radar,
    velocity: np.ndarray,
    weather: Weather,
    keys: np.ndarray,
    order: SortedRays | None,
    rays: RadarRays,
) -> RadarPoints:
    device = data.scene.device
    iq = radar_iq_samples(config, rays, keys) if config.iq else None
    if order is None:
        return replace(dense_points(rays, config), iq=iq)
    cells = sum_cells(order, rays)
    clutter = rain_clutter(config, weather, data.views.pose, velocity, keys, device)
    maps = tuple(radar_maps(config, kind, cells, clutter, keys, device) for kind in config.maps)
    is_dense = config.output == "dense"
    points = dense_points(rays, config) if is_dense else detect(config, cells, clutter, keys, device)
    return replace(points, maps=maps, iq=iq)
