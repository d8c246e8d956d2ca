"""Log sensor mounts and camera projections once."""

from dataclasses import dataclass

import rerun as rr

from mmw.core.camera_models import Intrinsics
from mmw.dataset.camera_geometry import intrinsics_from_row, pose_from_row
from mmw.dataset.frame import Row
from mmw.viz.rerun.entities import agent_entity, sensor_entity
from mmw.viz.rerun.selection import Scope

SHOWN_TYPES = ("lidar", "radar", "rgb", "depth", "antenna")
"""Types of sensors that have something to show; an IMU and a GNSS have not."""

AXES_M = {"agent": 2.0, "sensor": 0.4}
"""Length of the axes of an agent and of a sensor: x red, y green, z blue [m]. Design value."""

FRUSTUM_M = 2.0
"""Distance of a camera's image from the camera in the 3-D view [m]. Design value."""

NAME_M = 3.5
"""Height of an agent's name over its origin [m]. Design value."""


@dataclass(frozen=True)
class ShownCamera:
    """A camera whose images are shown."""

    agent: str
    sensor: str
    type: str
    """`rgb` or `depth`."""
    has_pinhole: bool
    """Whether Rerun can project into it: its lens does not bend."""
    size: tuple[int, int]
    """Height and width of its images [px]."""

    @property
    def entity(self) -> str:
        """Entity of the camera; its image is `rgb` or `depth` under it."""
        return sensor_entity(self.agent, self.sensor)


def sensor_rows(scope: Scope) -> list[Row]:
    """Return the rows of table `sensors` that are shown, by agent and in the configuration's order; none without it."""
    if "sensors" not in scope.data.tables:
        return []
    rows = scope.data.read("sensors", scenario=scope.scenario).to_pylist()
    names = [one["name"] for one in scope.data.info["config"]["sensors"]]
    order = {name: place for place, name in enumerate(names)}
    shown = [row for row in rows if row["agent"] in scope.agents and row["type"] in SHOWN_TYPES]
    return sorted(shown, key=lambda row: (scope.agents.index(row["agent"]), order.get(row["sensor"], len(order))))


def shown_cameras(scope: Scope, rows: list[Row]) -> list[ShownCamera]:
    """Return the cameras whose table the dataset has."""
    return [
        ShownCamera(
            row["agent"], row["sensor"], row["type"], row["lens"] == "pinhole", (int(row["height"]), int(row["width"]))
        )
        for row in rows
        if row["fx"] is not None and row["type"] in scope.data.tables
    ]


def pinhole(camera: Intrinsics) -> rr.Pinhole:
    """Return Rerun's camera: x along the optical axis, y left, z up, columns to the right and rows down [px].

    Rerun's pixel (0, 0) reaches from 0 to 1 in both, as ours does.
    """
    return rr.Pinhole(
        focal_length=(float(camera.fx), float(camera.fy)),
        principal_point=(float(camera.cx), float(camera.cy)),
        width=int(camera.width),
        height=int(camera.height),
        camera_xyz=rr.ViewCoordinates.FLU,
        image_plane_distance=FRUSTUM_M,
    )


def log_sensors(stream: rr.RecordingStream, scope: Scope, rows: list[Row]) -> None:
    """Log axes and names of agents, mounts of sensors and cameras without distortion."""
    for agent in scope.agents:
        stream.log(agent_entity(agent), rr.TransformAxes3D(AXES_M["agent"]), static=True)
        name = rr.Points3D([(0.0, 0.0, NAME_M)], radii=0.02, colors=(255, 255, 255), labels=[agent], show_labels=True)
        stream.log(f"{agent_entity(agent)}/name", name, static=True)
    for row in rows:
        pose, entity = pose_from_row(row), sensor_entity(row["agent"], row["sensor"])
        mount = rr.Transform3D(translation=pose[:3], quaternion=rr.Quaternion(xyzw=pose[3:]))
        stream.log(entity, mount, rr.TransformAxes3D(AXES_M["sensor"]), static=True)
        if row["fx"] is not None and row["lens"] == "pinhole":
            stream.log(entity, pinhole(intrinsics_from_row(row)), static=True)


def lens_notes(cameras: list[ShownCamera]) -> list[str]:
    """Return a line for the cameras that Rerun cannot place."""
    bent = [f"{camera.agent} {camera.sensor}" for camera in cameras if not camera.has_pinhole]
    if not bent:
        return []
    return [f"{', '.join(bent)}: the lens bends; Rerun knows pinholes only, so images are flat and not in the 3-D view"]
