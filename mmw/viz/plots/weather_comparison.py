"""Figures of one sensor with weathers side by side."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from mmw.core.errors import InputError
from mmw.core.registry import load_reference
from mmw.dataset import Dataset
from mmw.dataset.frame import sensor_spec
from mmw.viz.plots.bird_eye import draw_lidar, draw_lidar_ranges, draw_radar, draw_radar_ranges, sample_of
from mmw.viz.plots.frame import find_agent, sensors_of
from mmw.viz.plots.images import draw_boxes_2d, draw_depth, draw_instances
from mmw.viz.plots.readings import plot_readings
from mmw.viz.plots.samples import SamplePlot, SampleStyle, draw_sample
from mmw.viz.plots.style import new_figure, plain_ticks, side_bar

if TYPE_CHECKING:
    from mmw.viz.plots.style import Canvas

TILE_IN = 3.4
"""Width of an image beside others [inch]."""


def plot_sensor(
    data: Dataset, scenario: str, weathers: Sequence[str], frame: int, agent: str, sensor: str, *,
    figure: "Canvas | None" = None,
) -> "Canvas":  # fmt: skip
    """Draw a sensor of any type: by the `figure` view of its `SensorSpec`, else by its kind.

    A scalar is drawn over all frames in the first weather, points in a column for each weather, images in a row for
    each weather, beside those of the agent's other sensors of the type.

    Args:
        data: The dataset.
        scenario: Scenario name.
        weathers: Weathers.
        frame: Frame; an image camera without a sample in it shows its last one before it, or else its first.
        agent: Agent that carries the sensor.
        sensor: Sensor name.
        figure: Figure or subfigure to draw into; None makes a new one.

    Returns:
        The figure.

    Raises:
        InputError: If the agent has no such sensor, or no sample of it in the frame.
        ImportError: If matplotlib is not installed.

    Examples:
        >>> import mmw
        >>> data = mmw.open_dataset("out/quickstart")
        >>> plot_sensor(data, "town03_roundabout", ["sunny"], 0, "cav_1", "lidar").savefig("lidar.png")
    """
    owner = find_agent(data.frame(scenario, weathers[0], frame), agent)
    if sensor not in owner.sensors:
        raise InputError(f"sensor {sensor!r}: {agent} has {', '.join(owner.sensors) or 'none'}; name one")
    spec = sensor_spec(owner.sensors[sensor])
    if "figure" in spec.views:
        draw = load_reference(spec.views["figure"])
        return draw(data, scenario, weathers, frame, agent, sensor, figure=figure)
    if spec.kind == "scalar":
        return plot_readings(data, scenario, weathers[0], sensor, agents=[agent], figure=figure)
    if spec.kind == "image":
        names = sensors_of(owner, spec.type)
        return _plot_images(data, scenario, weathers, frame, agent, names, spec.tables[0].name, figure)
    canvas = new_figure(figure, (5.2 * len(weathers) + 0.6, 5.4))
    grid, drawn = canvas.subplots(1, len(weathers), squeeze=False)[0], SamplePlot()
    for axes, weather in zip(grid, weathers, strict=True):
        drawn = draw_sample(axes, find_agent(data.frame(scenario, weather, frame), agent), sensor)
        axes.set_title(f"{weather}{': ' * bool(drawn.note)}{drawn.note}", fontsize="medium")
    if drawn.scale is not None:
        canvas.colorbar(drawn.scale, ax=list(grid), label=drawn.scale_label, shrink=0.8)
    canvas.suptitle(f"{agent} {sensor}: {scenario}, frame {frame}", fontsize="large")
    return canvas


def _plot_images(
    data: Dataset, scenario: str, weathers: Sequence[str], frame: int, agent: str, sensors: Sequence[str], table: str,
    figure: Any,
) -> Any:  # fmt: skip
    """Draw the images of sensors side by side, a row for each weather."""
    canvas = new_figure(figure, (TILE_IN * len(sensors) + 0.4, 0.8 * TILE_IN * len(weathers) + 0.7))
    grid = canvas.subplots(len(weathers), len(sensors), squeeze=False)
    for row, weather in zip(grid, weathers, strict=True):
        found = data.numpy(table, columns=["sensor", "frame"], scenario=scenario, weather=weather, agent=agent)
        for axes, sensor in zip(row, sensors, strict=True):
            frames = found["frame"][found["sensor"] == sensor]
            if not len(frames):
                axes.set_axis_off()
                continue
            before = frames[frames <= frame]
            number = int(before.max() if len(before) else frames.min())
            owner = data.frame(scenario, weather, number).agents[agent]
            drawn = draw_sample(axes, owner, sensor, SampleStyle(boxes="none"))
            axes.set_title(f"{sensor}, {weather}, frame {number}", fontsize="small")
            if drawn.scale is not None:
                side_bar(axes, drawn.scale, drawn.scale_label)
    canvas.suptitle(f"{agent}: {scenario}", fontsize="medium")
    return canvas


def plot_lidar(
    data: Dataset, scenario: str, weathers: Sequence[str], frame: int, agent: str, sensor: str = "", *,
    color: str = "", extent_m: float = 40.0, figure: "Canvas | None" = None,
) -> "Canvas":  # fmt: skip
    """Draw one sweep from above and its returns over range, a column for each weather.

    Args:
        data: The dataset.
        scenario: Scenario name.
        weathers: Weathers, one column each.
        frame: Frame.
        agent: Agent that carries the LiDAR.
        sensor: LiDAR; the agent's first if empty.
        color: Quantity that the points are colored by, see `draw_lidar`; the label for several weathers, the intensity
            for one, if empty.
        extent_m: Half of the side of the views from above [m].
        figure: Figure or subfigure to draw into; None makes a new one.

    Returns:
        The figure.

    Raises:
        InputError: If the agent has no sweep of this sensor in the frame.
        ImportError: If matplotlib is not installed.
    """
    color = color or ("label" if len(weathers) > 1 else "intensity")
    draw = partial(draw_lidar, color=color, extent_m=extent_m)
    label = "intensity of surfaces" if color == "label" else color
    where = (data, scenario, weathers, frame, agent, sensor)
    return _plot_points(*where, draw, draw_lidar_ranges, label, 1.9, figure)


def plot_radar(
    data: Dataset, scenario: str, weathers: Sequence[str], frame: int, agent: str, sensor: str = "", *,
    figure: "Canvas | None" = None,
) -> "Canvas":  # fmt: skip
    """Draw one radar sample from above and its SNR over range, a column for each weather.

    Behind it lie the boxes of the frame and, if the agent has a LiDAR, the surfaces that it sees. Arguments, return
    value and errors are those of `plot_lidar`.
    """
    where = (data, scenario, weathers, frame, agent, sensor)
    label = "radial velocity, + receding [m/s]"
    return _plot_points(*where, draw_radar, draw_radar_ranges, label, 1.6, figure)


def _plot_points(
    data: Dataset, scenario: str, weathers: Sequence[str], frame: int, agent: str, sensor: str,
    draw_above: Callable[..., Any], draw_ranges: Callable[..., None], label: str, ratio: float, figure: Any,
) -> Any:  # fmt: skip
    """Draw a sample from above, with a color bar, and over range, a column for each weather."""
    size = (4.6 * len(weathers) + 0.6, 7.4) if len(weathers) > 1 else (7.4, 9.6)
    canvas = new_figure(figure, size)
    top, bottom = canvas.subplots(
        2, len(weathers), squeeze=False, height_ratios=(ratio, 1), sharex="row", sharey="row"
    )  # fmt: skip
    points = None
    for weather, above, below in zip(weathers, top, bottom, strict=True):
        owner = find_agent(data.frame(scenario, weather, frame), agent)
        points = draw_above(above, owner, sensor)
        draw_ranges(below, owner, sensor)
        above.set_title(weather)
    for axes in [*top[1:], *bottom[1:]]:
        axes.set_ylabel("")
    if points is not None:
        canvas.colorbar(points, ax=list(top), label=label, shrink=0.75)
    canvas.suptitle(f"{agent}: {scenario}, frame {frame}", fontsize="large")
    return canvas


def plot_depth(
    data: Dataset, scenario: str, weathers: Sequence[str], frame: int, agent: str, sensor: str = "", *,
    figure: "Canvas | None" = None,
) -> "Canvas":  # fmt: skip
    """Draw a depth image and, where there is a segmentation, the instances beside it, with the 2-D boxes.

    Each weather has a row. Arguments, return value and errors are those of `plot_lidar`.
    """
    views = []
    for weather in weathers:
        owner = find_agent(data.frame(scenario, weather, frame), agent)
        found = {name: view for name, view in owner.views.items() if view.depth is not None}
        views.append(sample_of(owner, found, sensor, "depth image"))
    has_instances = any(view.instance is not None for view in views)
    size = (13.0, 5.2) if has_instances else (9.0, 6.6)
    canvas = new_figure(figure, (size[0], size[1] * len(views)))
    for row, view, weather in zip(
        canvas.subplots(len(views), 1 + has_instances, squeeze=False), views, weathers, strict=True
    ):
        image = draw_depth(row[0], view, boxes="none")
        draw_boxes_2d(row[0], view, "tab:cyan")
        row[0].set_title(f"depth: {agent} {view.sensor}, {scenario}, {weather}, frame {frame}")
        bar = canvas.colorbar(
            image, ax=row[0], label="depth along the optical axis [m]", shrink=0.8,
            location="left" if has_instances else "right",
        )  # fmt: skip
        plain_ticks(bar)
        if has_instances:
            draw_instances(row[1], view)
            draw_boxes_2d(row[1], view)
            row[1].set_title("instances; boxes: visible pixels (solid), whole body (dashed)")
    return canvas
