"""The configuration: one file in, one frozen, validated object out. Units are in every name or description."""

from mmw.config.air import AirConfig
from mmw.config.channel import ChannelConfig
from mmw.config.compute import ComputeConfig
from mmw.config.load import load_config
from mmw.config.model import Config
from mmw.config.output import OutputConfig
from mmw.config.scenario import FramesConfig, RsuConfig, ScenarioConfig, TrafficConfig
from mmw.config.sensors import SensorConfig
from mmw.config.shipped import CONFIG_HELP, config_path
from mmw.config.yaml_file import ConfigError
from mmw.sensors.base_config import MountConfig, SensorSection
from mmw.sensors.depth.config import DepthConfig
from mmw.sensors.gnss.config import GnssConfig
from mmw.sensors.imu.config import ImuConfig
from mmw.sensors.lidar.config import LidarConfig
from mmw.sensors.radar.config import RadarConfig
from mmw.sensors.rgb.config import RgbConfig

__all__ = [
    "CONFIG_HELP", "AirConfig", "ChannelConfig", "ComputeConfig", "Config", "ConfigError", "DepthConfig",
    "FramesConfig", "GnssConfig", "ImuConfig", "LidarConfig", "MountConfig", "OutputConfig", "RadarConfig", "RgbConfig",
    "RsuConfig", "ScenarioConfig", "SensorConfig", "SensorSection", "TrafficConfig", "config_path", "load_config",
]  # fmt: skip
