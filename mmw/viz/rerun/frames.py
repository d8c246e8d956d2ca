"""Log one frame of a dataset to Rerun: agents, samples of their sensors and boxes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import rerun as rr

from mmw.core.registry import load_reference
from mmw.core.transforms import quaternion_from_ypr
from mmw.dataset.frame import Agent, Frame, PointCloud, sensor_spec
from mmw.dataset.sample_rows import Row
from mmw.viz.plots.style import object_colors
from mmw.viz.rerun.entities import BOXES, agent_entity, sensor_entity
from mmw.viz.rerun.samples import viewer_view
from mmw.viz.rerun.selection import Scope

LIDAR_COLORS = ("object", "class", "intensity", "label")
"""Quantities that LiDAR points can be colored by: the object that they lie on, its class, the intensity, or whether a
surface, rain or fog returned them."""


@dataclass
class FrameLogger:
    """Logs frames one after the other; the caller sets the stream's time."""

    stream: rr.RecordingStream
    scope: Scope
    sensors: Sequence[Row]
    """Rows of table `sensors` whose samples are shown."""
    tags: np.ndarray
    """CARLA's number of the class of each object, shape [objects], uint8."""
    lidar_color: str
    """One of `LIDAR_COLORS`."""
    _present: set[str] = field(default_factory=set)

    def log(self, frame: Frame) -> None:
        """Log one frame; an agent that has left is cleared."""
        present = set()
        for name in self.scope.agents:
            agent = frame.agents.get(name)
            if agent is None:
                continue
            present.add(name)
            pose = rr.Transform3D(translation=agent.pose[:3], quaternion=rr.Quaternion(xyzw=agent.pose[3:]))
            self.stream.log(agent_entity(name), pose)
            for row in self.sensors:
                if row["agent"] == name:
                    load_reference(viewer_view(sensor_spec(row)))(self, agent, row["sensor"])
        for name in self._present - present:
            self.stream.log(agent_entity(name), rr.Clear(recursive=True))
        self._present = present
        if "boxes" in self.scope.data.tables:
            self.stream.log(BOXES, box_shapes(frame.boxes.columns))

    def points(self, agent: str, cloud: PointCloud, colors: np.ndarray, size: float) -> None:
        """Log a point cloud of an agent, colors of shape [N, 3], uint8, and size in Rerun's points."""
        shape = rr.Points3D(cloud.points, colors=colors, radii=rr.Radius.ui_points(size))
        self.stream.log(sensor_entity(agent, cloud.sensor), shape)

    def image(self, agent: Agent, sensor: str, image: Any) -> None:
        """Log an image of a sensor as Rerun's archetype, with the rectangles of table `boxes_2d`."""
        entity = sensor_entity(agent.name, sensor)
        self.stream.log(f"{entity}/{agent.sensors[sensor]['type']}", image)
        if "boxes_2d" in self.scope.data.tables:
            rows = agent.frame.rows("boxes_2d")
            found = [row for row in rows if (row["agent"], row["sensor"]) == (agent.name, sensor)]
            self.stream.log(f"{entity}/boxes_2d", flat_boxes(found))


def box_shapes(columns: Mapping[str, np.ndarray]) -> rr.Boxes3D:
    """Return the boxes of a frame: colors of their objects, class and name as label."""
    size = np.stack([columns[name] for name in ("length", "width", "height")], axis=1).astype(np.float64)
    turn = quaternion_from_ypr(*(np.asarray(columns[name], dtype=np.float64) for name in ("yaw", "pitch", "roll")))
    ids = np.asarray(columns["object_id"])
    labels = [
        f"{category} {agent or ''} #{number}".replace("  ", " ")
        for category, agent, number in zip(columns["category"], columns["agent"], ids, strict=True)
    ]
    return rr.Boxes3D(
        centers=np.stack([columns[axis] for axis in "xyz"], axis=1),
        half_sizes=size / 2.0,
        quaternions=turn.reshape(-1, 4),
        colors=object_colors(ids),
        labels=labels,
        show_labels=False,
        radii=rr.Radius.ui_points(1.0),
    )


def flat_boxes(rows: list[Row]) -> rr.Boxes2D:
    """Return the rectangles around the visible pixels of actors in an image; none of what no pixel shows."""
    seen = [row for row in rows if row["u_min"] is not None]
    edges = np.array([[row[name] for name in ("u_min", "v_min", "u_max", "v_max")] for row in seen], dtype=np.float64)
    edges, ids = edges.reshape(-1, 4), np.array([row["object_id"] for row in seen], dtype=np.int64)
    return rr.Boxes2D(
        mins=edges[:, :2],
        sizes=edges[:, 2:] - edges[:, :2],
        colors=object_colors(ids),
        labels=[f"#{number}" for number in ids],
        show_labels=False,
    )
