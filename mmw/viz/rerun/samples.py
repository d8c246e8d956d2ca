"""Log one sample of any sensor to Rerun: by the `viewer` view of its `SensorSpec`, else by its kind."""

import io
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
from PIL import Image

from mmw.config.sensor_spec import SensorSpec
from mmw.dataset.frame import Agent, PointCloud, sensor_spec
from mmw.dataset.sample_rows import Row
from mmw.viz.plots.bird_eye import HEIGHT_M
from mmw.viz.plots.readings import scalar_columns
from mmw.viz.plots.samples import encoded_image
from mmw.viz.plots.style import (
    INTENSITY,
    LABEL_COLORS,
    class_colors,
    object_colors,
    scale_colors,
    velocity_colors,
)  # fmt: skip
from mmw.viz.rerun.entities import reading_entity

if TYPE_CHECKING:
    from mmw.viz.rerun.frames import FrameLogger

BY_KIND = {
    "points": "mmw.viz.rerun.samples:log_points",
    "image": "mmw.viz.rerun.samples:log_image",
    "scalar": "mmw.viz.rerun.samples:log_readings",
}
"""Kind of a sensor -> view `viewer` of those that name none."""

DENSE, SPARSE = 1.5, 5.0
"""Size of points of a sweep and of detections on the screen, in Rerun's points. Design values."""

CENTIMETRES = 100.0
"""Steps of a depth image in a meter."""

DEPTH_M = 80.0
"""Depth at the end of the color scale [m]. Design value."""


def viewer_view(spec: SensorSpec) -> str:
    """Return the reference of the function that logs a sample of a sensor; empty if there is none."""
    return spec.views.get("viewer") or BY_KIND.get(spec.kind, "")


def log_lidar(log: "FrameLogger", agent: Agent, sensor: str) -> None:
    """Log a sweep in the colors of the option `lidar_color`."""
    cloud = agent.sensor(sensor)
    if cloud is not None:
        log.points(agent.name, cloud, _lidar_colors(log, agent, cloud), DENSE)


def _lidar_colors(log: "FrameLogger", agent: Agent, cloud: PointCloud) -> np.ndarray:
    """Return the color of every return, shape [N, 3], uint8."""
    if log.lidar_color == "intensity":
        return scale_colors(cloud["intensity"], *INTENSITY)
    if log.lidar_color == "label":
        return LABEL_COLORS[cloud["label"]]
    ids = cloud["object_id"]
    if log.lidar_color == "class":
        known = (ids >= 0) & (ids < len(log.tags))
        return np.where(known[:, None], class_colors(log.tags[np.where(known, ids, 0)]), 255).astype(np.uint8)
    return object_colors(ids, np.isin(ids, agent.frame.boxes["object_id"]))


def log_radar(log: "FrameLogger", agent: Agent, sensor: str) -> None:
    """Log the points of a radar, colored by radial velocity."""
    cloud = agent.sensor(sensor)
    if cloud is not None:
        log.points(agent.name, cloud, velocity_colors(cloud["velocity"]), SPARSE)


def log_points(log: "FrameLogger", agent: Agent, sensor: str) -> None:
    """Log the points of any sensor, colored by height over the agent's origin."""
    cloud = agent.sensor(sensor)
    if isinstance(cloud, PointCloud):
        log.points(agent.name, cloud, scale_colors(cloud.world[:, 2] - agent.pose[2], *HEIGHT_M), DENSE)


def log_rgb(log: "FrameLogger", agent: Agent, sensor: str) -> None:
    """Log an RGB image, its file as it is."""
    row = agent.frame.row_of("rgb", agent.name, sensor)
    if row is not None and row["image"] is not None:
        media_type = f"image/{row['format']}"
        log.image(agent, sensor, rr.EncodedImage(contents=row["image"]["bytes"], media_type=media_type))


def log_depth(log: "FrameLogger", agent: Agent, sensor: str) -> None:
    """Log a depth image in meters."""
    row = agent.frame.row_of("depth", agent.name, sensor)
    size = agent.views[sensor].camera.intrinsics
    image = None if row is None else depth_image(row, (size.height, size.width))
    if image is not None:
        log.image(agent, sensor, image)


def log_image(log: "FrameLogger", agent: Agent, sensor: str) -> None:
    """Log the first encoded image of a sample of any sensor, its file as it is."""
    _, data = encoded_image(agent, sensor)
    if data is not None:
        with Image.open(io.BytesIO(data)) as picture:
            media_type = picture.get_format_mimetype()
        log.image(agent, sensor, rr.EncodedImage(contents=data, media_type=media_type))


def log_readings(log: "FrameLogger", agent: Agent, sensor: str) -> None:
    """Log the numbers of a scalar sample as time series."""
    spec = sensor_spec(agent.sensors[sensor])
    row = agent.frame.row_of(spec.tables[0].name, agent.name, sensor)
    for column in scalar_columns(spec) if row is not None else ():
        value = row[column.name] if row is not None else None
        log.stream.log(
            reading_entity(sensor, column.name, agent.name), rr.Scalars(np.nan if value is None else float(value))
        )


def depth_image(row: Row, size: tuple[int, int]) -> rr.EncodedDepthImage | rr.DepthImage | None:
    """Return a row of table `depth` in meters, None without image: the stored PNG, or depth before rounding."""
    if row["depth_m"] is not None:
        metres = np.asarray(row["depth_m"], dtype=np.float32).reshape(size)
        return rr.DepthImage(metres, meter=1.0, depth_range=(0.0, DEPTH_M))
    if row["image"] is None:
        return None
    ends = (0.0, DEPTH_M * CENTIMETRES)
    return rr.EncodedDepthImage(row["image"]["bytes"], media_type="image/png", meter=CENTIMETRES, depth_range=ends)
