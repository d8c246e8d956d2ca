"""Depth images of a batch, and what the same rays show: segmentation, 2-D boxes, visible pixels."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from mmw.config import DepthConfig
from mmw.recording.job import Job, Rows, collect
from mmw.sensors.boxes import make_boxes
from mmw.sensors.boxes_2d import visible_pixels
from mmw.sensors.depth import intrinsics_of, trace_depth_images
from mmw.sensors.segmentation import object_tags
from mmw.sensors.visibility import boxed_actors
from mmw.tables.encode import encode_depth, encode_instance, encode_semantic
from mmw.tables.rows.common import Columns
from mmw.tables.rows.images import box_2d_rows, depth_rows, metre_lists, segmentation_rows
from mmw.tables.rows.visibility import seen_rows
from mmw.views import Views, make_views

MOST_LISTED = 2**31 - 1
"""Numbers that one list column of a shard holds: its offsets are 32-bit."""


def record_depth(job: Job, sensor: DepthConfig, frames: Sequence[int], collected: Rows) -> None:
    """Add the images of one depth camera; they are the same in every weather, so each is encoded once.

    Raises:
        ValueError: If a shard would hold more unrounded depths than a list column takes, or the scene more objects
            than an instance image.
    """
    views = make_views(job.arrays, frames, sensor)
    with_metres = sensor.format == "float32"
    if with_metres:
        _check_lists(job, sensor, len(np.unique(views.actor)))
    with job.clock.stage(sensor.name, len(views) * sensor.width_px * sensor.height_px):
        images = trace_depth_images(
            job.scene, views, sensor, with_metres=with_metres, with_objects=sensor.segmentation or sensor.boxes_2d
        )
        depth = images.depth.numpy()
        metres = metre_lists(views, images.depth_m.numpy() if with_metres else None)
    scenario = job.scenario.name
    encoded = [job.pool.submit(encode_depth, image) for image in depth]
    for weather, tables in collected.items():
        tables["depth"].append(depth_rows(job.arrays, sensor.name, views, encoded, metres, scenario, weather))
    if sensor.segmentation:
        with job.clock.stage(f"{sensor.name} segmentation"):
            objects, tags = images.object_id.numpy(), object_tags(job.arrays)
        instance = [job.pool.submit(encode_instance, image) for image in objects]
        semantic = [job.pool.submit(encode_semantic, image, tags) for image in objects]
        for weather, tables in collected.items():
            tables["segmentation"].append(
                segmentation_rows(job.arrays, sensor.name, views, instance, semantic, scenario, weather)
            )
    if sensor.boxes_2d:
        record_boxes_2d(job, sensor, frames, views, images.object_id, collected)


def record_boxes_2d(
    job: Job, sensor: DepthConfig, frames: Sequence[int], views: Views, object_id: wp.array, collected: Rows
) -> None:
    """Add the 2-D boxes of one camera, and the pixels that it has on each actor."""
    wanted = boxed_actors(job.arrays.actors)
    with job.clock.stage(f"{sensor.name} boxes"):
        visible = visible_pixels(object_id, [job.arrays.actors[i].object_id for i in wanted])

    def boxes() -> Columns:
        solid = make_boxes(job.arrays, frames, job.motion)
        return box_2d_rows(job.arrays, sensor.name, views, intrinsics_of(sensor), solid, visible)

    collect(
        collected,
        {
            "boxes_2d": job.pool.submit(boxes),
            "box_visibility": seen_rows(job.arrays, sensor.name, views, "pixels", visible.pixels),
        },
    )


def _check_lists(job: Job, sensor: DepthConfig, agents: int) -> None:
    each = agents * sensor.width_px * sensor.height_px
    frames = min(job.config.output.shard_frames, job.config.frames_of(job.scenario).count)
    if frames * each > MOST_LISTED:
        raise ValueError(
            f"sensor {sensor.name!r}: format = float32 gives {frames * each} depths a shard; "
            f"a column holds {MOST_LISTED}; use output.shard_frames: {max(MOST_LISTED // each, 1)} or less"
        )
