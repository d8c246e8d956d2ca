"""`sensors`: what every agent carries. Defaults are the values of the paper's sensor table."""

from typing import Annotated

from pydantic import Field

from mmw.sensors.depth.config import DepthCamera
from mmw.sensors.gnss.config import Gnss
from mmw.sensors.imu.config import Imu
from mmw.sensors.lidar.config import Lidar
from mmw.sensors.radar.config import Radar
from mmw.sensors.rgb.config import RgbCamera, paper_cameras

AnySensor = Annotated[Lidar | RgbCamera | DepthCamera | Imu | Radar | Gnss, Field(discriminator="type")]


def default_sensors() -> tuple[Lidar | RgbCamera | DepthCamera | Imu | Radar | Gnss, ...]:
    """Return the paper's suite."""
    return (Lidar(), DepthCamera(), Imu(), Gnss(), Radar(), *paper_cameras())
