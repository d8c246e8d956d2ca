"""Write the sensors of an agent as prims, so that a USD viewer can look through its cameras."""

import json
from collections.abc import Sequence

import numpy as np
from pxr import Gf, Sdf

from mmw.config import SensorConfig
from mmw.config.agent_keys import AgentIdentity
from mmw.config.antennas import AntennaConfig
from mmw.config.sensor_spec import Camera, spec_of
from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.transforms import compose
from mmw.scene.mounted_antennas import antenna_pose
from mmw.scene.stage.layer import define, place
from mmw.scene.views import mount_pose
from mmw.usd.prim_specs import set_value

SENSOR_TO_CAMERA = np.array([0.0, 0.0, 0.0, 0.5, -0.5, -0.5, 0.5])
"""USD camera (x right, y up, looking along -z) to sensor (x forward, y left, z up), as a pose."""

APERTURE_MM = 20.955
"""Horizontal aperture of a camera prim [mm]: USD's own default. Only its ratio to the focal length matters."""


def write_sensors(
    layer: Sdf.Layer,
    agent_path: str,
    agent: AgentIdentity,
    sensors: Sequence[SensorConfig],
    antennas: Sequence[AntennaConfig],
    frame_rate_hz: int = FRAME_RATE_HZ,
) -> None:
    """Write `Sensors` below an agent: a Camera for each camera, an Xform for everything else.

    Args:
        layer: The layer.
        agent_path: The agent's prim.
        agent: Role, name, model and class; sensors that the agent does not carry are left out.
        sensors: The configured sensors.
        antennas: The configured antennas.
        frame_rate_hz: Frames a second, the rate of a sensor that has none of its own.
    """
    define(layer, f"{agent_path}/Sensors", "Scope")
    for sensor in sensors:
        if not sensor.is_on(*agent):
            continue
        pose = mount_pose(sensor, *agent)
        path = f"{agent_path}/Sensors/{prim_name(sensor.name)}"
        if (projection := spec_of(sensor).camera) is not None:
            prim = define(layer, path, "Camera")
            place(prim, compose(pose, SENSOR_TO_CAMERA))
            _lens(prim, projection(sensor))
        else:
            prim = define(layer, path)
            place(prim, pose)
        set_value(prim, "mmw:sensor:type", Sdf.ValueTypeNames.Token, sensor.type)
        settings = json.dumps(
            sensor.with_rate(frame_rate_hz).model_dump(mode="json", exclude={"mount", "on"}), sort_keys=True
        )
        set_value(prim, "mmw:sensor:config", Sdf.ValueTypeNames.String, settings)
    for antenna in antennas:
        if antenna.is_on(*agent):
            prim = define(layer, f"{agent_path}/Sensors/{prim_name(antenna.name)}")
            place(prim, antenna_pose(antenna, *agent))
            set_value(prim, "mmw:sensor:type", Sdf.ValueTypeNames.Token, "antenna")
            settings = json.dumps(antenna.model_dump(mode="json", exclude={"name", "mount", "on"}), sort_keys=True)
            set_value(prim, "mmw:sensor:config", Sdf.ValueTypeNames.String, settings)


def prim_name(name: str) -> str:
    """Return a sensor's name as a prim name: `-`, which USD does not allow, becomes `_`."""
    return name.replace("-", "_")


def _lens(prim: Sdf.PrimSpec, projection: Camera) -> None:
    """Write the camera as a pinhole: a USD camera has no distortion."""
    camera = projection.intrinsics
    kind = Sdf.ValueTypeNames
    set_value(prim, "focalLength", kind.Float, APERTURE_MM * camera.fx / camera.width)
    set_value(prim, "horizontalAperture", kind.Float, APERTURE_MM)
    set_value(prim, "verticalAperture", kind.Float, APERTURE_MM * camera.height / camera.width * camera.fx / camera.fy)
    offset = APERTURE_MM / camera.width
    if camera.cx != 0.5 * camera.width or camera.cy != 0.5 * camera.height:
        set_value(prim, "horizontalApertureOffset", kind.Float, offset * (0.5 * camera.width - camera.cx))
        down = offset * camera.fx / camera.fy
        set_value(prim, "verticalApertureOffset", kind.Float, down * (camera.cy - 0.5 * camera.height))
    set_value(prim, "clippingRange", kind.Float2, Gf.Vec2f(0.01, projection.range_m))
