"""Capture RGB images of a batch, in every weather from the same rays; normals and flow, which no weather changes."""

from collections.abc import Callable, Iterable
from functools import partial

import numpy as np
import warp as wp

from mmw.core.random_keys import stream_name
from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns
from mmw.scene.views import instant_keys
from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.camera_group.launch_images import LaunchImages
from mmw.sensors.camera_group.launches import Launch, images_of
from mmw.sensors.camera_group.rows import SUFFIX, CameraViews, Images, image_rows, rgb_columns
from mmw.sensors.render.jpeg import CodedFiles
from mmw.sensors.rgb.config import RgbCamera
from mmw.storage.codecs.images import encode_flow, encode_normals, encode_rgb


def record_rgb(batch: Batch, launch: Launch, images: LaunchImages, collected: TableRows) -> None:
    """Add the images of the RGB cameras of a launch, which have equal settings."""
    config = launch.rgb_config
    assert config is not None
    for weather, tables in collected.items():
        files: Images | CodedFiles = images.files.get(weather, ())
        if weather in images.rgb and not files:  # one weather after the other: all at once need three times the memory
            files = _encoded(batch, launch, images.rgb[weather].rgb, config)
        exposure = images.exposure.get(weather, np.zeros(0))
        names = batch.scenario.name, weather
        tables["rgb"].append(batch.submit(_rows, batch.arrays, launch, files, exposure, *names))


def _rows(
    arrays: SceneData, launch: Launch, files: Images | CodedFiles, exposure: np.ndarray, scenario: str, weather: str
) -> Columns:
    """Return rows of the RGB cameras of a launch, given the files and the exposure of each view."""
    cameras, config = CameraViews.of(launch, launch.rgb), launch.rgb_config
    assert config is not None
    every = files.files() if isinstance(files, CodedFiles) else files
    own = {"image": ("", [every[row] for row in cameras.rows.tolist()])}
    rows = image_rows(arrays, cameras, own, scenario, weather, SUFFIX[config.format])
    return rows | rgb_columns(config, exposure[cameras.rows])


def _encoded(batch: Batch, launch: Launch, images: wp.array, config: RgbCamera) -> Images:
    """Return each view's image as a file that a thread makes."""
    with batch.clock.stage(launch.name):
        (on_host,) = batch.work.to_host([images])
    settings = config.format, config.jpeg_quality, config.jpeg_subsampling
    with batch.clock.stage("waiting for encoders"):
        return [batch.encoder.submit(encode_rgb, image, *settings) for image in on_host]


def record_surfaces(batch: Batch, launch: Launch, images: LaunchImages, collected: TableRows) -> None:
    """Add normals and flow of the RGB cameras of a launch, where their settings say so."""
    config = launch.rgb_config
    assert config is not None
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
        views = CameraViews.of(launch, [camera])
        with batch.clock.stage(table):
            on_host = () if images is None else images_of(batch.work, images, camera)
        encoded = [batch.encoder.submit(encode, image) for image in on_host]
        for weather, tables in collected.items():
            files = {"image": (f"_{table}", encoded)}
            tables[table].append(image_rows(batch.arrays, views, files, batch.scenario.name, weather))


def random_keys_of(batch: Batch, launch: Launch, weathers: Iterable[str]) -> dict[str, np.ndarray]:
    """Return the key of each view's random numbers in each weather, shape [A, 2], uint32.

    They are named after the camera, so that they do not depend on which cameras share a launch.
    """
    found = {}
    for weather in weathers:
        names = launch.recall(f"random streams in {weather}", partial(_streams, batch, launch, weather))
        found[weather] = instant_keys(batch.arrays, launch.views, batch.config.seed, names)
    return found


def _streams(batch: Batch, launch: Launch, weather: str) -> list[str]:
    """Return the name of the random numbers of each view: all views of a launch with RGB cameras are those of one."""
    names = [""] * len(launch.views)
    for camera in launch.rgb:
        for row in camera.rows.tolist():
            agent = batch.arrays.actors[launch.views.actor[row]].name
            names[row] = stream_name(batch.scenario.name, weather, camera.sensor.name, agent)
    return names
