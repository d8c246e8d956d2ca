"""Capture radar samples of a batch: traced once, evaluated in every weather."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from mmw.kernels.radar.trace import RadarRays
from mmw.scene.views import Views, sample_views, view_keys, view_twists
from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.ground_truth.visibility_rows import point_rows
from mmw.sensors.radar.config import Radar
from mmw.sensors.radar.detection import detect
from mmw.sensors.radar.iq import radar_iq_samples
from mmw.sensors.radar.points import RadarPoints
from mmw.sensors.radar.power_maps import radar_maps
from mmw.sensors.radar.rain_clutter import rain_clutter
from mmw.sensors.radar.resolution_cells import SortedRays, bin_rays, sum_cells
from mmw.sensors.radar.rows import radar_iq_rows, radar_map_rows, radar_rows
from mmw.sensors.radar.simulate import carla_points, dense_points, shade_radar, trace_radar


def capture_radar(batch: Batch, sensors: Sequence[Radar], frames: Sequence[int], collected: TableRows) -> None:
    """Add the samples of radars, and how many of their points lie on each actor."""
    for sensor in sensors:
        _capture(batch, sensor, frames, collected)


def _capture(batch: Batch, sensor: Radar, frames: Sequence[int], collected: TableRows) -> None:
    """Add the samples of one radar, and how many of its points lie on each actor.

    Where the rays go does not depend on the weather; fluctuation, noise, rain and false alarms do, each by its own key.
    """
    views = sample_views(batch.arrays, frames, sensor)
    with batch.clock.stage(sensor.name, len(views) * sensor.ray_count):
        velocity, _ = view_twists(batch.arrays, batch.motion, views)
        keys = view_keys(batch.arrays, views, batch.config.seed, batch.scenario.name, sensor.name)
        hits = trace_radar(batch.scene, views, velocity, sensor, keys)
        needs_cells = sensor.mode == "physical" and (sensor.output == "detections" or len(sensor.maps) > 0)
        order = None
        for weather, tables in collected.items():
            if sensor.mode == "carla":
                points = carla_points(hits)
            else:
                rays = shade_radar(hits, batch.arrays.materials[weather], batch.weather(weather), sensor)
                if needs_cells and order is None:
                    order = bin_rays(sensor, rays)  # the same in every weather
                points = _evaluate(batch, sensor, views, velocity, weather, order, rays, tables)
            tables["radar"].append(radar_rows(batch.arrays, sensor.name, views, points))
            on_actors = (batch.arrays, sensor.name, views, "radar_points", points.offsets, points.object_id)
            tables["box_visibility"].append(batch.pool.submit(point_rows, *on_actors))


def _evaluate(
    batch: Batch,
    sensor: Radar,
    views: Views,
    velocity: np.ndarray,
    weather: str,
    order: SortedRays | None,
    rays: RadarRays,
    tables: dict[str, list[Any]],
) -> RadarPoints:
    """Return the points of a batch in one weather, and add maps and samples where the sensor stores them."""
    device = batch.scene.device
    keys = view_keys(batch.arrays, views, batch.config.seed, batch.scenario.name, weather, sensor.name)
    if sensor.iq:
        samples = radar_iq_samples(sensor, rays, keys)
        tables["radar_iq"].append(radar_iq_rows(batch.arrays, sensor.name, views, samples))
    if order is None:
        return dense_points(rays, sensor)
    cells = sum_cells(order, rays)
    clutter = rain_clutter(sensor, batch.weather(weather), views.pose, velocity, keys, device)
    for kind in sensor.maps:
        maps = radar_maps(sensor, kind, cells, clutter, keys, device)
        tables["radar_maps"].append(radar_map_rows(batch.arrays, sensor.name, views, maps))
    return dense_points(rays, sensor) if sensor.output == "dense" else detect(sensor, cells, clutter, keys, device)
