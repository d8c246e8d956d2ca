"""Capture images of a batch: each pixel is traced once for color, depth, objects and all weathers."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial

from mmw.core.later import Later
from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.camera_group.launch_images import StartedImages
from mmw.sensors.camera_group.launches import Launch, make_launches, max_pixels
from mmw.sensors.camera_group.objects import record_objects
from mmw.sensors.depth.capture import check_lists, record_depth
from mmw.sensors.depth.config import DepthCamera
from mmw.sensors.ground_truth.boxes_3d import make_boxes
from mmw.sensors.rgb.capture import random_keys_of, record_rgb, record_surfaces
from mmw.sensors.rgb.config import RgbCamera


@contextmanager
def started_cameras(
    batch: Batch, cameras: Sequence[RgbCamera | DepthCamera], frames: Sequence[int], collected: TableRows
) -> Iterator[None]:
    """Add the images of all RGB and depth cameras, and what the same rays show, at the end of a `with` statement.

    A device that can work on them beside other launches starts at the beginning of the statement.

    Raises:
        InputError: If a shard would hold more unrounded depths than a list column holds, or the scene more objects
            than an instance image.
    """
    check_lists(batch, [camera for camera in cameras if isinstance(camera, DepthCamera)])
    boxes = Later(batch.pool, make_boxes, batch.arrays, frames, batch.motion)
    launches, limit = make_launches(cameras, partial(batch.views, frames)), max_pixels(batch.scene.device)
    pieces = [list(launch.pieces(limit)) for launch in launches]
    with ExitStack() as stack:
        ahead: dict[int, StartedImages] = {}
        if batch.work.runs_beside:  # further pieces of a launch take the memory of its first one, after it
            ahead = {index: stack.enter_context(_start(batch, own[0], collected)) for index, own in enumerate(pieces)}
        yield
        for index, own in enumerate(pieces):
            for piece in own:
                started = ahead.pop(index, None) or _start(batch, piece, collected)
                _record(batch, piece, started, boxes, collected)


def _start(batch: Batch, launch: Launch, weathers: Iterable[str]) -> StartedImages:
    keys = random_keys_of(batch, launch, weathers) if launch.rgb else {}
    with batch.clock.stage(launch.name, launch.pixels):
        return StartedImages(batch, launch, keys)


def _record(batch: Batch, launch: Launch, started: StartedImages, boxes: Later, collected: TableRows) -> None:
    """Add the images of a launch; `boxes` is the future of the 3-D boxes of the frames."""
    with started:
        with batch.clock.stage(launch.name):
            images = started.wait()
        for camera in launch.cameras:
            if isinstance(camera.sensor, DepthCamera):
                record_depth(batch, camera, launch.views_of(camera), images.depth[camera.sensor.range_m], collected)
            if camera.sensor.segmentation or camera.sensor.boxes_2d:
                record_objects(batch, camera, launch, images, boxes, collected)
        if launch.rgb:
            record_rgb(batch, launch, images, collected)
            record_surfaces(batch, launch, images, collected)
