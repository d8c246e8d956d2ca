"""Capture LiDAR sweeps of a batch: traced once, shaded in every weather."""

from collections.abc import Sequence

from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.ground_truth.visibility_rows import point_rows
from mmw.sensors.lidar.config import Lidar
from mmw.sensors.lidar.rows import lidar_rows
from mmw.sensors.lidar.simulate import sweeps


def capture_lidar(batch: Batch, sensors: Sequence[Lidar], frames: Sequence[int], collected: TableRows) -> None:
    """Add the sweeps of LiDARs, and how many of their points lie on each actor."""
    for sensor in sensors:
        views = batch.views(frames, sensor)
        with batch.clock.stage(sensor.name, len(views) * sensor.channels * sensor.points_per_channel):
            for weather, points in sweeps(batch.sensor_input(views, collected), sensor):
                collected[weather]["lidar"].append(lidar_rows(batch.arrays, sensor.name, views, points))
                on_actors = (batch.arrays, sensor.name, views, "lidar_points", points.offsets, points.object_id)
                collected[weather]["box_visibility"].append(batch.submit(point_rows, *on_actors))
