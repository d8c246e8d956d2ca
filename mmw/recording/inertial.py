"""Inertial and satellite samples of a batch."""

from collections.abc import Sequence

from mmw.config import ImuConfig
from mmw.recording.job import Job, Rows, collect
from mmw.sensors.imu import make_imu
from mmw.tables.rows.inertial import imu_rows


def record_imu(job: Job, sensor: ImuConfig, frames: Sequence[int], collected: Rows) -> None:
    """Add the samples of one IMU."""
    with job.clock.stage(sensor.name):
        samples = make_imu(job.arrays, frames, sensor, job.config.seed, job.scenario.name)
        collect(collected, {"imu": imu_rows(job.arrays, sensor.name, samples)})
