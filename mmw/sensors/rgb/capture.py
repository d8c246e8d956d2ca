"""Capture RGB images of a batch, in every weather from the same rays; normals and flow, which no weather changes."""

from collections.abc import Callable, Iterable

import numpy as np
import warp as wp

from mmw.scene.views import view_keys
from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.camera_group.launch_images import LaunchImages
from mmw.sensors.camera_group.launches import Launch, images_of
from mmw.sensors.camera_group.rows import SUFFIX, Images, image_rows, rgb_columns
from mmw.sensors.rgb.config import RgbCamera
from mmw.storage.codecs.images import encode_flow, encode_normals, encode_rgb


def record_rgb(batch: Batch, launch: Launch, images: LaunchImages, collected: TableRows) -> None:
    """Add the images of the RGB cameras of a launch, which have equal settings."""
    cameras = [(camera, camera.sensor) for camera in launch.cameras if isinstance(camera.sensor, RgbCamera)]
    config = cameras[0][1]
    for weather, tables in collected.items():
        exposures, files = images.exposure.get(weather, np.zeros(0)), images.files.get(weather, ())
        if weather in images.rgb and not files:  # one weather after the other: all at once need three times the memory
            files = _encoded(batch, launch, images.rgb[weather].rgb, config)
        for camera, sensor in cameras:
            views, own = launch.views_of(camera), {"image": ("", [files[row] for row in camera.rows])}
            suffix = SUFFIX[sensor.format]
            rows = image_rows(batch.arrays, sensor.name, views, own, batch.scenario.name, weather, suffix)
            tables["rgb"].append(rows | rgb_columns(sensor, exposures[camera.rows]))


def _encoded(batch: Batch, launch: Launch, images: wp.array, config: RgbCamera) -> Images:
    """Return each view's image as a file that a thread makes."""
    with batch.clock.stage(launch.name):
        (on_host,) = batch.work.to_host([images])
    settings = config.format, config.jpeg_quality, config.jpeg_subsampling
    with batch.clock.stage("waiting for encoders"):
        return [batch.encoder.submit(encode_rgb, image, *settings) for image in on_host]


def record_surfaces(batch: Batch, launch: Launch, images: LaunchImages, collected: TableRows) -> None:
    """Add normals and flow of the RGB cameras of a launch, where their settings say so."""
    config = next(camera.sensor for camera in launch.cameras if isinstance(camera.sensor, RgbCamera))
    if config.normals:
        _record_files(batch, launch, "normals", images.normals, encode_normals, collected)
    if config.flow:
        _record_files(batch, launch, "flow", images.flow, encode_flow, collected)


def _record_files(
    batch: Batch,
    launch: Launch,
    table: str,
    images: wp.array | None,
    encode: Callable[..., bytes],
    collected: TableRows,
) -> None:
    """Add images of the RGB cameras to a table; None for no views."""
    for camera in launch.rgb:
        views = launch.views_of(camera)
        with batch.clock.stage(table):
            on_host = () if images is None else images_of(batch.work, images, camera)
        encoded = [batch.encoder.submit(encode, image) for image in on_host]
        for weather, tables in collected.items():
            files = {"image": (f"_{table}", encoded)}
            rows = image_rows(batch.arrays, camera.sensor.name, views, files, batch.scenario.name, weather)
            tables[table].append(rows)


def random_keys_of(batch: Batch, launch: Launch, weathers: Iterable[str]) -> dict[str, np.ndarray]:
    """Return the key of each view's random numbers in each weather, shape [A, 2], uint32.

    They are named after the camera, so that they do not depend on which cameras share a launch.
    """
    found = {}
    for weather in weathers:
        found[weather] = np.zeros((len(launch.views), 2), dtype=np.uint32)
        for camera in launch.rgb:
            views = launch.views_of(camera)
            found[weather][camera.rows] = view_keys(
                batch.arrays, views, batch.config.seed, batch.scenario.name, weather, camera.sensor.name
            )
    return found
