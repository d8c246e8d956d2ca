"""Capture depth images of a batch."""

from collections.abc import Sequence

import numpy as np

from mmw.core.errors import InputError
from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns
from mmw.scene.views import sensor_actors
from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.camera_group.launch_images import LaunchImages
from mmw.sensors.camera_group.launches import Launch, LaunchCamera, images_of
from mmw.sensors.camera_group.rows import CameraViews, Images, image_rows, metre_lists
from mmw.sensors.depth.config import DepthCamera
from mmw.storage.codecs.images import encode_depth

MAX_LISTED = 2**31 - 1
"""Numbers that one list column of a shard holds: its offsets are 32-bit."""


def record_depth(batch: Batch, launch: Launch, images: LaunchImages, collected: TableRows) -> None:
    """Add the images of the depth cameras of a launch; they are the same in every weather, so each is encoded once."""
    for place, camera in enumerate(launch.cameras):
        if isinstance(camera.sensor, DepthCamera):
            _record(batch, launch, camera, images, images.depth_cm.get(place, ()), collected)


def _record(
    batch: Batch,
    launch: Launch,
    camera: LaunchCamera,
    images: LaunchImages,
    depth_cm: Sequence[np.ndarray] | np.ndarray,
    collected: TableRows,
) -> None:
    metres = None
    if camera.sensor.format == "float32":
        with batch.clock.stage("depth images"):
            metres = images_of(batch.work, images.depth[camera.sensor.range_m].depth_m, camera)
    encoded = [batch.encoder.submit(encode_depth, image) for image in depth_cm]
    for weather, tables in collected.items():
        names = batch.scenario.name, weather
        tables["depth"].append(batch.submit(_rows, batch.arrays, launch, camera, encoded, metres, *names))


def _rows(
    arrays: SceneData,
    launch: Launch,
    camera: LaunchCamera,
    encoded: Images,
    metres: np.ndarray | None,
    scenario: str,
    weather: str,
) -> Columns:
    views = CameraViews.of(launch, [camera])
    rows = image_rows(arrays, views, {"image": ("", encoded)}, scenario, weather)
    return {**rows, "depth_m": metre_lists(views.views, metres)}


def check_lists(batch: Batch, sensors: Sequence[DepthCamera]) -> None:
    """Check that a shard's unrounded depths fit into a list column.

    Raises:
        InputError: With the camera that has too many, and how many frames fit.
    """
    for sensor in sensors:
        if sensor.format != "float32":
            continue
        each = len(sensor_actors(batch.arrays, sensor)) * sensor.width_px * sensor.height_px
        frames = min(batch.config.output.shard_frames, batch.config.frames_of(batch.scenario).count)
        if frames * each > MAX_LISTED:
            raise InputError(
                f"sensor {sensor.name!r}: format = float32 gives {frames * each} depths a shard; "
                f"a column holds {MAX_LISTED}; use output.shard_frames: {max(MAX_LISTED // each, 1)} or less"
            )
