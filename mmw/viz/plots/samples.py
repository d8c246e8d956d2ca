"""Draw one sample of any sensor on matplotlib axes: by the `plot` view of its `SensorSpec`, else by its kind."""

import io
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from PIL import Image

from mmw.config.sensor_spec import SENSORS, SensorSpec
from mmw.core.errors import InputError
from mmw.core.registry import load_reference
from mmw.dataset.frame import Agent, PointCloud, sensor_spec
from mmw.storage.schemas import column_text
from mmw.storage.table_spec import IMAGE
from mmw.viz.plots.bird_eye import draw_lidar, draw_points, draw_radar
from mmw.viz.plots.images import draw_camera, draw_depth

BY_KIND = {
    "points": "mmw.viz.plots.samples:draw_points_sample",
    "image": "mmw.viz.plots.samples:draw_image_sample",
}
"""Kind of a sensor -> view `plot` of those that name none; scalars are drawn over time, by `mmw.viz.plots.readings`."""

LIDAR_SCALES = {"intensity": "intensity", "height": "height above the agent's origin [m]"}
"""Color of a sweep -> label of its color bar."""


@dataclass(frozen=True)
class SampleStyle:
    """Options of drawing a sample."""

    color: str = "intensity"
    """Quantity that LiDAR points are colored by, see `draw_lidar`."""
    boxes: str = "seen"
    """Boxes on images, see `draw_camera`; with `none` the views from above have none too."""
    extent_m: float = 60.0
    """Half of the width of views from above [m]."""


@dataclass(frozen=True)
class SamplePlot:
    """Result of drawing a sample."""

    scale: Any = None
    """Mappable for a color bar."""
    scale_label: str = ""
    note: str = ""
    """Size of the sample, for a title."""
    legend: str = ""
    """Meaning of the colors, for a caption."""
    box_kinds: set[str] = field(default_factory=set)
    """Kinds of the boxes drawn, keys of `BOX_STYLES`."""


def plot_view(spec: SensorSpec) -> str:
    """Return the reference of the function that draws a sample of a sensor; empty if there is none."""
    return spec.views.get("plot") or BY_KIND.get(spec.kind, "")


def drawn_types() -> list[str]:
    """Return the types of sensors whose samples can be drawn: photographs, other images, points."""
    found = [name for name, spec in SENSORS.items() if plot_view(spec)]
    return sorted(found, key=lambda name: (SENSORS[name].kind != "image", not SENSORS[name].needs_appearance))


def has_sample(agent: Agent, sensor: str) -> bool:
    """Return whether a sensor has a row in the frame."""
    if sensor not in agent.sensors:
        return False
    spec = sensor_spec(agent.sensors[sensor])
    return agent.frame.row_of(spec.tables[0].name, agent.name, sensor) is not None


def draw_sample(axes: Any, agent: Agent, sensor: str, style: SampleStyle | None = None) -> SamplePlot:
    """Draw one sample of a sensor.

    Args:
        axes: matplotlib axes to draw on.
        agent: From `frame.agents`.
        sensor: One of its sensors.
        style: Options.

    Raises:
        InputError: If the sensor has no sample in the frame, or one that cannot be drawn.
    """
    reference = plot_view(sensor_spec(agent.sensors[sensor]))
    if not reference:
        raise InputError(f"sensor {sensor!r}: its samples are not drawn; give its SensorSpec a view `plot`")
    return load_reference(reference)(axes, agent, sensor, style or SampleStyle())


def draw_rgb_sample(axes: Any, agent: Agent, sensor: str, style: SampleStyle) -> SamplePlot:
    """Draw an RGB image and boxes."""
    return SamplePlot(box_kinds=draw_camera(axes, agent.views[sensor], boxes=style.boxes))


def draw_depth_sample(axes: Any, agent: Agent, sensor: str, style: SampleStyle) -> SamplePlot:
    """Draw a depth image and boxes."""
    shown = draw_depth(axes, agent.views[sensor], boxes=style.boxes)
    return SamplePlot(shown, "depth along the optical axis [m]", legend="near is bright, white is nothing")


def draw_lidar_sample(axes: Any, agent: Agent, sensor: str, style: SampleStyle) -> SamplePlot:
    """Draw a sweep from above."""
    shown = draw_lidar(
        axes, agent, sensor, color=style.color, extent_m=style.extent_m, boxes=style.boxes != "none"
    )  # fmt: skip
    note, legend = f"{len(agent.sweeps[sensor]):,} returns", "bright is a strong return"
    return SamplePlot(shown, LIDAR_SCALES.get(style.color, style.color), note, legend)


def draw_radar_sample(axes: Any, agent: Agent, sensor: str, style: SampleStyle) -> SamplePlot:
    """Draw a radar sample from above."""
    shown = draw_radar(axes, agent, sensor, extent_m=style.extent_m, boxes=style.boxes != "none")
    note, legend = f"{len(agent.radars[sensor]):,} points", "blue approaches, red recedes, gray is what LiDAR sees"
    return SamplePlot(shown, "radial velocity, + receding [m/s]", note, legend)


def draw_points_sample(axes: Any, agent: Agent, sensor: str, style: SampleStyle) -> SamplePlot:
    """Draw points of any sensor from above, colored by height.

    Raises:
        InputError: If the sample is no `PointCloud`.
    """
    cloud = agent.sensor(sensor)
    if not isinstance(cloud, PointCloud):
        raise InputError(
            f"sensor {sensor!r} of {agent.name}: its sample is a {type(cloud).__name__}; points have the lists x, y, z "
            "or range, azimuth, elevation; name a view `plot` in its SensorSpec"
        )
    shown = draw_points(axes, agent, cloud, extent_m=style.extent_m, boxes=style.boxes != "none")
    return SamplePlot(shown, LIDAR_SCALES["height"], f"{len(cloud):,} points", "bright is high")


def draw_image_sample(axes: Any, agent: Agent, sensor: str, style: SampleStyle) -> SamplePlot:
    """Draw the first encoded image of a sample; one of a single channel gets a color scale."""
    column, data = encoded_image(agent, sensor)
    if data is None:
        raise InputError(f"sensor {sensor!r} of {agent.name}: no image is stored in frame {agent.frame.frame}")
    with Image.open(io.BytesIO(data)) as picture:
        image = np.asarray(picture)
    shown = axes.imshow(image)
    axes.set(xticks=[], yticks=[])
    return SamplePlot(shown, column, legend="bright is a great value") if image.ndim == 2 else SamplePlot()


def encoded_image(agent: Agent, sensor: str) -> tuple[str, bytes | None]:
    """Return name and unit of the first column of images of a sensor's table, and the file in its row of the frame."""
    table = sensor_spec(agent.sensors[sensor]).tables[0]
    column = next((column for column in table.columns if column.type == IMAGE), None)
    row = agent.frame.row_of(table.name, agent.name, sensor)
    if column is None or row is None or row[column.name] is None:
        return "", None
    return label_of(column), row[column.name]["bytes"]


def label_of(column: Any) -> str:
    """Return name and unit of a column for an axis."""
    unit = column_text(column).get("unit", "-")
    name = column.name.removesuffix(f"_{unit}").replace("_", " ")
    return f"{name} [{unit.replace('^2', '²')}]" if unit != "-" else name
