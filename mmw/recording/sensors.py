"""Which recorder belongs to which sensor."""

from collections.abc import Callable, Sequence
from typing import Any

from mmw.config import DepthConfig, GnssConfig, ImuConfig, LidarConfig, RadarConfig, SensorSection
from mmw.recording.images import record_depth
from mmw.recording.inertial import record_gnss, record_imu
from mmw.recording.job import Job, Rows
from mmw.recording.lidar import record_lidar
from mmw.recording.radar import record_radar

RECORDERS: dict[type[SensorSection], Callable[[Job, Any, Sequence[int], Rows], None]] = {
    LidarConfig: record_lidar,
    DepthConfig: record_depth,
    ImuConfig: record_imu,
    GnssConfig: record_gnss,
    RadarConfig: record_radar,
}
"""Section of the configuration -> what traces it: (job, section, frames of the batch, rows to add to)."""


def record_sensor(job: Job, sensor: SensorSection, frames: Sequence[int], collected: Rows) -> None:
    """Trace one sensor in a batch of frames and add its rows."""
    RECORDERS[type(sensor)](job, sensor, frames, collected)
