"""Rows of the radar table."""

import numpy as np
import pyarrow as pa

from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns, lists, names
from mmw.scene.views import Views
from mmw.sensors.radar.points import RadarPoints


def radar_rows(arrays: SceneData, sensor: str, views: Views, points: RadarPoints) -> Columns:
    """Return rows of the `radar` table for one sensor: one sample a row; what the mode does not know is null."""
    columns: Columns = {
        "frame": views.frame.astype(np.int32),
        "agent": names(arrays, views.actor),
        "sensor": sensor,
        "point_count": np.diff(points.offsets).astype(np.int32),
    }
    for name in (
        "range", "azimuth", "elevation", "velocity", "power_db", "snr_db", "rcs_dbsm", "object_id", "label"
    ):  # fmt: skip
        values = getattr(points, name)
        columns[name] = pa.nulls(len(views)) if values is None else lists(points.offsets, values)
    return columns
