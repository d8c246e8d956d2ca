"""Ground truth of a batch: frames, poses and boxes."""

from collections.abc import Sequence

from mmw.recording.job import Job, Rows, collect
from mmw.sensors.boxes import make_boxes
from mmw.tables.rows.world import box_rows, frame_rows, pose_rows


def record_ground_truth(job: Job, frames: Sequence[int], collected: Rows) -> None:
    """Add frames, poses and boxes."""
    with job.clock.stage("ground truth"):
        tables = {
            "frames": frame_rows(job.arrays, frames, job.config.seed),
            "poses": pose_rows(job.arrays, frames, job.motion),
            "boxes": box_rows(job.arrays, make_boxes(job.arrays, frames, job.motion)),
        }
        collect(collected, tables)
