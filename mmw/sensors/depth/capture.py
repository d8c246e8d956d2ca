"""Capture depth images of a batch."""

from collections.abc import Sequence

from mmw.core.errors import InputError
from mmw.kernels.camera.depth import DepthImages
from mmw.scene.views import Views, sensor_actors
from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.camera_group.launches import LaunchCamera, images_of
from mmw.sensors.camera_group.rows import image_rows, metre_lists
from mmw.sensors.depth.config import DepthCamera
from mmw.storage.codecs.images import encode_depth

MAX_LISTED = 2**31 - 1
"""Numbers that one list column of a shard holds: its offsets are 32-bit."""


def record_depth(batch: Batch, camera: LaunchCamera, views: Views, images: DepthImages, collected: TableRows) -> None:
    """Add the images of one depth camera; they are the same in every weather, so each is encoded once."""
    sensor, scenario = camera.sensor, batch.scenario.name
    is_exact = sensor.format == "float32"
    with batch.clock.stage("depth images"):
        depth = images_of(batch.work, images.depth, camera)
        metres = metre_lists(views, images_of(batch.work, images.depth_m, camera) if is_exact else None)
    encoded = [batch.encoder.submit(encode_depth, image) for image in depth]
    for weather, tables in collected.items():
        rows = image_rows(batch.arrays, sensor.name, views, {"image": ("", encoded)}, scenario, weather)
        tables["depth"].append({**rows, "depth_m": metres})


def check_lists(batch: Batch, sensors: Sequence[DepthCamera]) -> None:
    """Check that a shard's unrounded depths fit into a list column.

    Raises:
        InputError: With the camera that has too many, and how many frames fit.
    """
    for sensor in sensors:
        each = len(sensor_actors(batch.arrays, sensor)) * sensor.width_px * sensor.height_px
        frames = min(batch.config.output.shard_frames, batch.config.frames_of(batch.scenario).count)
        if sensor.format == "float32" and frames * each > MAX_LISTED:
            raise InputError(
                f"sensor {sensor.name!r}: format = float32 gives {frames * each} depths a shard; "
                f"a column holds {MAX_LISTED}; use output.shard_frames: {max(MAX_LISTED // each, 1)} or less"
            )
