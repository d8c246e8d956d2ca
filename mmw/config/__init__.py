"""The configuration: one file in, one frozen, validated object out. Units are in every name or description."""

from mmw.config.air import AirConfig
from mmw.config.antennas import AntennaConfig
from mmw.config.carla_weather import CarlaWeatherConfig
from mmw.config.channel import ChannelConfig
from mmw.config.compute import ComputeConfig
from mmw.config.lens import LensConfig
from mmw.config.links import LinkRule
from mmw.config.load import load_config
from mmw.config.material_map import MaterialChanges, MaterialEntry
from mmw.config.model import Config
from mmw.config.output import OutputConfig
from mmw.config.placed_agents import BaseStationConfig, RsuConfig, UavConfig, WaypointConfig
from mmw.config.sampling import Sampling
from mmw.config.scenario import FramesConfig, ScenarioConfig, TrafficConfig
from mmw.config.sensor import MountConfig, Mounted, SensorConfig
from mmw.config.shipped import config_path
from mmw.config.sweep import SweepConfig
from mmw.config.vary import VaryConfig, VaryRsuConfig, VarySpawnConfig
from mmw.config.yaml_file import ConfigError

__all__ = [
    "AirConfig", "AntennaConfig", "BaseStationConfig", "CarlaWeatherConfig", "ChannelConfig", "ComputeConfig",
    "Config", "ConfigError", "FramesConfig", "LensConfig", "LinkRule", "MaterialChanges", "MaterialEntry",
    "MountConfig", "Mounted", "OutputConfig", "RsuConfig", "Sampling", "ScenarioConfig", "SensorConfig",
    "SweepConfig", "TrafficConfig", "UavConfig", "VaryConfig", "VaryRsuConfig", "VarySpawnConfig", "WaypointConfig",
    "config_path", "load_config",
]  # fmt: skip
