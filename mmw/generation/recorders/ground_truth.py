"""Ground truth of a batch: frames, poses, boxes, and lines of sight between antennas and actors."""

from collections.abc import Sequence

from mmw.scene.rows import frame_rows, pose_rows
from mmw.sensors.batch import Batch, TableRows, collect
from mmw.sensors.ground_truth.box_rows import box_rows
from mmw.sensors.ground_truth.boxes_3d import make_boxes
from mmw.sensors.ground_truth.visibility import trace_sight
from mmw.sensors.ground_truth.visibility_rows import sight_rows


def record_ground_truth(job: Batch, frames: Sequence[int], collected: TableRows) -> None:
    """Add frames, poses, boxes and, where there is a channel, lines of sight."""
    with job.clock.stage("ground truth"):
        tables = {
            "frames": frame_rows(job.arrays, frames, job.config.seed),
            "poses": pose_rows(job.arrays, frames, job.motion),
            "boxes": box_rows(job.arrays, make_boxes(job.arrays, frames, job.motion)),
        }
        if job.config.channel.enabled:
            sight = trace_sight(job.scene, frames, dict(job.config.channel.antenna_position_m))
            tables["box_visibility"] = sight_rows(job.arrays, "antenna", sight)
        collect(collected, tables)
