"""Capture GNSS samples of a batch."""

from collections.abc import Sequence

from mmw.sensors.batch import Batch, TableRows, collect
from mmw.sensors.gnss.config import Gnss
from mmw.sensors.gnss.rows import gnss_rows
from mmw.sensors.gnss.simulate import make_gnss


def capture_gnss(job: Batch, sensors: Sequence[Gnss], frames: Sequence[int], collected: TableRows) -> None:
    """Add the samples of GNSS receivers."""
    for sensor in sensors:
        with job.clock.stage(sensor.name):
            samples = make_gnss(job.arrays, frames, sensor, job.config.seed, job.scenario.name)
            collect(collected, {"gnss": gnss_rows(job.arrays, sensor.name, samples)})
