"""Capture images of a batch: each pixel is traced once for color, depth, objects and all weathers."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager

import numpy as np

from mmw.core.later import Later
from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.camera_group.launch_images import StartedImages
from mmw.sensors.camera_group.launches import KeptLaunches, Launch, max_pixels
from mmw.sensors.camera_group.objects import record_boxes, record_segmentation
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
        ValueError: If the frames are not loaded.
    """
    check_lists(batch, [camera for camera in cameras if isinstance(camera, DepthCamera)])
    if batch.scene.batch_frames != tuple(frames):
        batch.scene.check_loaded("view", np.arange(len(frames)), np.asarray(frames))
    kept: KeptLaunches = batch.cache.setdefault("launches of cameras", KeptLaunches())
    parts = [batch.views(frames, camera) for camera in cameras]
    pieces = kept.pieces(cameras, parts, max_pixels(batch.scene.device))
    with ExitStack() as stack:
        ahead: dict[int, StartedImages] = {}
        if batch.work.runs_beside:  # further pieces of a launch take the memory of its first one, after it
            ahead = {index: stack.enter_context(_start(batch, own[0], collected)) for index, own in enumerate(pieces)}
        yield
        boxes = Later(batch.pool, make_boxes, batch.arrays, frames, batch.motion)
        for index, own in enumerate(pieces):
            for piece in own:
                started = ahead.pop(index, None) or _start(batch, piece, collected)
                _record(batch, piece, started, boxes, collected)


def _start(batch: Batch, launch: Launch, weathers: Iterable[str]) -> StartedImages:
    with batch.clock.stage(launch.name, launch.pixels):
        return StartedImages(batch, launch, random_keys_of(batch, launch, weathers) if launch.rgb else {})


def _record(batch: Batch, launch: Launch, started: StartedImages, boxes: Later, collected: TableRows) -> None:
    """Add the images of a launch; `boxes` is the future of the 3-D boxes of the frames."""
    with started:
        with batch.clock.stage(launch.name):
            images = started.wait()
        record_depth(batch, launch, images, collected)
        record_segmentation(batch, launch, images, collected)
        record_boxes(batch, launch, images, boxes, collected)
        if launch.rgb:
            record_rgb(batch, launch, images, collected)
            record_surfaces(batch, launch, images, collected)
