"""Simulate sensors: one package a kind, each with a `SensorSpec` that the rest of the program queries.

`__all__` lists the public names, which are loaded at their first use: configurations of sensors, the samples that they
give, and what a sensor of another package is made of.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING
from typing import Any as _Any

if TYPE_CHECKING:
    from mmw.config.sensor import MountConfig, SensorConfig
    from mmw.config.sensor_spec import SENSORS, Camera, Estimate, Modality, SensorSpec, register_sensor
    from mmw.sensors.depth.config import DepthCamera
    from mmw.sensors.depth.simulate import DepthImage
    from mmw.sensors.gnss.config import Gnss
    from mmw.sensors.gnss.error_models import GnssSample
    from mmw.sensors.gnss.ray_traced import GnssSatellites, RayTracedGnssSample
    from mmw.sensors.ground_truth.boxes_2d import Boxes2d
    from mmw.sensors.imu.config import Imu
    from mmw.sensors.imu.simulate import ImuSample
    from mmw.sensors.lidar.config import Lidar
    from mmw.sensors.lidar.points import PointCloud
    from mmw.sensors.radar.bouncing_rays import smooth_cross_section
    from mmw.sensors.radar.config import Radar
    from mmw.sensors.radar.cross_section import radar_cross_section
    from mmw.sensors.radar.points import RadarMaps, RadarPoints
    from mmw.sensors.rgb.config import RgbCamera
    from mmw.sensors.rgb.simulate import RgbImage
    from mmw.sensors.samples import PointSamples, Samples
    from mmw.sensors.sensor_input import SensorInput
    from mmw.storage.table_spec import F32, F64, I32, NAME, column, sensor_table

__all__ = [
    "F32", "F64", "I32", "NAME", "SENSORS", "Boxes2d", "Camera", "DepthCamera", "DepthImage", "Estimate", "Gnss",
    "GnssSample", "GnssSatellites", "Imu", "ImuSample", "Lidar", "Modality", "MountConfig", "PointCloud",
    "PointSamples", "Radar", "RadarMaps", "RadarPoints", "RayTracedGnssSample", "RgbCamera", "RgbImage", "Samples",
    "SensorConfig", "SensorInput", "SensorSpec", "column", "radar_cross_section", "register_sensor", "sensor_table",
    "smooth_cross_section",
]  # fmt: skip

_HOME = {
    **dict.fromkeys(("MountConfig", "SensorConfig"), "mmw.config.sensor"),
    **dict.fromkeys(
        ("SENSORS", "Camera", "Estimate", "Modality", "SensorSpec", "register_sensor"), "mmw.config.sensor_spec"
    ),
    "Boxes2d": "mmw.sensors.ground_truth.boxes_2d",
    "DepthCamera": "mmw.sensors.depth.config",
    "DepthImage": "mmw.sensors.depth.simulate",
    "Gnss": "mmw.sensors.gnss.config",
    "GnssSample": "mmw.sensors.gnss.error_models",
    **dict.fromkeys(("GnssSatellites", "RayTracedGnssSample"), "mmw.sensors.gnss.ray_traced"),
    "Imu": "mmw.sensors.imu.config",
    "ImuSample": "mmw.sensors.imu.simulate",
    "Lidar": "mmw.sensors.lidar.config",
    "PointCloud": "mmw.sensors.lidar.points",
    "Radar": "mmw.sensors.radar.config",
    "radar_cross_section": "mmw.sensors.radar.cross_section",
    "smooth_cross_section": "mmw.sensors.radar.bouncing_rays",
    **dict.fromkeys(("RadarMaps", "RadarPoints"), "mmw.sensors.radar.points"),
    "RgbCamera": "mmw.sensors.rgb.config",
    "RgbImage": "mmw.sensors.rgb.simulate",
    **dict.fromkeys(("PointSamples", "Samples"), "mmw.sensors.samples"),
    "SensorInput": "mmw.sensors.sensor_input",
    **dict.fromkeys(("F32", "F64", "I32", "NAME", "column", "sensor_table"), "mmw.storage.table_spec"),
}
"""Name -> module that defines it, so that `import mmw.sensors` stays light."""


if not TYPE_CHECKING:  # checkers of types would take any name as there

    def __getattr__(name: str) -> _Any:
        if name not in _HOME:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(_import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    loaded = {name for name in globals() if name[0] != "_"} - {"TYPE_CHECKING"}
    return sorted({*__all__, *loaded})
