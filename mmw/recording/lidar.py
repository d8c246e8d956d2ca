"""LiDAR sweeps of a batch: traced once, shaded in every weather."""

from collections.abc import Sequence

from mmw.config import LidarConfig
from mmw.recording.job import Job, Rows, collect
from mmw.sensors.lidar import shade_lidar, trace_lidar_hits
from mmw.tables.rows.lidar import lidar_rows, visibility_rows
from mmw.views import make_views


def record_lidar(job: Job, sensor: LidarConfig, frames: Sequence[int], collected: Rows) -> None:
    """Add the sweeps of one LiDAR."""
    views = make_views(job.arrays, frames, sensor)
    with job.clock.stage(sensor.name, len(views) * sensor.channels * sensor.points_per_channel):
        hits = trace_lidar_hits(job.scene, views, sensor)
        for weather, tables in collected.items():
            points = shade_lidar(hits, job.arrays.materials[weather])
            tables["lidar"].append(lidar_rows(job.arrays, sensor.name, views, points))
    seen = job.pool.submit(visibility_rows, job.arrays, sensor.name, views, hits)
    collect(collected, {"box_visibility": seen})
