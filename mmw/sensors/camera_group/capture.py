"""Capture images of a batch: each pixel is traced once for color, depth, objects and all weathers."""

from collections.abc import Sequence
from contextlib import ExitStack

from mmw.core.later import Later
from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.camera_group.launch_images import launch_images
from mmw.sensors.camera_group.launches import Launch, make_launches, max_pixels
from mmw.sensors.camera_group.objects import record_objects
from mmw.sensors.depth.capture import check_lists, record_depth
from mmw.sensors.depth.config import DepthCamera
from mmw.sensors.ground_truth.boxes_3d import make_boxes
from mmw.sensors.rgb.capture import random_keys_of, record_rgb, record_surfaces
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
    boxes = Later(batch.pool, make_boxes, batch.arrays, frames, batch.motion)
    for launch in make_launches(batch.arrays, cameras, frames):
        for piece in launch.pieces(max_pixels(batch.scene.device)):
            _record(batch, piece, boxes, collected)


def _record(batch: Batch, launch: Launch, boxes: Later, collected: TableRows) -> None:
    """Add the images of a launch; `boxes` is the future of the 3-D boxes of the frames."""
    keys = random_keys_of(batch, launch, collected) if launch.rgb else {}
    with ExitStack() as stack:
        with batch.clock.stage(launch.name, launch.pixels):
            images = stack.enter_context(launch_images(batch, launch, keys))
        for camera in launch.cameras:
            if isinstance(camera.sensor, DepthCamera):
                record_depth(batch, camera, launch.views, images.depth[camera.sensor.range_m], collected)
            if camera.sensor.segmentation or camera.sensor.boxes_2d:
                record_objects(batch, camera, launch, images, boxes, collected)
        if launch.rgb:
            record_rgb(batch, launch, images, collected)
            record_surfaces(batch, launch, images, collected)
