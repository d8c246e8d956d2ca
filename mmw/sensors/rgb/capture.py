"""Capture RGB images of a batch, in every weather from the same rays; normals and flow, which no weather changes."""

from collections.abc import Callable

import numpy as np
import warp as wp

from mmw.core.transfer import to_host
from mmw.scene.views import view_keys
from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.camera_group.launches import Launch, images_of
from mmw.sensors.camera_group.rows import SUFFIX, Images, image_rows, rgb_columns
from mmw.sensors.render.jpeg import jpeg_files
from mmw.sensors.render.visibility_buffer import SampleBuffer
from mmw.sensors.rgb.config import RgbCamera
from mmw.sensors.rgb.simulate import RgbImages
from mmw.storage.codecs.images import encode_flow, encode_normals, encode_rgb


def record_rgb(batch: Batch, launch: Launch, buffer: SampleBuffer, collected: TableRows) -> None:
    """Add the images of the RGB cameras of a launch, which have equal settings."""
    cameras = [(camera, camera.sensor) for camera in launch.cameras if isinstance(camera.sensor, RgbCamera)]
    found: dict[str, RgbImages] = {}
    exposures: dict[str, np.ndarray] = dict.fromkeys(collected, np.zeros(0))
    files: dict[str, Images] = dict.fromkeys(collected, ())
    config = cameras[0][1]
    if len(launch.views):
        with batch.clock.stage(launch.name):
            keys = {weather: _keys(batch, launch, weather) for weather in collected}
            found = batch.rgb_camera(config.debug).render(buffer, config, keys, batch.motion)
            exposures = dict(zip(found, to_host([images.exposure for images in found.values()]), strict=True))
        if config.format == "jpeg" and makes_files(batch.scene.device):
            with batch.clock.stage("JPEG files"):
                rgb = [images.rgb for images in found.values()]
                files = dict(zip(found, jpeg_files(rgb, config.jpeg_quality, config.jpeg_subsampling), strict=True))
    for weather, tables in collected.items():
        if found and not files[weather]:  # one weather after the other: all at once need three times the memory
            files[weather] = _encoded(batch, launch, found[weather].rgb, config)
        for camera, sensor in cameras:
            views, own = launch.views.take(camera.rows), {"image": ("", [files[weather][row] for row in camera.rows])}
            suffix = SUFFIX[sensor.format]
            rows = image_rows(batch.arrays, sensor.name, views, own, batch.scenario.name, weather, suffix)
            tables["rgb"].append(rows | rgb_columns(sensor, exposures[weather][camera.rows]))


def _encoded(batch: Batch, launch: Launch, images: wp.array, config: RgbCamera) -> Images:
    """Return each view's image as a file that a thread makes."""
    with batch.clock.stage(launch.name):
        (on_host,) = to_host([images])
    settings = config.format, config.jpeg_quality, config.jpeg_subsampling
    with batch.clock.stage("waiting for encoders"):
        return [batch.encoder.submit(encode_rgb, image, *settings) for image in on_host]


def makes_files(device: str) -> bool:
    """Return whether a device makes JPEG files itself: a GPU, many at a time, rather than the cores beside it."""
    return wp.get_device(device).is_cuda


def record_surfaces(batch: Batch, launch: Launch, buffer: SampleBuffer, collected: TableRows) -> None:
    """Add normals and flow of the RGB cameras of a launch, where their settings say so."""
    config = next(camera.sensor for camera in launch.cameras if isinstance(camera.sensor, RgbCamera))
    renderer = batch.rgb_camera(config.debug)
    if config.normals:
        with batch.clock.stage("normals"):
            images = renderer.normals(buffer)
        _record_files(batch, launch, "normals", images, encode_normals, collected)
    if config.flow:
        with batch.clock.stage("flow"):
            images = renderer.flow(buffer, batch.motion)
        _record_files(batch, launch, "flow", images, encode_flow, collected)


def _record_files(
    batch: Batch, launch: Launch, table: str, images: wp.array, encode: Callable[..., bytes], collected: TableRows
) -> None:
    for camera in launch.rgb:
        views = launch.views.take(camera.rows)
        encoded = [batch.encoder.submit(encode, image) for image in images_of(images, camera)]
        for weather, tables in collected.items():
            files = {"image": (f"_{table}", encoded)}
            rows = image_rows(batch.arrays, camera.sensor.name, views, files, batch.scenario.name, weather)
            tables[table].append(rows)


def _keys(batch: Batch, launch: Launch, weather: str) -> np.ndarray:
    """Return the key of each view's random numbers in one weather, shape [A, 2], uint32.

    They are named after the camera, so that they do not depend on which cameras share a launch.
    """
    keys = np.zeros((len(launch.views), 2), dtype=np.uint32)
    for camera in launch.rgb:
        views = launch.views.take(camera.rows)
        keys[camera.rows] = view_keys(
            batch.arrays, views, batch.config.seed, batch.scenario.name, weather, camera.sensor.name
        )
    return keys
