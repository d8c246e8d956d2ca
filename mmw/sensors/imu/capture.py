"""Inertial and satellite samples of a batch."""

from collections.abc import Sequence

from mmw.config import Gnss, Imu
from mmw.sensors.batch import Batch, TableRows, collect
from mmw.sensors.gnss.simulate import make_gnss
from mmw.sensors.imu.rows import gnss_rows, imu_rows
from mmw.sensors.imu.simulate import make_imu


def record_imu(job: Batch, sensor: Imu, frames: Sequence[int], collected: TableRows) -> None:
    """Add the samples of one IMU."""
    with job.clock.stage(sensor.name):
        samples = make_imu(job.arrays, frames, sensor, job.config.seed, job.scenario.name)
        collect(collected, {"imu": imu_rows(job.arrays, sensor, samples)})


def record_gnss(job: Batch, sensor: Gnss, frames: Sequence[int], collected: TableRows) -> None:
    """Add the samples of one satellite navigation receiver."""
    with job.clock.stage(sensor.name):
        samples = make_gnss(job.arrays, frames, sensor, job.config.seed, job.scenario.name)
        collect(collected, {"gnss": gnss_rows(job.arrays, sensor.name, samples)})
