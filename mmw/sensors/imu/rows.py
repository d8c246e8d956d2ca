"""Rows of the tables of inertial and satellite sensors."""

import numpy as np

from mmw.config import Imu
from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns, names, split
from mmw.sensors.gnss.simulate import GnssBatch
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
