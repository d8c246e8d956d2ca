"""Make rows of table `lidar`."""

import pyarrow as pa

from mmw.core.remember import remembered
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
    flow, offsets = points.scene_flow, points.offsets
    return {
        **sample_columns(arrays, sensor, views.frame, views.actor),
        "point_count": offsets[1:] - offsets[:-1],
        **{name: ListColumn(offsets, getattr(points, name)) for name in LISTS},
        **{
            f"flow_{axis}": _nulls(len(views)) if flow is None else ListColumn(offsets, flow[:, index])
            for index, axis in enumerate("xyz")
        },
    }


@remembered(owners=0)
def _nulls(count: int) -> pa.Array:
    return pa.nulls(count, list_of(F32))
