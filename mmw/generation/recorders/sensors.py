"""Which recorder belongs to which sensor."""

from collections.abc import Callable, Sequence
from typing import Any

from mmw.config import Gnss, Imu, Lidar, Radar, SensorConfig
from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.camera_group.capture import record_cameras
from mmw.sensors.imu.capture import record_gnss, record_imu
from mmw.sensors.lidar.capture import record_lidar
from mmw.sensors.radar.capture import record_radar

RECORDERS: dict[type[SensorConfig], Callable[[Batch, Any, Sequence[int], TableRows], None]] = {
    Lidar: record_lidar,
    Imu: record_imu,
    Gnss: record_gnss,
    Radar: record_radar,
}
"""Section of the configuration -> what traces it: (job, section, frames of the batch, rows to add to). Cameras share
their rays and have `record_cameras`."""


def record_sensors(job: Batch, frames: Sequence[int], collected: TableRows) -> None:
    """Trace every sensor in a batch of frames and add its rows."""
    record_cameras(job, frames, collected)
    for sensor in job.config.sensors:
        if type(sensor) in RECORDERS:
            RECORDERS[type(sensor)](job, sensor, frames, collected)
