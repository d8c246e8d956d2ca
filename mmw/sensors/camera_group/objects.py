"""Capture object annotations of a camera, depth or RGB: segmentation, 2-D boxes, visible pixels."""

from concurrent.futures import Future

from mmw.core.camera_models import Intrinsics
from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns
from mmw.scene.views import Views
from mmw.sensors.batch import Batch, TableRows, collect
from mmw.sensors.camera_group.launch_images import LaunchImages
from mmw.sensors.camera_group.launches import Launch, LaunchCamera, images_of
from mmw.sensors.camera_group.rows import box_2d_rows, image_rows
from mmw.sensors.ground_truth.boxes_2d import VisiblePixels
from mmw.sensors.ground_truth.boxes_3d import Boxes
from mmw.sensors.ground_truth.segmentation import object_tags
from mmw.sensors.ground_truth.visibility_rows import visible_rows
from mmw.storage.codecs.images import encode_instance, encode_semantic


def record_objects(
    batch: Batch, camera: LaunchCamera, launch: Launch, images: LaunchImages, boxes: Future[Boxes], collected: TableRows
) -> None:
    """Add segmentation, 2-D boxes and visible pixels of one camera; they are the same in every weather.

    Args:
        batch: The scenario.
        camera: The camera.
        launch: Its launch.
        images: Images of the launch.
        boxes: Future of the 3-D boxes of the launch's frames.
        collected: Where the rows go.

    Raises:
        InputError: If the scene has more objects than an instance image can store.
    """
    sensor, views, arrays = camera.sensor, launch.views_of(camera), batch.arrays
    if sensor.segmentation:
        tags = object_tags(arrays)
        with batch.clock.stage("segmentation"):
            objects = images_of(batch.work, images.depth[sensor.range_m].object_id, camera)
        instance = [batch.encoder.submit(encode_instance, image) for image in objects]
        semantic = [batch.encoder.submit(encode_semantic, image, tags) for image in objects]
        for weather, tables in collected.items():
            files = {"instance": ("_instance", instance), "semantic": ("_semantic", semantic)}
            rows = image_rows(arrays, sensor.name, views, files, batch.scenario.name, weather)
            tables["segmentation"].append(rows)
    if sensor.boxes_2d:
        visible = images.visible[sensor.range_m]
        own = VisiblePixels(visible.pixels[camera.rows], visible.bounds[camera.rows])
        rows = batch.submit(_box_rows, arrays, sensor.name, views, launch.intrinsics, boxes, own)
        counts = visible_rows(arrays, sensor.name, views, "pixels", own.pixels)
        collect(collected, {"boxes_2d": rows, "box_visibility": counts})


def _box_rows(
    arrays: SceneData, sensor: str, views: Views, camera: Intrinsics, boxes: Future[Boxes], visible: VisiblePixels
) -> Columns:
    return box_2d_rows(arrays, sensor, views, camera, boxes.result(), visible)
