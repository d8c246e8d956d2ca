"""Which recorder belongs to which sensor."""

from collections.abc import Callable, Sequence
from typing import Any

from mmw.config import GnssConfig, ImuConfig, LidarConfig, RadarConfig, SensorSection
from mmw.sensors.batch import Job, Rows
from mmw.sensors.camera_group.capture import record_cameras
from mmw.sensors.imu.capture import record_gnss, record_imu
from mmw.sensors.lidar.capture import record_lidar
from mmw.sensors.radar.capture import record_radar

RECORDERS: dict[type[SensorSection], Callable[[Job, Any, Sequence[int], Rows], None]] = {
    LidarConfig: record_lidar,
    ImuConfig: record_imu,
    GnssConfig: record_gnss,
    RadarConfig: record_radar,
}
"""Section of the configuration -> what traces it: (job, section, frames of the batch, rows to add to). Cameras share
their rays and have `record_cameras`."""


def record_sensors(job: Job, frames: Sequence[int], collected: Rows) -> None:
    """Trace every sensor in a batch of frames and add its rows."""
    record_cameras(job, frames, collected)
    for sensor in job.config.sensors:
        if type(sensor) in RECORDERS:
            RECORDERS[type(sensor)](job, sensor, frames, collected)
