"""Rows of the LiDAR table, and of what LiDARs see."""

import numpy as np

from mmw.scene_arrays import SceneArrays
from mmw.sensors.boxes import BOX_ROLES, count_returns
from mmw.sensors.lidar import LidarBatch, LidarHits
from mmw.tables.rows.common import Columns, lists, names
from mmw.views import Views


def lidar_rows(arrays: SceneArrays, sensor: str, views: Views, points: LidarBatch) -> Columns:
    """Return rows of the `lidar` table for one sensor: one sweep a row."""
    return {
        "frame": views.frame.astype(np.int32),
        "agent": names(arrays, views.actor),
        "sensor": sensor,
        "point_count": np.diff(points.offsets).astype(np.int32),
        **{
            name: lists(points.offsets, getattr(points, name))
            for name in ("x", "y", "z", "intensity", "ring", "object_id")
        },
    }


def visibility_rows(arrays: SceneArrays, sensor: str, views: Views, hits: LidarHits) -> Columns:
    """Return rows of the `box_visibility` table for one LiDAR: every vehicle that a sweep has a return from."""
    vehicles = np.array([i for i, actor in enumerate(arrays.actors) if actor.role in BOX_ROLES], dtype=np.int32)
    object_id = np.array([arrays.actors[i].object_id for i in vehicles], dtype=np.int32)
    counts = count_returns(hits.offsets, hits.object_id, object_id)
    view, column = np.nonzero(counts)
    return {
        "frame": views.frame[view].astype(np.int32),
        "agent": names(arrays, views.actor[view]),
        "sensor": sensor,
        "object_id": object_id[column],
        "lidar_points": counts[view, column],
    }
