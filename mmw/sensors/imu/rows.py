"""Make rows of table `imu`."""

import numpy as np

from mmw.scene.table_rows import Columns, split
from mmw.sensors.imu.config import Imu
from mmw.sensors.imu.simulate import ImuSample
from mmw.sensors.sensor_input import SensorInput


def to_tables(data: SensorInput, config: Imu, samples: ImuSample) -> dict[str, Columns]:
    """Return the columns of table `imu`; frame, agent and sensor are filled in."""
    columns = {
        "handedness": config.handedness,
        **split(("ax", "ay", "az"), samples.accel.astype(np.float32)),
        **split(("gx", "gy", "gz"), samples.gyro.astype(np.float32)),
        **split(("ax_true", "ay_true", "az_true"), samples.accel_true),
        **split(("gx_true", "gy_true", "gz_true"), samples.gyro_true),
        **split(("ax_bias", "ay_bias", "az_bias"), samples.accel_bias.astype(np.float32)),
        **split(("gx_bias", "gy_bias", "gz_bias"), samples.gyro_bias.astype(np.float32)),
        "compass": samples.compass,
    }
    return {"imu": columns}
