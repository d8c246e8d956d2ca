"""`sensors`: what every agent carries. Defaults are the values of the paper's sensor table."""

from typing import Annotated

from pydantic import Field

from mmw.config.depth import DepthConfig
from mmw.config.gnss import GnssConfig
from mmw.config.imu import ImuConfig
from mmw.config.lidar import LidarConfig
from mmw.config.radar import RadarConfig

SensorConfig = Annotated[LidarConfig | DepthConfig | ImuConfig | RadarConfig | GnssConfig, Field(discriminator="type")]


def default_sensors() -> tuple[LidarConfig | DepthConfig | ImuConfig | RadarConfig | GnssConfig, ...]:
    """Return the paper's suite, as far as this version traces it."""
    return (LidarConfig(), DepthConfig(), ImuConfig(), GnssConfig(), RadarConfig())
