"""Make rows of tables `gnss` and `gnss_satellites`."""

import numpy as np
import pyarrow as pa

from mmw.scene.table_rows import Columns, sample_columns, split
from mmw.sensors.gnss.config import Gnss
from mmw.sensors.gnss.error_models import GnssSample
from mmw.sensors.gnss.ray_traced import RayTracedGnssSample
from mmw.sensors.sensor_input import SensorInput

FLOATS = ("cn0_db_hz", "pseudorange_error", "multipath_error")
"""Columns of satellites that are NaN where they are not known."""


def to_tables(data: SensorInput, config: Gnss, samples: GnssSample) -> dict[str, Columns]:
    """Return the columns of table `gnss`, and in mode `ray_traced` of `gnss_satellites`.

    Frame, agent and sensor are filled in, but for the rows of mode `ray_traced`, which are not those of the views.
    """
    columns = {
        **split(("latitude_deg", "longitude_deg", "altitude_m"), samples.geodetic),
        **split(("latitude_true_deg", "longitude_true_deg", "altitude_true_m"), samples.geodetic_true),
        **split(("v_east", "v_north", "v_up"), samples.velocity.astype(np.float32)),
        "speed": samples.speed.astype(np.float32),
        "heading": samples.heading.astype(np.float32),
    }
    if not isinstance(samples, RayTracedGnssSample):
        return {"gnss": columns}
    fixed = np.flatnonzero(samples.has_fix)
    found = samples.satellites
    return {
        "gnss": {**_key(data, config, fixed), **{name: values[fixed] for name, values in columns.items()}},
        "gnss_satellites": {
            **_key(data, config, np.repeat(np.arange(len(data.views)), np.diff(found.offsets))),
            "satellite": found.satellite.astype(str).tolist(),
            **{name: getattr(found, name).astype(np.float32) for name in ("azimuth", "elevation")},
            **{name: _or_null(getattr(found, name).astype(np.float32)) for name in FLOATS},
            "pseudorange": _or_null(found.pseudorange),
            "is_los": found.is_los,
            "is_tracked": found.is_tracked,
        },
    }


def _key(data: SensorInput, config: Gnss, row: np.ndarray) -> Columns:
    """Return frame, agent and sensor of rows of the views."""
    return sample_columns(data.scene.arrays, config.name, data.views.frame[row], data.views.actor[row])


def _or_null(values: np.ndarray) -> pa.Array:
    """Return numbers with nulls in place of NaN."""
    return pa.array(values, mask=np.isnan(values))
