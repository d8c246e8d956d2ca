"""LiDAR sweeps and radar samples from above, in the agent's frame: ahead is up, right is right."""

from typing import Any

import numpy as np

from mmw.core.errors import InputError
from mmw.dataset.camera_geometry import from_world
from mmw.dataset.frame import Agent
from mmw.viz.plots.style import BOX_STYLES, DARK, ORANGE, box_kind, object_color

LIDAR_COLORS = ("intensity", "object", "height", "label")
"""Columns by which the points of a sweep can be colored."""

OUTLINE = [0, 2, 6, 4, 0]
"""Corners of a box's floor in turn, of `mmw.dataset.camera_geometry.CORNERS`."""

FRONT = [4, 6]
"""Its two corners at the front."""

RADAR_MARKS = ((0, "o", "object"), (1, "s", "rain"), (2, "X", "false alarm"))
"""`radar.label`, marker and name."""

VELOCITY_M_S = 8.0
"""Radial velocity at the ends of the colour scale [m/s]. Design value."""

LABEL_COLORS = ("#B8BEC8", "#56B4E9", "#E69F00")
"""Colours of LiDAR returns from surfaces, rain and fog, `lidar.label`."""


def draw_lidar(
    axes: Any, agent: Agent, sensor: str = "", *, color: str = "intensity", extent_m: float = 60.0, boxes: bool = True
) -> Any:
    """Draw one sweep from above, with boxes, in the frame of the agent.

    Args:
        axes: matplotlib axes to draw on.
        agent: From `frame.agents`.
        sensor: LiDAR; the agent's first if empty.
        color: `intensity`; `object`: actors by number, the town grey; `height`: above the agent's origin; `label`:
            surface, rain or fog.
        extent_m: Half of the side of the square that is shown [m].
        boxes: Draw boxes of vehicles and people.

    Returns:
        What a colour bar needs; None for `object` and `label`.

    Raises:
        InputError: If the agent has no sweep of this sensor in the frame, or `color` is none of these.
    """
    if color not in LIDAR_COLORS:
        raise InputError(f"color={color!r}: one of {', '.join(LIDAR_COLORS)} is needed; change it")
    cloud = _one(agent, agent.sweeps, sensor, "LiDAR sweep")
    place = from_world(agent.pose, cloud.world)
    is_shown = (np.abs(place[:, :2]) <= extent_m).all(axis=1)
    place, thing, label = place[is_shown], cloud["object_id"][is_shown], cloud["label"][is_shown]
    points = {"s": 1.0, "linewidths": 0, "rasterized": True, "zorder": 1}
    mappable = None
    if color == "object":
        is_actor = np.isin(thing, agent.frame.boxes["object_id"])
        axes.scatter(-place[~is_actor, 1], place[~is_actor, 0], color="0.45", **points)
        axes.scatter(-place[is_actor, 1], place[is_actor, 0], c=object_color(thing[is_actor]), **(points | {"s": 4.0}))
    elif color == "label":
        axes.scatter(-place[:, 1], place[:, 0], c=np.array(LABEL_COLORS, dtype=object)[label].tolist(), **points)
    else:
        value, limits = (
            (cloud["intensity"][is_shown], (0.0, 0.5)) if color == "intensity" else (place[:, 2], (0.0, 8.0))
        )
        mappable = axes.scatter(
            -place[:, 1], place[:, 0], c=value, cmap="viridis", vmin=limits[0], vmax=limits[1], **points
        )
    if boxes:
        draw_boxes_above(axes, agent, extent_m)
    axes.plot(0, 0, marker="^", color="white", markersize=6, markeredgecolor="black", zorder=4)
    axes.set_facecolor(DARK)
    axes.set(
        xlim=(-extent_m, extent_m), ylim=(-extent_m, extent_m), aspect="equal", xlabel="right of the agent [m]",
        ylabel="ahead of the agent [m]",
    )  # fmt: skip
    return mappable


def draw_radar(
    axes: Any, agent: Agent, sensor: str = "", *, range_m: float | None = None, boxes: bool = True, lidar: bool = True
) -> Any:
    """Draw one radar sample from above, coloured by radial velocity, in the frame of the agent.

    Args:
        axes: matplotlib axes to draw on.
        agent: From `frame.agents`.
        sensor: Radar; the agent's first if empty.
        range_m: Farthest point that is shown [m]; the farthest in the sample by default.
        boxes: Draw boxes of vehicles and people.
        lidar: Draw the surfaces that the agent's first LiDAR sees, if it has one, in grey behind.

    Returns:
        What a colour bar needs.

    Raises:
        InputError: If the agent has no sample of this sensor in the frame.
    """
    cloud = _one(agent, agent.radars, sensor, "radar sample")
    place = from_world(agent.pose, cloud.world)
    far = range_m if range_m is not None else max(10.0, float(cloud["range"].max(initial=0.0)) * 1.05)
    if lidar and agent.sweeps:
        sweep = next(iter(agent.sweeps.values()))
        behind = from_world(agent.pose, sweep.world[sweep["label"] == 0])
        axes.scatter(-behind[:, 1], behind[:, 0], s=0.5, linewidths=0, color="0.8", rasterized=True, zorder=1)
    if boxes:
        draw_boxes_above(axes, agent, far, color="0.25")
    is_detection = cloud.columns.get("snr_db") is not None and np.isfinite(cloud["snr_db"]).all()
    mappable = None
    for number, marker, name in RADAR_MARKS:
        is_it = cloud["label"] == number
        if number == 0 or is_it.any():
            mappable_now = axes.scatter(
                -place[is_it, 1], place[is_it, 0], c=cloud["velocity"][is_it], marker=marker,
                s=26 if is_detection else 7, cmap="coolwarm", vmin=-VELOCITY_M_S, vmax=VELOCITY_M_S,
                edgecolors="black", linewidths=0.5 if is_detection else 0.2, zorder=4,
                label=f"{name} ({is_it.sum():,})",
            )  # fmt: skip
            mappable = mappable or mappable_now
    axes.plot(0, 0, marker="^", color=ORANGE, markersize=8, markeredgecolor="black", zorder=5)
    axes.legend(loc="upper right", fontsize="x-small", framealpha=0.9)
    axes.set(
        xlim=(-0.6 * far, 0.6 * far), ylim=(-0.05 * far, far), aspect="equal", xlabel="right of the agent [m]",
        ylabel="ahead of the agent [m]",
    )  # fmt: skip
    return mappable


def draw_boxes_above(axes: Any, agent: Agent, extent_m: float, color: str | None = None) -> None:
    """Draw the floors of boxes, with a line to their front, in the frame of an agent; coloured by kind by default."""
    rows = agent.frame.boxes
    if not len(rows):
        return
    corners = from_world(agent.pose, rows.corners)
    for index in np.flatnonzero((np.abs(corners.mean(axis=1)[:, :2]) <= extent_m).all(axis=1)):
        floor = corners[index]
        kind = box_kind(rows["agent"][index], rows["category"][index])
        style = {"color": color or BOX_STYLES[kind][0], "lw": 1.1, "zorder": 3}
        axes.plot(-floor[OUTLINE, 1], floor[OUTLINE, 0], **style)
        nose = np.stack([floor[[0, 2, 4, 6]].mean(axis=0), floor[FRONT].mean(axis=0)])
        axes.plot(-nose[:, 1], nose[:, 0], **style)


def _one(agent: Agent, found: dict[str, Any], sensor: str, what: str) -> Any:
    if not found or (sensor and sensor not in found):
        frame = agent.frame
        raise InputError(
            f"{frame.data.root}: {agent.name} has no {what}{f' of {sensor!r}' if sensor else ''} in frame "
            f"{frame.frame} of {frame.scenario} {frame.weather}; it has {', '.join(found) or 'none'}; name another"
        )
    return found[sensor] if sensor else next(iter(found.values()))
