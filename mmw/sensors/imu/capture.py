"""Capture inertial samples of a batch."""

from collections.abc import Sequence

from mmw.sensors.batch import Batch, TableRows, collect
from mmw.sensors.imu.config import Imu
from mmw.sensors.imu.rows import imu_rows
from mmw.sensors.imu.simulate import make_imu


def capture_imu(job: Batch, sensors: Sequence[Imu], frames: Sequence[int], collected: TableRows) -> None:
    """Add the samples of inertial measurement units."""
    for sensor in sensors:
        with job.clock.stage(sensor.name):
            samples = make_imu(job.arrays, frames, sensor, job.config.seed, job.scenario.name)
            collect(collected, {"imu": imu_rows(job.arrays, sensor, samples)})
