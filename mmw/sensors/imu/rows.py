"""Make rows of table `imu`."""

import numpy as np

from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns, names, split
from mmw.sensors.imu.config import Imu
from mmw.sensors.imu.simulate import ImuBatch


def imu_rows(arrays: SceneData, sensor: Imu, imu: ImuBatch) -> Columns:
    """Return rows of the `imu` table for one sensor."""
    return {
        "frame": imu.frame.astype(np.int32),
        "agent": names(arrays, imu.actor),
        "sensor": sensor.name,
        "handedness": sensor.handedness,
        **split(("ax", "ay", "az"), imu.accel.astype(np.float32)),
        **split(("gx", "gy", "gz"), imu.gyro.astype(np.float32)),
        **split(("ax_true", "ay_true", "az_true"), imu.accel_true),
        **split(("gx_true", "gy_true", "gz_true"), imu.gyro_true),
        **split(("ax_bias", "ay_bias", "az_bias"), imu.accel_bias.astype(np.float32)),
        **split(("gx_bias", "gy_bias", "gz_bias"), imu.gyro_bias.astype(np.float32)),
        "compass": imu.compass,
    }
