"""Rows of the tables of radar maps and of radar samples."""

import numpy as np

from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns, lists, names
from mmw.scene.views import Views
from mmw.sensors.radar.power_maps import RadarMaps


def _offsets(values: np.ndarray) -> np.ndarray:
    return (np.arange(len(values) + 1) * (values.size // max(len(values), 1))).astype(np.int32)


def radar_map_rows(arrays: SceneData, sensor: str, views: Views, maps: RadarMaps) -> Columns:
    """Return rows of the `radar_maps` table for one sensor and kind: one map a row."""
    _, rows, columns = maps.values.shape
    return {
        "frame": views.frame.astype(np.int32),
        "agent": names(arrays, views.actor),
        "sensor": sensor,
        "kind": maps.kind,
        "rows": np.full(len(views), rows, dtype=np.int32),
        "columns": np.full(len(views), columns, dtype=np.int32),
        **{
            name: np.full(len(views), getattr(maps, name))
            for name in ("row_first", "row_step", "column_first", "column_step")
        },
        "values": lists(_offsets(maps.values), maps.values.reshape(-1)),
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
        "frame": views.frame.astype(np.int32),
        "agent": names(arrays, views.actor),
        "sensor": sensor,
        **{name: np.full(len(views), size, dtype=np.int32) for name, size in sizes.items()},
        "i": lists(offsets, samples.real.reshape(-1)),
        "q": lists(offsets, samples.imag.reshape(-1)),
    }
