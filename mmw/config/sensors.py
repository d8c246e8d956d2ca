"""`sensors`: what every agent carries. Defaults are the values of the paper's sensor table."""

from typing import Annotated

from pydantic import Field

from mmw.sensors.depth.config import DepthConfig
from mmw.sensors.gnss.config import GnssConfig
from mmw.sensors.imu.config import ImuConfig
from mmw.sensors.lidar.config import LidarConfig
from mmw.sensors.radar.config import RadarConfig
from mmw.sensors.rgb.config import RgbConfig, paper_cameras

SensorConfig = Annotated[
    LidarConfig | RgbConfig | DepthConfig | ImuConfig | RadarConfig | GnssConfig, Field(discriminator="type")
]


def default_sensors() -> tuple[LidarConfig | RgbConfig | DepthConfig | ImuConfig | RadarConfig | GnssConfig, ...]:
    """Return the paper's suite."""
    return (LidarConfig(), DepthConfig(), ImuConfig(), GnssConfig(), RadarConfig(), *paper_cameras())
