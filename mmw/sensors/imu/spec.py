"""Register the inertial measurement unit."""

from mmw.config.sensor_spec import Estimate, Modality, SensorSpec
from mmw.sensors.imu.config import Imu
from mmw.sensors.imu.tables import IMU

SAMPLE_BYTES = 70.0
"""Size of one sample, measured on town03 [bytes]."""

SPEC = SensorSpec(
    type="imu",
    title="IMU",
    kind="scalar",
    config=Imu,
    tables=(IMU,),
    simulate="mmw.sensors.imu.simulate:simulate",
    to_tables="mmw.sensors.imu.rows:to_tables",
    estimate=lambda config: Estimate(bytes=SAMPLE_BYTES),
    defaults=lambda: (Imu(),),
    window=Modality("imu", "numbers", ("ax", "ay", "az", "gx", "gy", "gz")),
)
