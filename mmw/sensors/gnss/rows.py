"""Make rows of table `gnss`."""

import numpy as np

from mmw.scene.table_rows import Columns, split
from mmw.sensors.gnss.config import Gnss
from mmw.sensors.gnss.simulate import GnssSample
from mmw.sensors.sensor_input import SensorInput


def to_tables(data: SensorInput, config: Gnss, samples: GnssSample) -> dict[str, Columns]:
    """Return the columns of table `gnss`; frame, agent and sensor are filled in."""
    columns = {
        **split(("latitude_deg", "longitude_deg", "altitude_m"), samples.geodetic),
        **split(("latitude_true_deg", "longitude_true_deg", "altitude_true_m"), samples.geodetic_true),
        **split(("v_east", "v_north", "v_up"), samples.velocity.astype(np.float32)),
        "speed": samples.speed.astype(np.float32),
        "heading": samples.heading.astype(np.float32),
    }
    return {"gnss": columns}
