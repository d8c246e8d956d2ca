"""LiDAR sweeps of a batch: traced once, shaded in every weather."""

from collections.abc import Sequence

from mmw.core.random_keys import random_key
from mmw.scene.views import make_views, view_keys
from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.lidar.config import Lidar
from mmw.sensors.lidar.rows import lidar_rows, seen_rows
from mmw.sensors.lidar.scene_flow import scene_flow
from mmw.sensors.lidar.simulate import find_lidar_returns, trace_lidar_hits


def capture_lidar(job: Batch, sensors: Sequence[Lidar], frames: Sequence[int], collected: TableRows) -> None:
    """Add the sweeps of LiDARs, and how many of their points lie on each actor."""
    for sensor in sensors:
        _capture(job, sensor, frames, collected)


def _capture(job: Batch, sensor: Lidar, frames: Sequence[int], collected: TableRows) -> None:
    """Add the sweeps of one LiDAR, and how many of its points lie on each actor.

    In `compat` the random numbers are the same in every weather, because weather does nothing there.
    """
    views = make_views(job.arrays, frames, sensor)
    seed, scenario = job.config.seed, job.scenario.name
    with job.clock.stage(sensor.name, len(views) * sensor.channels * sensor.points_per_channel):
        hits = trace_lidar_hits(job.scene, views, sensor, job.motion)
        for name, tables in collected.items():
            keys = view_keys(job.arrays, views, seed, scenario, name if sensor.mode == "physical" else "", sensor.name)
            points = find_lidar_returns(
                hits, job.arrays.materials[name], job.weather(name), keys, random_key(seed, scenario, name, "fog")
            )
            flow = scene_flow(job.arrays, views, points) if sensor.scene_flow else None
            tables["lidar"].append(lidar_rows(job.arrays, sensor.name, views, points, flow))
            tables["box_visibility"].append(job.pool.submit(seen_rows, job.arrays, sensor.name, views, points))
