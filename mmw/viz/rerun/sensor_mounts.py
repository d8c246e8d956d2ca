"""Log sensor mounts and camera projections once."""

from typing import Any

import rerun as rr

from mmw.config.sensor_spec import SENSORS
from mmw.core.camera_models import Intrinsics
from mmw.dataset.camera_geometry import intrinsics_from_row, pose_from_row
from mmw.dataset.sample_rows import Row
from mmw.viz.plots.paths import ANTENNA
from mmw.viz.plots.readings import scalar_columns
from mmw.viz.rerun.entities import agent_entity, reading_entity, sensor_entity
from mmw.viz.rerun.samples import viewer_view
from mmw.viz.rerun.selection import Scope

SHOWN_TABLES = ("boxes", "boxes_2d", "links", "paths", "sensors")
"""Tables without a sensor that are shown."""

AXES_M = {"agent": 2.0, "sensor": 0.4}
"""Length of the axes of an agent and of a sensor: x red, y green, z blue [m]. Design value."""

FRUSTUM_M = 2.0
"""Distance of a camera's image from the camera in the 3-D view [m]. Design value."""

NAME_M = 3.5
"""Height of an agent's name over its origin [m]. Design value."""


def sensor_rows(scope: Scope) -> list[Row]:
    """Return the rows of table `sensors` of the agents, by agent and in the configuration's order; none without it."""
    if "sensors" not in scope.data.tables:
        return []
    rows = scope.data.read("sensors", scenario=scope.scenario).to_pylist()
    names = [one["name"] for one in scope.data.info["config"]["sensors"]]
    order = {name: place for place, name in enumerate(names)}
    shown = [row for row in rows if row["agent"] in scope.agents]
    return sorted(shown, key=lambda row: (scope.agents.index(row["agent"]), order.get(row["sensor"], len(order))))


def sampled_rows(scope: Scope, rows: list[Row]) -> list[Row]:
    """Return the rows of `sensor_rows` whose samples are shown: the dataset has their table, and there is a view."""
    return [
        row for row in rows
        if row["type"] in SENSORS and viewer_view(SENSORS[row["type"]])
        and SENSORS[row["type"]].tables[0].name in scope.data.tables
    ]  # fmt: skip


def missing_tables(scope: Scope, rows: list[Row]) -> list[str]:
    """Return the tables that have no row: those of the scenario's sensors, then the others that are shown."""
    names = [SENSORS[row["type"]].tables[0].name for row in rows if row["type"] in SENSORS]
    there = {*scope.data.tables, *scope.data.views}
    return [name for name in dict.fromkeys([*names, *SHOWN_TABLES]) if name not in there]


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
    """Log axes and names of agents, mounts of sensors, cameras without distortion, and names of time series."""
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
    for row in sampled_rows(scope, rows):
        for column in reading_columns(row):
            entity = reading_entity(row["sensor"], column.name, row["agent"])
            stream.log(entity, rr.SeriesLines(names=row["agent"]), static=True)


def reading_columns(row: Row) -> tuple[Any, ...]:
    """Return the columns of the numbers of a scalar sensor, none of another kind."""
    spec = SENSORS[row["type"]]
    return scalar_columns(spec) if spec.kind == "scalar" else ()


def sensor_notes(rows: list[Row]) -> list[str]:
    """Return a line for the cameras that Rerun cannot place, and one for the sensors of unknown types."""
    bent = [f"{row['agent']} {row['sensor']}" for row in rows if row["lens"] not in (None, "pinhole")]
    unknown = sorted({str(row["type"]) for row in rows if row["type"] not in (*SENSORS, ANTENNA)})
    notes = []
    if bent:
        notes.append(
            f"{', '.join(bent)}: the lens bends; Rerun has pinholes only, so images are flat and not in the 3-D view"
        )
    if unknown:
        notes.append(
            f"{', '.join(unknown)}: no installed package provides this type of sensor; its samples are not shown"
        )
    return notes
