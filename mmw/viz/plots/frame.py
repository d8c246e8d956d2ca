"""One frame as a figure, in the manner of nuScenes: cameras with boxes, point clouds from above, other images."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mmw.config.sensor_spec import SENSORS
from mmw.core.errors import InputError
from mmw.core.transforms import quaternion_to_ypr
from mmw.dataset import Dataset, Frame
from mmw.dataset.frame import Agent, sensor_spec
from mmw.viz.plots.samples import SampleStyle, draw_sample, drawn_types, has_sample
from mmw.viz.plots.style import box_legend, new_figure, side_bar

if TYPE_CHECKING:
    from mmw.viz.plots.style import Canvas

WIDTH_IN = 16.0
"""Width of the figure [inch]."""

PER_ROW = 4
"""Images in a row at most."""

Panel = tuple[Agent, str]
"""Agent and sensor."""


def render_frame(
    data: Dataset,
    scenario: str,
    weather: str,
    frame: int,
    agent: str | None = None,
    *,
    color: str = "intensity",
    boxes: str = "seen",
    extent_m: float = 60.0,
    figure: "Canvas | None" = None,
) -> "Canvas":
    """Draw one frame: photographs with projected boxes, and below them every other sensor that gives points or images.

    Args:
        data: The dataset, from `mmw.open`.
        scenario: Scenario name.
        weather: Weather name.
        frame: Frame.
        agent: Agent whose sensors alone are shown. None shows those of the first connected vehicle, and of a type that
            it does not carry those of the first agent that does; titles name the agent.
        color: Quantity that LiDAR points are colored by, see `draw_lidar`: intensity, object, height or label.
        boxes: Boxes on images, see `draw_camera`: seen, all or none; with `none` the views from above have none too.
        extent_m: Half of the width of views from above [m].
        figure: Figure or subfigure to draw into; None makes a new one.

    Returns:
        The figure.

    Raises:
        InputError: If the dataset has no such frame or agent, the agent has no sample of any sensor in it, or `color`
            or `boxes` is none of the words.
        ImportError: If matplotlib is not installed.

    Examples:
        >>> import mmw
        >>> data = mmw.open_dataset("out/quickstart")
        >>> render_frame(data, "town03_roundabout", "sunny", 0).savefig("frame.png")
    """
    found = data.frame(scenario, weather, frame)
    cameras, others = choose_panels(found, agent)
    if not cameras and not others:
        raise InputError(
            f"{data.root}: {agent or 'no agent'} has no sample of points or image in frame {frame} of {scenario} "
            f"{weather}; name another frame or agent"
        )
    columns = min(PER_ROW, max(len(cameras), 1))
    rows = math.ceil(len(cameras) / columns)
    top_in = rows * (WIDTH_IN / max(columns, 3) * 0.75 + 0.3)
    below_in = min(0.8 * WIDTH_IN / len(others), 6.5) if others else 0.0
    canvas = new_figure(figure, (WIDTH_IN, top_in + below_in + 0.5))
    parts = [part for part in (top_in, below_in) if part]
    places = list(np.atleast_1d(canvas.subfigures(len(parts), 1, height_ratios=parts)))
    style = SampleStyle(color, boxes, extent_m)
    if cameras:
        _draw_cameras(places.pop(0).subplots(rows, columns, squeeze=False).ravel(), cameras, style)
    if others:
        _draw_others(places.pop(0), others, style)
    canvas.suptitle(f"{scenario}, {weather}, frame {frame} ({found.time_s:.2f} s)", fontsize="large")
    return canvas


def find_agent(frame: Frame, name: str) -> Agent:
    """Return an agent of a frame.

    Raises:
        InputError: If the frame has no such agent.
    """
    if name not in frame.agents:
        raise InputError(
            f"{frame.data.root}: frame {frame.frame} of {frame.scenario} {frame.weather} has no agent {name!r}; it "
            f"has {', '.join(frame.agents) or 'none'}; name one"
        )
    return frame.agents[name]


def choose_panels(frame: Frame, agent: str | None) -> tuple[list[Panel], list[Panel]]:
    """Return the photographs, and the other samples that a figure of a frame shows, see `render_frame`.

    Raises:
        InputError: If the frame has no such agent.
    """
    agents = list(frame.agents.values())
    first = next((one for one in agents if one.role == "cav"), agents[0] if agents else None)
    owners = [find_agent(frame, agent)] if agent is not None else [first, *(one for one in agents if one is not first)]
    cameras: list[Panel] = []
    others: list[Panel] = []
    for type_ in sorted(drawn_types(), key=lambda name: SENSORS[name].kind == "image"):
        is_camera = SENSORS[type_].needs_appearance
        for owner in owners:
            names = [] if owner is None else sensors_of(owner, type_)
            found = [(owner, name) for name in names if is_camera or has_sample(owner, name)]
            if found:
                (cameras if is_camera else others).extend(found)
                break
    return cameras, others


def sensors_of(agent: Agent, type_: str) -> list[str]:
    """Return the sensors of a type of an agent, from the one that looks left, clockwise, to the rear."""

    def turn(name: str) -> float:
        row = agent.sensors[name]
        yaw = quaternion_to_ypr(np.array([row[f"q{axis}"] for axis in "xyzw"]))[0]
        return math.pi / 2 - float(yaw) if yaw < math.radians(135.0) else 2.5 * math.pi - float(yaw)

    return sorted((name for name, row in agent.sensors.items() if row["type"] == type_), key=turn)


def _draw_cameras(grid: Any, cameras: list[Panel], style: SampleStyle) -> None:
    kinds: set[str] = set()
    for axes, (owner, name) in zip(grid, cameras, strict=False):
        kinds |= draw_sample(axes, owner, name, style).box_kinds
        axes.set_title(f"{owner.name} {name}", fontsize="medium")
    for axes in grid[len(cameras) :]:
        axes.set_axis_off()
    box_legend(grid[0], kinds, loc="upper left", framealpha=0.85)


def _draw_others(place: Any, panels: list[Panel], style: SampleStyle) -> None:
    widths = [1.25 if sensor_spec(owner.sensors[name]).kind == "image" else 1.05 for owner, name in panels]
    grid = place.subplots(1, len(panels), squeeze=False, width_ratios=widths).ravel()
    for axes, (owner, name) in zip(grid, panels, strict=True):
        drawn = draw_sample(axes, owner, name, style)
        axes.set_title(f"{owner.name} {name}{': ' * bool(drawn.note)}{drawn.note}", fontsize="medium")
        if drawn.scale is not None:
            side_bar(axes, drawn.scale, drawn.scale_label)
