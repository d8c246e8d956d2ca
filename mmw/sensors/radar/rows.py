"""Make rows of the tables of radar points, maps and samples."""

import numpy as np
import pyarrow as pa

from mmw.core.remember import remembered
from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns, sample_columns
from mmw.scene.views import Views
from mmw.sensors.radar.points import RadarMaps, RadarPoints
from mmw.storage.list_column import ListColumn


def radar_rows(arrays: SceneData, sensor: str, views: Views, points: RadarPoints) -> Columns:
    """Return rows of the `radar` table for one sensor: one sample a row; what the mode does not have is null."""
    columns: Columns = {
        **sample_columns(arrays, sensor, views.frame, views.actor),
        "point_count": points.offsets[1:] - points.offsets[:-1],
    }
    for name in (
        "range", "azimuth", "elevation", "velocity", "power_db", "snr_db", "rcs_dbsm", "object_id", "label",
        "path_type",
    ):  # fmt: skip
        values = getattr(points, name)
        columns[name] = _nulls(len(views)) if values is None else ListColumn(points.offsets, values)
    return columns


@remembered(owners=0)
def _nulls(count: int) -> pa.Array:
    return pa.nulls(count)


def _offsets(values: np.ndarray) -> np.ndarray:
    return (np.arange(len(values) + 1) * (values.size // max(len(values), 1))).astype(np.int32)


def radar_map_rows(arrays: SceneData, sensor: str, views: Views, maps: RadarMaps) -> Columns:
    """Return rows of the `radar_maps` table for one sensor and kind: one map a row."""
    _, rows, columns = maps.values.shape
    return {
        **sample_columns(arrays, sensor, views.frame, views.actor),
        "kind": maps.kind,
        "rows": np.full(len(views), rows, dtype=np.int32),
        "columns": np.full(len(views), columns, dtype=np.int32),
        **{
            name: np.full(len(views), getattr(maps, name))
            for name in ("row_first", "row_step", "column_first", "column_step")
        },
        "values": ListColumn(_offsets(maps.values), maps.values.reshape(-1)),
    }


def radar_iq_rows(arrays: SceneData, sensor: str, views: Views, samples: np.ndarray) -> Columns:
    """Return rows of the `radar_iq` table for one sensor: one sweep a row.

    Args:
        arrays: The scene on the host.
        sensor: Name of the sensor.
        views: Its views, A rows.
        samples: Samples [W^0.5], shape [A, antennas, chirps, samples], complex64.
    """
    sizes = dict(zip(("antennas", "chirps", "samples"), samples.shape[1:], strict=True))
    offsets = _offsets(samples)
    return {
        **sample_columns(arrays, sensor, views.frame, views.actor),
        **{name: np.full(len(views), size, dtype=np.int32) for name, size in sizes.items()},
        "i": ListColumn(offsets, samples.real.reshape(-1)),
        "q": ListColumn(offsets, samples.imag.reshape(-1)),
    }
