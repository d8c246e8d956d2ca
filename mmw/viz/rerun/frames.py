"""One frame of a dataset as Rerun shows it: agents, point clouds, images and boxes."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import rerun as rr

from mmw.core.transforms import quaternion_from_ypr
from mmw.dataset.frame import Frame, PointCloud, Row
from mmw.viz.rerun import colors
from mmw.viz.rerun.entities import BOXES, agent_entity, sensor_entity
from mmw.viz.rerun.selection import Scope
from mmw.viz.rerun.sensors import ShownCamera

LIDAR_COLORS = ("object", "class", "intensity", "label")
"""Coloring of LiDAR points: by the object that they lie on, its class, the intensity, or the source of the return
(surface, rain, fog)."""

LIDAR_POINTS, RADAR_POINTS = 1.5, 5.0
"""Size of points on the screen, in Rerun's points. Design values."""

INTENSITY = (0.0, 0.5)
"""Intensity at the ends of the scale [-]; few returns are brighter. Design value."""

CENTIMETRES = 100.0
"""Steps of a depth image in a metre."""

DEPTH_M = 80.0
"""Depth at the end of the colour scale [m]. Design value."""


@dataclass
class FramePainter:
    """Logs frames one after the other; the stream's time is set by who calls."""

    stream: rr.RecordingStream
    scope: Scope
    cameras: list[ShownCamera]
    tags: np.ndarray
    """CARLA's number of the class of each object, shape [objects], uint8."""
    lidar_color: str
    """One of `LIDAR_COLORS`."""
    _there: set[str] = field(default_factory=set)

    def paint(self, frame: Frame) -> None:
        """Log one frame; an agent that has left is cleared."""
        boxes = frame.boxes
        there = set()
        for name in self.scope.agents:
            agent = frame.agents.get(name)
            if agent is None:
                continue
            there.add(name)
            pose = rr.Transform3D(translation=agent.pose[:3], quaternion=rr.Quaternion(xyzw=agent.pose[3:]))
            self.stream.log(agent_entity(name), pose)
            for sensor, cloud in agent.sweeps.items():
                self._log_points(name, sensor, cloud, self._lidar_colors(cloud, boxes["object_id"]), LIDAR_POINTS)
            for sensor, cloud in agent.radars.items():
                self._log_points(name, sensor, cloud, colors.of_velocity(cloud["velocity"]), RADAR_POINTS)
        for name in self._there - there:
            self.stream.log(agent_entity(name), rr.Clear(recursive=True))
        self._there = there
        if "boxes" in self.scope.data.tables:
            self.stream.log(BOXES, box_shapes(boxes.columns))
        for camera in self.cameras:
            if camera.agent in there:
                self._log_image(frame, camera)

    def _log_points(self, agent: str, sensor: str, cloud: PointCloud, rgb: np.ndarray, size: float) -> None:
        shape = rr.Points3D(cloud.points, colors=rgb, radii=rr.Radius.ui_points(size))
        self.stream.log(sensor_entity(agent, sensor), shape)

    def _lidar_colors(self, cloud: PointCloud, actors: np.ndarray) -> np.ndarray:
        """Return the colour of every return, shape [N, 3], uint8."""
        if self.lidar_color == "intensity":
            return colors.scale(cloud["intensity"], *INTENSITY)
        if self.lidar_color == "label":
            return colors.RETURNS[cloud["label"]]
        ids = cloud["object_id"]
        if self.lidar_color == "class":
            known = (ids >= 0) & (ids < len(self.tags))
            return np.where(known[:, None], colors.of_tags(self.tags[np.where(known, ids, 0)]), 255).astype(np.uint8)
        return colors.of_objects(ids, np.isin(ids, actors))

    def _log_image(self, frame: Frame, camera: ShownCamera) -> None:
        row = frame.row_of(camera.type, camera.agent, camera.sensor)
        if row is None:
            return  # not every frame has one: the last stays
        image = rgb_image(row) if camera.type == "rgb" else depth_image(row, camera.size)
        if image is not None:
            self.stream.log(f"{camera.entity}/{camera.type}", image)
        if "boxes_2d" in self.scope.data.tables:
            found = [r for r in frame.rows("boxes_2d") if (r["agent"], r["sensor"]) == (camera.agent, camera.sensor)]
            self.stream.log(f"{camera.entity}/boxes_2d", flat_boxes(found))


def rgb_image(row: Row) -> rr.EncodedImage | None:
    """Return a row of table `rgb` as Rerun takes it, its file as it is; None if it holds no image."""
    if row["image"] is None:
        return None
    return rr.EncodedImage(contents=row["image"]["bytes"], media_type=f"image/{row['format']}")


def depth_image(row: Row, size: tuple[int, int]) -> rr.EncodedDepthImage | rr.DepthImage | None:
    """Return a row of table `depth` in metres: the stored PNG as it is, or the depth before rounding where it is kept.

    Args:
        row: Row of table `depth`; None is returned if it holds no image.
        size: Height and width [px].
    """
    if row["depth_m"] is not None:
        metres = np.asarray(row["depth_m"], dtype=np.float32).reshape(size)
        return rr.DepthImage(metres, meter=1.0, depth_range=(0.0, DEPTH_M))
    if row["image"] is None:
        return None
    ends = (0.0, DEPTH_M * CENTIMETRES)
    return rr.EncodedDepthImage(row["image"]["bytes"], media_type="image/png", meter=CENTIMETRES, depth_range=ends)


def box_shapes(columns: Mapping[str, np.ndarray]) -> rr.Boxes3D:
    """Return the boxes of a frame: colours of their objects, class and name as label."""
    size = np.stack([columns[name] for name in ("length", "width", "height")], axis=1).astype(np.float64)
    turn = quaternion_from_ypr(*(np.asarray(columns[name], dtype=np.float64) for name in ("yaw", "pitch", "roll")))
    ids = np.asarray(columns["object_id"])
    labels = [
        f"{category} {agent or ''} #{thing}".replace("  ", " ")
        for category, agent, thing in zip(columns["category"], columns["agent"], ids, strict=True)
    ]
    return rr.Boxes3D(
        centers=np.stack([columns[axis] for axis in "xyz"], axis=1),
        half_sizes=size / 2.0,
        quaternions=turn.reshape(-1, 4),
        colors=colors.of_objects(ids, np.ones(len(ids), dtype=bool)),
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
        colors=colors.of_objects(ids, np.ones(len(ids), dtype=bool)),
        labels=[f"#{thing}" for thing in ids],
        show_labels=False,
    )
