"""Make rows of table `gnss`."""

import numpy as np

from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns, names, split
from mmw.sensors.gnss.simulate import GnssBatch


def gnss_rows(arrays: SceneData, sensor: str, gnss: GnssBatch) -> Columns:
    """Return rows of the `gnss` table for one sensor."""
    return {
        "frame": gnss.frame.astype(np.int32),
        "agent": names(arrays, gnss.actor),
        "sensor": sensor,
        **split(("latitude_deg", "longitude_deg", "altitude_m"), gnss.geodetic),
        **split(("latitude_true_deg", "longitude_true_deg", "altitude_true_m"), gnss.geodetic_true),
        **split(("v_east", "v_north", "v_up"), gnss.velocity.astype(np.float32)),
        "speed": gnss.speed.astype(np.float32),
        "heading": gnss.heading.astype(np.float32),
    }
