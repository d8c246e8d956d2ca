"""`sensors`: what every agent carries. Defaults are the values of the paper's sensor table."""

from typing import Annotated

from pydantic import Field

from mmw.config.depth import DepthConfig
from mmw.config.gnss import GnssConfig
from mmw.config.imu import ImuConfig
from mmw.config.lidar import LidarConfig
from mmw.config.radar import RadarConfig
from mmw.config.rgb import RgbConfig, paper_cameras

SensorConfig = Annotated[
    LidarConfig | RgbConfig | DepthConfig | ImuConfig | RadarConfig | GnssConfig, Field(discriminator="type")
]


def default_sensors() -> tuple[LidarConfig | RgbConfig | DepthConfig | ImuConfig | RadarConfig | GnssConfig, ...]:
    """Return the paper's suite."""
    return (LidarConfig(), DepthConfig(), ImuConfig(), GnssConfig(), RadarConfig(), *paper_cameras())
