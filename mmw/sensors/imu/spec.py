"""Register the inertial measurement unit."""

from collections.abc import Mapping

from mmw.config.sensor_spec import Estimate, Modality, SensorSpec
from mmw.sensors.imu.config import Imu
from mmw.sensors.imu.tables import IMU

SAMPLE_BYTES = 70.0
"""Size of one sample, measured on town03 [bytes]."""


def _kernels(config: Imu, on_gpu: bool) -> Mapping[str, float]:
    return {"navigation.imu": 2} | ({"core.random_series": 2} if config.mode == "physical" else {})


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
    kernels=_kernels,
    window=Modality("imu", "numbers", ("ax", "ay", "az", "gx", "gy", "gz")),
)
