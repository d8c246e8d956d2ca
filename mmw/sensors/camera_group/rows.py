"""Make rows of the tables of images and of 2-D boxes."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from mmw.core.camera_models import Intrinsics
from mmw.core.later import Waiting
from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns, SensorNames, choices, sample_columns, sensors_of
from mmw.scene.views import Views
from mmw.sensors.camera_group.launches import Launch, LaunchCamera
from mmw.sensors.ground_truth.boxes_2d import VisiblePixels, image_boxes
from mmw.sensors.ground_truth.boxes_3d import Boxes
from mmw.sensors.ground_truth.tables import EDGES
from mmw.sensors.render.tone_mapping import SATURATION
from mmw.sensors.rgb.config import RgbCamera
from mmw.storage.list_column import ListColumn
from mmw.storage.name_column import NameColumn
from mmw.storage.table_spec import F32, list_of

Images = Sequence[Waiting | bytes]
"""One encoded image a view, which a thread may still be at."""

SUFFIX = {"jpeg": "jpg", "png": "png"}
"""Format -> end of a file's name."""


@dataclass(frozen=True)
class CameraViews:
    """Views of some cameras of a launch, one camera after the other, A of them."""

    rows: np.ndarray
    """Their rows among the views of the launch, shape [A]."""
    views: Views
    sensors: NameColumn
    """Name of the camera of each."""

    @classmethod
    def of(cls, launch: Launch, cameras: Sequence[LaunchCamera]) -> "CameraViews":
        """Return the views of at least one camera."""
        rows = np.concatenate([camera.rows for camera in cameras])
        code = np.repeat(np.arange(len(cameras), dtype=np.int32), [len(camera.rows) for camera in cameras])
        return cls(rows, launch.views.take(rows), choices([camera.sensor.name for camera in cameras], code))


def image_rows(
    arrays: SceneData,
    cameras: CameraViews,
    files: Mapping[str, tuple[str, Images]],
    scenario: str,
    weather: str,
    suffix: str = "png",
) -> Columns:
    """Return rows of a table of encoded images: one view a row.

    Args:
        arrays: The scene on the host.
        cameras: The views.
        files: Column -> what follows the name of the sensor in the names of the files, and the files of the views.
        scenario: Name of the scenario.
        weather: Name of the weather.
        suffix: End of the names of the files.
    """
    views = cameras.views
    shared = sample_columns(arrays, cameras.sensors, views.frame, views.actor)
    agents, sensors = shared["agent"].to_list(), cameras.sensors.to_list()
    stems = [
        f"{scenario}/{weather}/{agent}/{frame:06d}_{sensor}"
        for agent, frame, sensor in zip(agents, arrays.numbers(views.frame).tolist(), sensors, strict=True)
    ]
    return {
        **shared,
        **{
            column: [(image, f"{stem}{kind}.{suffix}") for image, stem in zip(images, stems, strict=True)]
            for column, (kind, images) in files.items()
        },
    }


def rgb_columns(sensor: RgbCamera, exposure: np.ndarray) -> Columns:
    """Return the columns of table `rgb` beside the images.

    `exposure` is the factor from luminance [kcd/m2] to display linear, where 1 is white, shape [A].
    """
    return {
        "format": sensor.format,
        "exposure": exposure.astype(np.float32),
        "ev100": np.log2(1000.0 / (SATURATION * exposure.astype(np.float64))).astype(np.float32),
    }


def metre_lists(views: Views, depth_m: np.ndarray | None) -> pa.Array | ListColumn:
    """Return the `depth_m` column: one list of depths [m] a row, 0 for no return; null in every row without images.

    `depth_m` has inf for no return, shape [A, H, W], float32.
    """
    if depth_m is None:
        return pa.nulls(len(views), list_of(F32))
    flat = np.where(np.isfinite(depth_m), depth_m, np.float32(0.0)).reshape(len(views), math.prod(depth_m.shape[1:]))
    return ListColumn(np.arange(len(views) + 1, dtype=np.int32) * np.int32(flat.shape[1]), flat.reshape(-1))


def box_2d_rows(
    arrays: SceneData, sensor: SensorNames, views: Views, camera: Intrinsics, boxes: Boxes, visible: VisiblePixels
) -> Columns:
    """Return rows of the `boxes_2d` table for cameras of one projection.

    Args:
        arrays: The scene on the host.
        sensor: Name of the camera of all views, or that of each.
        views: The views, A rows.
        camera: Intrinsics.
        boxes: 3-D boxes of their frames.
        visible: Pixels of the actors in the order of `boxed_actors`.
    """
    found = image_boxes(arrays, views, camera, boxes, visible)
    view = np.repeat(np.arange(len(views)), np.diff(found.offsets))
    return {
        **sample_columns(arrays, sensors_of(sensor, view), views.frame[view], views.actor[view]),
        "object_id": found.object_id,
        "pixels": found.pixels,
        **{name: pa.array(found.bounds[:, i], mask=found.pixels == 0) for i, name in enumerate(EDGES)},
        **{f"amodal_{name}": np.ascontiguousarray(found.amodal[:, i]) for i, name in enumerate(EDGES)},
        "truncation": found.truncation,
        "distance": found.distance,
    }
