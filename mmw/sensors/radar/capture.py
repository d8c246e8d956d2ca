"""Radar samples of a batch: traced once, evaluated in every weather."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from mmw.kernels.radar.trace import RadarRays
from mmw.scene.view_motion import view_twists
from mmw.scene.views import Views, make_views, view_keys
from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.ground_truth.visibility_rows import point_rows
from mmw.sensors.radar.config import Radar
from mmw.sensors.radar.detection import detect
from mmw.sensors.radar.iq import radar_iq_samples
from mmw.sensors.radar.map_rows import radar_iq_rows, radar_map_rows
from mmw.sensors.radar.points import RadarPoints
from mmw.sensors.radar.power_maps import radar_maps
from mmw.sensors.radar.rain_clutter import rain_clutter
from mmw.sensors.radar.resolution_cells import SortedRays, bin_rays, sum_cells
from mmw.sensors.radar.rows import radar_rows
from mmw.sensors.radar.simulate import compat_points, dense_points, shade_radar, trace_radar


def capture_radar(job: Batch, sensors: Sequence[Radar], frames: Sequence[int], collected: TableRows) -> None:
    """Add the samples of radars, and how many of their points lie on each actor."""
    for sensor in sensors:
        _capture(job, sensor, frames, collected)


def _capture(job: Batch, sensor: Radar, frames: Sequence[int], collected: TableRows) -> None:
    """Add the samples of one radar, and how many of its points lie on each actor.

    Where the rays go does not depend on the weather; fluctuation, noise, rain and false alarms do, each by its own key.
    """
    views = make_views(job.arrays, frames, sensor)
    with job.clock.stage(sensor.name, len(views) * sensor.ray_count):
        velocity, _ = view_twists(job.arrays, job.motion, views)
        keys = view_keys(job.arrays, views, job.config.seed, job.scenario.name, sensor.name)
        hits = trace_radar(job.scene, views, velocity, sensor, keys)
        needs_cells = sensor.mode == "physical" and (sensor.output == "detections" or len(sensor.maps) > 0)
        order = None
        for weather, tables in collected.items():
            if sensor.mode == "compat":
                points = compat_points(hits)
            else:
                rays = shade_radar(hits, job.arrays.materials[weather], job.weather(weather), sensor)
                if needs_cells and order is None:
                    order = bin_rays(sensor, rays)  # the same in every weather
                points = _evaluate(job, sensor, views, velocity, weather, order, rays, tables)
            tables["radar"].append(radar_rows(job.arrays, sensor.name, views, points))
            seen = (job.arrays, sensor.name, views, "radar_points", points.offsets, points.object_id)
            tables["box_visibility"].append(job.pool.submit(point_rows, *seen))


def _evaluate(
    job: Batch,
    sensor: Radar,
    views: Views,
    velocity: np.ndarray,
    weather: str,
    order: SortedRays | None,
    rays: RadarRays,
    tables: dict[str, list[Any]],
) -> RadarPoints:
    """Return the points of a batch in one weather, and add maps and samples where the sensor stores them."""
    device = job.scene.device
    keys = view_keys(job.arrays, views, job.config.seed, job.scenario.name, weather, sensor.name)
    if sensor.iq:
        samples = radar_iq_samples(sensor, rays, keys)
        tables["radar_iq"].append(radar_iq_rows(job.arrays, sensor.name, views, samples))
    if order is None:
        return dense_points(rays, sensor)
    cells = sum_cells(order, rays)
    clutter = rain_clutter(sensor, job.weather(weather), views.pose, velocity, keys, device)
    for kind in sensor.maps:
        maps = radar_maps(sensor, kind, cells, clutter, keys, device)
        tables["radar_maps"].append(radar_map_rows(job.arrays, sensor.name, views, maps))
    return dense_points(rays, sensor) if sensor.output == "dense" else detect(sensor, cells, clutter, keys, device)
