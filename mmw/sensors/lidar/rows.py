"""Make rows of table `lidar`."""

import numpy as np
import pyarrow as pa

from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns, sample_columns
from mmw.scene.views import Views
from mmw.sensors.lidar.points import PointCloud
from mmw.storage.list_column import ListColumn
from mmw.storage.table_spec import F32, list_of

LISTS = ("x", "y", "z", "intensity", "ring", "object_id", "label", "time_offset", "return_number")
"""Columns with one value a return."""


def lidar_rows(arrays: SceneData, sensor: str, views: Views, points: PointCloud) -> Columns:
    """Return rows of the `lidar` table for one sensor: one sweep a row."""
    flow, none = points.scene_flow, pa.nulls(len(views), list_of(F32))
    return {
        **sample_columns(arrays, sensor, views.frame, views.actor),
        "point_count": np.diff(points.offsets).astype(np.int32),
        **{name: ListColumn(points.offsets, getattr(points, name)) for name in LISTS},
        **{
            f"flow_{axis}": none if flow is None else ListColumn(points.offsets, flow[:, index])
            for index, axis in enumerate("xyz")
        },
    }
