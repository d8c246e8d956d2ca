"""Capture object annotations of a camera, depth or RGB: segmentation, 2-D boxes, visible pixels."""

from collections.abc import Sequence
from dataclasses import dataclass

import warp as wp

from mmw.sensors.batch import Batch, TableRows, collect
from mmw.sensors.camera_group.launches import Launch, LaunchCamera, images_of
from mmw.sensors.camera_group.rows import box_2d_rows, image_rows
from mmw.sensors.ground_truth.boxes_2d import VisiblePixels, visible_pixels
from mmw.sensors.ground_truth.boxes_3d import Boxes
from mmw.sensors.ground_truth.segmentation import object_tags
from mmw.sensors.ground_truth.visibility import boxed_actors, object_ids
from mmw.sensors.ground_truth.visibility_rows import visible_rows
from mmw.storage.codecs.images import encode_instance, encode_semantic


@dataclass(frozen=True)
class VisibleObjects:
    """The objects in the images of a launch."""

    object_id: wp.array
    """Object in each pixel, -1 for nothing, shape [A, H, W], int32, on the device."""
    pixels: VisiblePixels | None
    """Pixels of the boxed actors, in the order of `boxed_actors`; None if no camera records boxes."""


def find_visible_objects(batch: Batch, cameras: Sequence[LaunchCamera], object_id: wp.array) -> VisibleObjects:
    """Return what the pixels of a launch show, counted for all cameras at once.

    Args:
        batch: The scenario and its device.
        cameras: Cameras with `segmentation` or `boxes_2d`.
        object_id: Object in each pixel, -1 for nothing, shape [A, H, W], on the device.
    """
    if not any(camera.sensor.boxes_2d for camera in cameras):
        return VisibleObjects(object_id, None)
    wanted = boxed_actors(batch.arrays.actors)
    with batch.clock.stage("2-D boxes"):
        return VisibleObjects(object_id, visible_pixels(object_id, object_ids(batch.arrays.actors)[wanted]))


def record_objects(
    batch: Batch, camera: LaunchCamera, launch: Launch, visible: VisibleObjects, boxes: Boxes, collected: TableRows
) -> None:
    """Add segmentation, 2-D boxes and visible pixels of one camera; they are the same in every weather.

    Raises:
        InputError: If the scene has more objects than an instance image can store.
    """
    sensor, views, arrays = camera.sensor, launch.views.take(camera.rows), batch.arrays
    if sensor.segmentation:
        tags = object_tags(arrays)
        with batch.clock.stage("segmentation"):
            objects = images_of(visible.object_id, camera)
        instance = [batch.encoder.submit(encode_instance, image) for image in objects]
        semantic = [batch.encoder.submit(encode_semantic, image, tags) for image in objects]
        for weather, tables in collected.items():
            files = {"instance": ("_instance", instance), "semantic": ("_semantic", semantic)}
            rows = image_rows(arrays, sensor.name, views, files, batch.scenario.name, weather)
            tables["segmentation"].append(rows)
    if sensor.boxes_2d and visible.pixels is not None:
        own = VisiblePixels(visible.pixels.pixels[camera.rows], visible.pixels.bounds[camera.rows])
        rows = batch.submit(box_2d_rows, arrays, sensor.name, views, launch.intrinsics, boxes, own)
        counts = visible_rows(arrays, sensor.name, views, "pixels", own.pixels)
        collect(collected, {"boxes_2d": rows, "box_visibility": counts})
