"""Depth images of a batch."""

from collections.abc import Sequence

from mmw.config import DepthConfig
from mmw.recording.job import Job, Rows
from mmw.sensors.depth import trace_depth
from mmw.tables.encode import encode_depth
from mmw.tables.rows.images import depth_rows
from mmw.views import make_views


def record_depth(job: Job, sensor: DepthConfig, frames: Sequence[int], collected: Rows) -> None:
    """Add the images of one depth camera."""
    views = make_views(job.arrays, frames, sensor)
    with job.clock.stage(sensor.name, len(views) * sensor.width_px * sensor.height_px):
        images = trace_depth(job.scene, views, sensor).depth
    encoded = [job.pool.submit(encode_depth, image) for image in images]
    for weather, tables in collected.items():
        tables["depth"].append(depth_rows(job.arrays, sensor.name, views, encoded, job.scenario.name, weather))
