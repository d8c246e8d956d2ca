"""Capture images of a batch: each pixel is traced once for color, depth, objects and all weathers."""

from collections.abc import Sequence

from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.camera_group.launches import Launch, make_launches, max_pixels, trace_launch
from mmw.sensors.camera_group.objects import find_visible_objects, record_objects
from mmw.sensors.depth.capture import check_lists, record_depth
from mmw.sensors.depth.config import DepthCamera
from mmw.sensors.ground_truth.boxes_3d import Boxes, make_boxes
from mmw.sensors.render.visibility_buffer import SampleBuffer, depth_images
from mmw.sensors.rgb.capture import record_rgb, record_surfaces
from mmw.sensors.rgb.config import RgbCamera


def capture_cameras(
    batch: Batch, cameras: Sequence[RgbCamera | DepthCamera], frames: Sequence[int], collected: TableRows
) -> None:
    """Add the images of all RGB and depth cameras, and what the same rays show.

    Raises:
        InputError: If a shard would hold more unrounded depths than a list column holds, or the scene more objects
            than an instance image.
    """
    check_lists(batch, [camera for camera in cameras if isinstance(camera, DepthCamera)])
    boxes = make_boxes(batch.arrays, frames, batch.motion)
    for launch in make_launches(batch.arrays, cameras, frames):
        for piece in launch.pieces(max_pixels(batch.scene.device)):
            _record(batch, piece, boxes, collected)


def _record(batch: Batch, launch: Launch, boxes: Boxes, collected: TableRows) -> None:
    with batch.clock.stage(launch.name, launch.pixels):
        buffer = trace_launch(batch.scene.optical, launch, batch.alpha_cutouts)
    for range_m in sorted({camera.sensor.range_m for camera in launch.cameras}):
        _record_range(batch, launch, buffer, range_m, boxes, collected)
    if launch.rgb:
        record_rgb(batch, launch, buffer, collected)
        record_surfaces(batch, launch, buffer, collected)


def _record_range(
    batch: Batch, launch: Launch, buffer: SampleBuffer, range_m: float, boxes: Boxes, collected: TableRows
) -> None:
    """Add depth and objects of the cameras that see as far as this."""
    cameras = [camera for camera in launch.cameras if camera.sensor.range_m == range_m]
    depth = [camera for camera in cameras if isinstance(camera.sensor, DepthCamera)]
    objects = [camera for camera in cameras if camera.sensor.segmentation or camera.sensor.boxes_2d]
    if not depth and not objects:
        return
    with batch.clock.stage(launch.name):
        images = depth_images(
            buffer,
            range_m=range_m,
            with_metres=any(camera.sensor.format == "float32" for camera in depth),
            with_objects=bool(objects),
        )
    for camera in depth:
        record_depth(batch, camera, launch.views, images, collected)
    if objects:
        visible = find_visible_objects(batch, objects, images.object_id)
        for camera in objects:
            record_objects(batch, camera, launch, visible, boxes, collected)
