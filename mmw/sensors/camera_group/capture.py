"""Images of a batch: what each pixel sees is traced once, then shared by color, depth, objects and all weathers."""

from collections.abc import Sequence

from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.camera_group.launches import Launch, make_launches, most_pixels
from mmw.sensors.camera_group.objects import find_visible_objects, record_objects
from mmw.sensors.depth.capture import check_lists, record_depth
from mmw.sensors.depth.config import DepthCamera
from mmw.sensors.ground_truth.boxes_3d import Boxes, make_boxes
from mmw.sensors.render.visibility_buffer import SampleBuffer, depth_images, trace_samples
from mmw.sensors.rgb.capture import record_rgb, record_surfaces
from mmw.sensors.rgb.config import RgbCamera

TRACED_RANGE = 1.001
"""Length of rays over the range of the camera [-]: whether a surface is in range is decided by its depth alone, so that
an image does not depend on which cameras share its rays. Design value."""


def capture_cameras(
    job: Batch, cameras: Sequence[RgbCamera | DepthCamera], frames: Sequence[int], collected: TableRows
) -> None:
    """Add the images of all RGB and depth cameras, and what the same rays show.

    Raises:
        InputError: If a shard would hold more unrounded depths than a list column takes, or the scene more objects
            than an instance image.
    """
    check_lists(job, [camera for camera in cameras if isinstance(camera, DepthCamera)])
    boxes = make_boxes(job.arrays, frames, job.motion)
    for launch in make_launches(job.arrays, cameras, frames):
        for piece in launch.pieces(most_pixels(job.scene.device)):
            _record(job, piece, boxes, collected)


def _record(job: Batch, launch: Launch, boxes: Boxes, collected: TableRows) -> None:
    with job.clock.stage(launch.name, launch.pixels):
        buffer = trace_samples(
            job.scene, launch.views, launch.intrinsics, TRACED_RANGE * launch.range_m, job.alpha_cutouts
        )
    for range_m in sorted({shot.sensor.range_m for shot in launch.shots}):
        _record_range(job, launch, buffer, range_m, boxes, collected)
    if launch.rgb:
        record_rgb(job, launch, buffer, collected)
        record_surfaces(job, launch, buffer, collected)


def _record_range(
    job: Batch, launch: Launch, buffer: SampleBuffer, range_m: float, boxes: Boxes, collected: TableRows
) -> None:
    """Add depth and objects of the cameras that see as far as this."""
    shots = [shot for shot in launch.shots if shot.sensor.range_m == range_m]
    depth = [shot for shot in shots if isinstance(shot.sensor, DepthCamera)]
    objects = [shot for shot in shots if shot.sensor.segmentation or shot.sensor.boxes_2d]
    if not depth and not objects:
        return
    with job.clock.stage(launch.name):
        images = depth_images(
            buffer,
            range_m=range_m,
            with_metres=any(shot.sensor.format == "float32" for shot in depth),
            with_objects=bool(objects),
        )
    for shot in depth:
        record_depth(job, shot, launch.views, images, collected)
    if objects:
        seen = find_visible_objects(job, objects, images.object_id)
        for shot in objects:
            record_objects(job, shot, launch, seen, boxes, collected)
