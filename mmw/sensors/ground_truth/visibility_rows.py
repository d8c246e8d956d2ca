"""Make rows of table `box_visibility`: what each sensor, and the radio, sees of each actor."""

from typing import Literal

import numpy as np
import pyarrow as pa

from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns, SensorNames, sample_columns, sensors_of
from mmw.scene.views import Views
from mmw.sensors.ground_truth.visibility import LineOfSight, boxed_actors, count_returns, object_ids

Count = Literal["lidar_points", "radar_points", "pixels"]
"""Columns that count."""

NULLS = ("lidar_points", "radar_points", "pixels", "is_los", "blocker_id")
"""Columns that are null in the rows of other kinds of sensors."""


def visible_rows(arrays: SceneData, sensor: SensorNames, views: Views, column: Count, counts: np.ndarray) -> Columns:
    """Return one row for every actor that a view has a point or pixel on.

    Args:
        arrays: The scene on the host.
        sensor: Name of the sensor of all views, or that of each.
        views: The views, A rows.
        column: Column of the counts.
        counts: Of each boxed actor, in the order of `boxed_actors`, shape [A, K], int32.
    """
    view, place = np.nonzero(counts)
    actor = boxed_actors(arrays.actors)[place]
    return {
        **sample_columns(arrays, sensors_of(sensor, view), views.frame[view], views.actor[view]),
        "object_id": object_ids(arrays.actors)[actor],
        **_nulls(len(view)),
        column: counts[view, place],
    }


def point_rows(
    arrays: SceneData, sensor: str, views: Views, column: Count, offsets: np.ndarray, object_id: np.ndarray
) -> Columns:
    """Return one row for every actor that a view has a point on.

    `offsets` is the first point of every view, and N, shape [A + 1]; `object_id` -1 for none, shape [N].
    """
    wanted = object_ids(arrays.actors)[boxed_actors(arrays.actors)].tolist()
    return visible_rows(arrays, sensor, views, column, count_returns(offsets, object_id, wanted))


def sight_rows(arrays: SceneData, sensor: str, sight: LineOfSight) -> Columns:
    """Return one row for every line of sight between an agent's antenna and another actor."""
    return {
        **sample_columns(arrays, sensor, sight.frame, sight.agent),
        "object_id": object_ids(arrays.actors)[sight.actor],
        **_nulls(len(sight.frame)),
        "is_los": sight.is_los,
        "blocker_id": pa.array(sight.blocker, mask=sight.is_los),
    }


def _nulls(count: int) -> Columns:
    return {name: pa.nulls(count) for name in NULLS}
