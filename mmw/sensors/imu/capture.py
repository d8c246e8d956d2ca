"""Capture inertial samples of a batch."""

from collections.abc import Sequence

import numpy as np

from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns, sample_columns, split
from mmw.sensors.batch import Batch, TableRows, collect
from mmw.sensors.imu.config import Imu
from mmw.sensors.imu.simulate import ImuBatch, make_imu


def capture_imu(batch: Batch, sensors: Sequence[Imu], frames: Sequence[int], collected: TableRows) -> None:
    """Add the samples of inertial measurement units."""
    for sensor in sensors:
        with batch.clock.stage(sensor.name):
            samples = make_imu(batch.arrays, frames, sensor, batch.config.seed, batch.scenario.name)
            collect(collected, {"imu": imu_rows(batch.arrays, sensor, samples)})


def imu_rows(arrays: SceneData, sensor: Imu, imu: ImuBatch) -> Columns:
    """Return rows of the `imu` table for one sensor."""
    return {
        **sample_columns(arrays, sensor.name, imu.frame, imu.actor),
        "handedness": sensor.handedness,
        **split(("ax", "ay", "az"), imu.accel.astype(np.float32)),
        **split(("gx", "gy", "gz"), imu.gyro.astype(np.float32)),
        **split(("ax_true", "ay_true", "az_true"), imu.accel_true),
        **split(("gx_true", "gy_true", "gz_true"), imu.gyro_true),
        **split(("ax_bias", "ay_bias", "az_bias"), imu.accel_bias.astype(np.float32)),
        **split(("gx_bias", "gy_bias", "gz_bias"), imu.gyro_bias.astype(np.float32)),
        "compass": imu.compass,
    }
