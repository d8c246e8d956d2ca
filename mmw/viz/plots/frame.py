"""One frame as a figure, in the manner of nuScenes: cameras with boxes, a sweep from above, radar, depth."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mmw.core.errors import InputError
from mmw.core.transforms import quaternion_to_ypr
from mmw.dataset import Dataset, Frame
from mmw.dataset.frame import Agent, View
from mmw.viz.plots.bird_eye import draw_lidar, draw_radar
from mmw.viz.plots.images import draw_camera, draw_depth
from mmw.viz.plots.style import box_legend, new_figure, side_bar

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

WIDTH_IN = 16.0
"""Width of the figure [inch]."""

PER_ROW = 4
"""Images in a row at most."""

LIDAR_BARS = {"intensity": "intensity", "height": "height above the agent's origin [m]"}
"""Colour of a sweep -> label of its colour bar."""


@dataclass(frozen=True)
class Panels:
    """Panels of a frame figure: agent and sensor of each."""

    cameras: list[tuple[Agent, str]]
    depths: list[tuple[Agent, str]]
    lidars: list[tuple[Agent, str]]
    radars: list[tuple[Agent, str]]


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
    figure: "Figure | SubFigure | None" = None,
) -> "Figure | SubFigure":
    """Draw one frame: all cameras with projected boxes, LiDAR from above with boxes, depth, radar.

    Args:
        data: The dataset, from `mmw.open`.
        scenario: Scenario name.
        weather: Weather name.
        frame: Frame.
        agent: Whose sensors; its own alone. None takes the first connected vehicle, and for a kind of sensor that it
            does not carry the first agent that does; titles say whose it is.
        color: What LiDAR points are coloured by, see `draw_lidar`: intensity, object, height or label.
        boxes: Boxes on images, see `draw_camera`: seen, all or none; with `none` the views from above have none too.
        extent_m: Half of the side of the LiDAR's square [m].
        figure: Figure or subfigure to draw into; None makes a new one.

    Returns:
        The figure.

    Raises:
        InputError: If the dataset has no such frame or agent, the agent has no sample of any sensor in it, or `color`
            or `boxes` is none of the words.
        ImportError: If matplotlib is not installed.
    """
    found = data.frame(scenario, weather, frame)
    panels = choose_panels(found, agent)
    below = len(panels.lidars) + len(panels.radars) + len(panels.depths)
    if not panels.cameras and not below:
        raise InputError(
            f"{data.root}: {agent or 'no agent'} has no camera, LiDAR or radar sample in frame {frame} of {scenario} "
            f"{weather}; name another frame or agent"
        )
    columns = min(PER_ROW, max(len(panels.cameras), 1))
    rows = math.ceil(len(panels.cameras) / columns)
    top_in = rows * (WIDTH_IN / max(columns, 3) * 0.75 + 0.3)
    below_in = min(0.8 * WIDTH_IN / below, 6.5) if below else 0.0
    canvas = new_figure(figure, (WIDTH_IN, top_in + below_in + 0.5))
    parts = [part for part in (top_in, below_in) if part]
    places = list(np.atleast_1d(canvas.subfigures(len(parts), 1, height_ratios=parts)))
    if panels.cameras:
        _draw_cameras(places.pop(0), panels.cameras, rows, columns, boxes)
    if below:
        _draw_below(places.pop(0), panels, color, boxes, extent_m)
    canvas.suptitle(f"{scenario}, {weather}, frame {frame} ({found.time_s:.2f} s)", fontsize="large")
    return canvas


def choose_panels(frame: Frame, agent: str | None) -> Panels:
    """Return what a figure of a frame shows, see `render_frame`.

    Raises:
        InputError: If the frame has no such agent.
    """
    agents = list(frame.agents.values())
    if agent is not None and agent not in frame.agents:
        raise InputError(
            f"{frame.data.root}: frame {frame.frame} of {frame.scenario} {frame.weather} has no agent {agent!r}; it "
            f"has {', '.join(frame.agents) or 'none'}; name one"
        )
    first = next((one for one in agents if one.role == "cav"), agents[0] if agents else None)
    owners = [frame.agents[agent]] if agent is not None else [first, *(one for one in agents if one is not first)]

    def pick(sensors: Any) -> list[tuple[Agent, str]]:
        for owner in owners:
            if owner is not None and (names := sensors(owner)):
                return [(owner, name) for name in names]
        return []

    return Panels(
        cameras=pick(lambda one: cameras_of(one, "rgb")),
        depths=pick(lambda one: [name for name in cameras_of(one, "depth") if one.views[name].depth is not None]),
        lidars=pick(lambda one: list(one.sweeps)),
        radars=pick(lambda one: list(one.radars)),
    )


def cameras_of(agent: Agent, kind: str) -> list[str]:
    """Return the cameras of a type (rgb or depth) of an agent, from the one that looks left, clockwise, to the rear."""

    def turn(name: str) -> float:
        row = agent.sensors[name]
        yaw = quaternion_to_ypr(np.array([row[f"q{axis}"] for axis in "xyzw"]))[0]
        return math.pi / 2 - float(yaw) if yaw < math.radians(135.0) else 2.5 * math.pi - float(yaw)

    return sorted((name for name in agent.views if agent.sensors[name]["type"] == kind), key=turn)


def _draw_cameras(place: Any, cameras: list[tuple[Agent, str]], rows: int, columns: int, boxes: str) -> None:
    grid = place.subplots(rows, columns, squeeze=False).ravel()
    kinds: set[str] = set()
    for axes, (owner, name) in zip(grid, cameras, strict=False):
        view: View = owner.views[name]
        kinds |= draw_camera(axes, view, boxes=boxes)
        axes.set_title(f"{owner.name} {name}", fontsize="medium")
    for axes in grid[len(cameras) :]:
        axes.set_axis_off()
    box_legend(grid[0], kinds, loc="upper left", framealpha=0.85)


def _draw_below(place: Any, panels: Panels, color: str, boxes: str, extent_m: float) -> None:
    count = len(panels.lidars) + len(panels.radars) + len(panels.depths)
    widths = [1.0] * len(panels.lidars) + [1.1] * len(panels.radars) + [1.25] * len(panels.depths)
    grid = iter(place.subplots(1, count, squeeze=False, width_ratios=widths).ravel())
    for owner, name in panels.lidars:
        axes = next(grid)
        points = draw_lidar(axes, owner, name, color=color, extent_m=extent_m, boxes=boxes != "none")
        axes.set_title(f"{owner.name} {name}: {len(owner.sweeps[name]):,} returns", fontsize="medium")
        if points is not None:
            side_bar(axes, points, LIDAR_BARS[color])
    for owner, name in panels.radars:
        axes = next(grid)
        points = draw_radar(axes, owner, name, boxes=boxes != "none")
        axes.set_title(f"{owner.name} {name}: {len(owner.radars[name]):,} points", fontsize="medium")
        side_bar(axes, points, "radial velocity, + receding [m/s]")
    for owner, name in panels.depths:
        axes = next(grid)
        image = draw_depth(axes, owner.views[name], boxes=boxes)
        axes.set_title(f"{owner.name} {name}", fontsize="medium")
        side_bar(axes, image, "depth along the optical axis [m]")
