"""Capture LiDAR sweeps of a batch: traced once, shaded in every weather."""

from collections.abc import Sequence

from mmw.core.random_keys import random_key
from mmw.scene.views import sample_views, view_keys
from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.ground_truth.visibility_rows import point_rows
from mmw.sensors.lidar.config import Lidar
from mmw.sensors.lidar.rows import lidar_rows
from mmw.sensors.lidar.scene_flow import scene_flow
from mmw.sensors.lidar.simulate import find_lidar_returns, trace_lidar_hits


def capture_lidar(batch: Batch, sensors: Sequence[Lidar], frames: Sequence[int], collected: TableRows) -> None:
    """Add the sweeps of LiDARs, and how many of their points lie on each actor."""
    for sensor in sensors:
        _capture(batch, sensor, frames, collected)


def _capture(batch: Batch, sensor: Lidar, frames: Sequence[int], collected: TableRows) -> None:
    """Add the sweeps of one LiDAR, and how many of its points lie on each actor.

    In `carla` the random numbers are the same in every weather, because weather does nothing there.
    """
    views = sample_views(batch.arrays, frames, sensor)
    seed, scenario = batch.config.seed, batch.scenario.name
    with batch.clock.stage(sensor.name, len(views) * sensor.channels * sensor.points_per_channel):
        hits = trace_lidar_hits(batch.scene, views, sensor, batch.motion)
        for name, tables in collected.items():
            keys = view_keys(
                batch.arrays, views, seed, scenario, name if sensor.mode == "physical" else "", sensor.name
            )
            points = find_lidar_returns(
                hits, batch.arrays.materials[name], batch.weather(name), keys, random_key(seed, scenario, name, "fog")
            )
            flow = scene_flow(batch.arrays, views, points) if sensor.scene_flow else None
            tables["lidar"].append(lidar_rows(batch.arrays, sensor.name, views, points, flow))
            on_actors = (batch.arrays, sensor.name, views, "lidar_points", points.offsets, points.object_id)
            tables["box_visibility"].append(batch.pool.submit(point_rows, *on_actors))
