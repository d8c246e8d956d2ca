"""Rows of the LiDAR table."""

import numpy as np
import pyarrow as pa

from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns, lists, names
from mmw.scene.views import Views
from mmw.sensors.ground_truth.visibility_rows import point_rows
from mmw.sensors.lidar.simulate import PointCloud
from mmw.storage.table_spec import F32, list_of

LISTS = ("x", "y", "z", "intensity", "ring", "object_id", "label", "time_offset", "return_number")
"""Columns with one value a return."""


def lidar_rows(
    arrays: SceneData, sensor: str, views: Views, points: PointCloud, flow: np.ndarray | None = None
) -> Columns:
    """Return rows of the `lidar` table for one sensor: one sweep a row.

    Args:
        arrays: The scene on the host.
        sensor: Sensor name.
        views: Its views, A rows.
        points: Its returns, N in all.
        flow: Scene flow of the returns [m], shape [3, N]; null columns if absent.
    """
    none = pa.nulls(len(views), list_of(F32))
    return {
        "frame": views.frame.astype(np.int32),
        "agent": names(arrays, views.actor),
        "sensor": sensor,
        "point_count": np.diff(points.offsets).astype(np.int32),
        **{name: lists(points.offsets, getattr(points, name)) for name in LISTS},
        **{
            f"flow_{axis}": none if flow is None else lists(points.offsets, flow[index])
            for index, axis in enumerate("xyz")
        },
    }


def seen_rows(arrays: SceneData, sensor: str, views: Views, points: PointCloud) -> Columns:
    """Return rows of `box_visibility`: how many returns lie on each actor; those of rain and fog lie on none."""
    return point_rows(arrays, sensor, views, "lidar_points", points.offsets, points.object_id)
