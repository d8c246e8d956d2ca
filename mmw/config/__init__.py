"""The configuration: one file in, one frozen, validated object out. Units are in every name or description."""

from mmw.config.channel import ChannelConfig
from mmw.config.compute import ComputeConfig
from mmw.config.depth import DepthConfig
from mmw.config.gnss import GnssConfig
from mmw.config.imu import ImuConfig
from mmw.config.lidar import LidarConfig
from mmw.config.load import load_config
from mmw.config.model import Config
from mmw.config.output import OutputConfig
from mmw.config.radar import RadarConfig
from mmw.config.rgb import RgbConfig
from mmw.config.scenario import FramesConfig, RsuConfig, ScenarioConfig, TrafficConfig
from mmw.config.sensor import MountConfig, SensorSection
from mmw.config.sensors import SensorConfig
from mmw.config.shipped import CONFIG_HELP, config_path
from mmw.config.weather import AirConfig
from mmw.config.yaml_file import ConfigError

__all__ = [
    "CONFIG_HELP", "AirConfig", "ChannelConfig", "ComputeConfig", "Config", "ConfigError", "DepthConfig",
    "FramesConfig", "GnssConfig", "ImuConfig", "LidarConfig", "MountConfig", "OutputConfig", "RadarConfig", "RgbConfig",
    "RsuConfig", "ScenarioConfig", "SensorConfig", "SensorSection", "TrafficConfig", "config_path", "load_config",
]  # fmt: skip
