"""Capture object annotations of cameras, depth or RGB: segmentation, 2-D boxes, visible pixels."""

import numpy as np

from mmw.core.camera_models import Intrinsics
from mmw.core.later import Waiting
from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns
from mmw.sensors.batch import Batch, TableRows, collect
from mmw.sensors.camera_group.launch_images import LaunchImages
from mmw.sensors.camera_group.launches import Launch, LaunchCamera, images_of
from mmw.sensors.camera_group.rows import CameraViews, box_2d_rows, image_rows
from mmw.sensors.ground_truth.boxes_2d import VisiblePixels
from mmw.sensors.ground_truth.segmentation import object_tags
from mmw.sensors.ground_truth.visibility_rows import visible_rows
from mmw.storage.codecs.images import encode_instance, encode_semantic


def record_segmentation(batch: Batch, launch: Launch, images: LaunchImages, collected: TableRows) -> None:
    """Add instance and semantic images of the cameras of a launch; they are the same in every weather.

    Raises:
        InputError: If the scene has more objects than an instance image can store.
    """
    for camera in launch.cameras:
        if camera.sensor.segmentation:
            tags = object_tags(batch.arrays)
            with batch.clock.stage("segmentation"):
                objects = images_of(batch.work, images.depth[camera.sensor.range_m].object_id, camera)
            instance = [batch.encoder.submit(encode_instance, image) for image in objects]
            semantic = [batch.encoder.submit(encode_semantic, image, tags) for image in objects]
            files = {"instance": ("_instance", instance), "semantic": ("_semantic", semantic)}
            views = CameraViews.of(launch, [camera])
            for weather, tables in collected.items():
                tables["segmentation"].append(image_rows(batch.arrays, views, files, batch.scenario.name, weather))


def record_boxes(batch: Batch, launch: Launch, images: LaunchImages, boxes: Waiting, collected: TableRows) -> None:
    """Add 2-D boxes and visible pixels of the cameras of a launch; they are the same in every weather.

    Args:
        batch: The scenario.
        launch: The launch.
        images: Its images.
        boxes: Future of the 3-D boxes of the launch's frames.
        collected: Where the rows go.
    """
    for range_m, visible in images.visible.items():
        own = [one for one in launch.cameras if one.sensor.boxes_2d and one.sensor.range_m == range_m]
        found = batch.arrays, launch, own, visible
        rows = batch.submit(_box_rows, *found, launch.intrinsics, boxes)
        collect(collected, {"boxes_2d": rows, "box_visibility": batch.submit(_pixel_rows, *found)})


def _box_rows(
    arrays: SceneData,
    launch: Launch,
    cameras: list[LaunchCamera],
    visible: list[np.ndarray],
    intrinsics: Intrinsics,
    boxes: Waiting,
) -> Columns:
    views = CameraViews.of(launch, cameras)
    own = VisiblePixels.of(*(values[views.rows] for values in visible))
    return box_2d_rows(arrays, views.sensors, views.views, intrinsics, boxes.result(), own)


def _pixel_rows(arrays: SceneData, launch: Launch, cameras: list[LaunchCamera], visible: list[np.ndarray]) -> Columns:
    views = CameraViews.of(launch, cameras)
    return visible_rows(arrays, views.sensors, views.views, "pixels", visible[0][views.rows])
