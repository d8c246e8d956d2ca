"""Rows of the tables of inertial and satellite sensors."""

import numpy as np

from mmw.scene_arrays import SceneArrays
from mmw.sensors.imu import ImuBatch
from mmw.tables.rows.common import Columns, names, split


def imu_rows(arrays: SceneArrays, sensor: str, imu: ImuBatch) -> Columns:
    """Return rows of the `imu` table for one sensor."""
    return {
        "frame": imu.frame.astype(np.int32),
        "agent": names(arrays, imu.actor),
        "sensor": sensor,
        **split(("ax", "ay", "az"), imu.accel.astype(np.float32)),
        **split(("gx", "gy", "gz"), imu.gyro.astype(np.float32)),
        **split(("ax_true", "ay_true", "az_true"), imu.accel_true),
        **split(("gx_true", "gy_true", "gz_true"), imu.gyro_true),
    }
