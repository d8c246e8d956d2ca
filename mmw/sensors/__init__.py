"""Simulate sensors: one package a kind, each with a `SensorSpec` that the rest of the program queries.

The names below are loaded when they are first used, so that `import mmw.sensors` stays light.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mmw.config.sensor import MountConfig, SensorConfig
    from mmw.config.sensor_spec import SENSORS, Camera, Estimate, Modality, SensorSpec, register_sensor
    from mmw.sensors.depth.config import DepthCamera
    from mmw.sensors.gnss.config import Gnss
    from mmw.sensors.imu.config import Imu
    from mmw.sensors.lidar.config import Lidar
    from mmw.sensors.radar.config import Radar
    from mmw.sensors.rgb.config import RgbCamera
    from mmw.sensors.sensor_input import SensorInput
    from mmw.storage.table_spec import F32, F64, I32, NAME, column, sensor_table

__all__ = [
    "F32", "F64", "I32", "NAME", "SENSORS", "Camera", "DepthCamera", "Estimate", "Gnss", "Imu", "Lidar", "Modality",
    "MountConfig", "Radar", "RgbCamera", "SensorConfig", "SensorInput", "SensorSpec", "column", "register_sensor",
    "sensor_table",
]  # fmt: skip

_HOME = {
    **dict.fromkeys(("MountConfig", "SensorConfig"), "mmw.config.sensor"),
    **dict.fromkeys(
        ("SENSORS", "Camera", "Estimate", "Modality", "SensorSpec", "register_sensor"), "mmw.config.sensor_spec"
    ),
    "DepthCamera": "mmw.sensors.depth.config",
    "Gnss": "mmw.sensors.gnss.config",
    "Imu": "mmw.sensors.imu.config",
    "Lidar": "mmw.sensors.lidar.config",
    "Radar": "mmw.sensors.radar.config",
    "RgbCamera": "mmw.sensors.rgb.config",
    "SensorInput": "mmw.sensors.sensor_input",
    **dict.fromkeys(("F32", "F64", "I32", "NAME", "column", "sensor_table"), "mmw.storage.table_spec"),
}
"""Name -> module that defines it."""


if not TYPE_CHECKING:  # checkers of types would take any name as there

    def __getattr__(name: str) -> Any:
        if name not in _HOME:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])
