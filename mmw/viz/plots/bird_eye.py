"""LiDAR sweeps and radar samples from above, in the agent's frame: ahead is up, right is right."""

from typing import Any

import numpy as np

from mmw.core.errors import InputError
from mmw.dataset.camera_geometry import from_world
from mmw.dataset.frame import Agent, PointCloud
from mmw.viz.plots.style import (
    BOX_STYLES,
    DARK,
    INTENSITY,
    LABEL_COLORS,
    ORANGE,
    VELOCITY_M_S,
    box_kind,
    object_colors,
    plain_axes,
)  # fmt: skip

LIDAR_COLORS = ("intensity", "object", "height", "label")
"""Quantities that the points of a sweep can be colored by."""

OUTLINE = [0, 2, 6, 4, 0]
"""Corners of a box's floor in turn, of `mmw.dataset.camera_geometry.CORNERS`."""

FRONT = [4, 6]
"""Its two corners at the front."""

RADAR_MARKS = ((0, "o", "object"), (1, "s", "rain"), (2, "X", "false alarm"))
"""`radar.label`, marker and name."""

LIDAR_LABELS = ("surface", "rain", "fog")
"""Names of `lidar.label`."""

AHEAD = 5.0 / 3.0
"""Distance ahead that a radar's view shows over half of its width. Design value."""

RANGE_M = (1.0, 120.0)
"""Ends of the range axis of histograms [m]. Design value."""

HEIGHT_M = (0.0, 8.0)
"""Ends of the scale of heights above the agent's origin [m]. Design value."""


def draw_lidar(
    axes: Any, agent: Agent, sensor: str = "", *, color: str = "intensity", extent_m: float = 60.0, boxes: bool = True
) -> Any:
    """Draw one sweep from above, with boxes, in the frame of the agent.

    Args:
        axes: matplotlib axes to draw on.
        agent: From `frame.agents`.
        sensor: LiDAR; the agent's first if empty.
        color: `intensity`; `object`: actors by number, the town gray; `height`: above the agent's origin; `label`:
            surfaces gray by intensity, rain and fog in color.
        extent_m: Half of the side of the square that is shown [m].
        boxes: Draw boxes of vehicles and people.

    Returns:
        Mappable for a color bar; None for `object`.

    Raises:
        InputError: If the agent has no sweep of this sensor in the frame, or `color` is none of these.
    """
    if color not in LIDAR_COLORS:
        raise InputError(f"color={color!r}: one of {', '.join(LIDAR_COLORS)} is needed; change it")
    cloud = sample_of(agent, agent.sweeps, sensor, "LiDAR sweep")
    place = from_world(agent.pose, cloud.world)
    is_shown = (np.abs(place[:, :2]) <= extent_m).all(axis=1)
    x, y = -place[is_shown, 1], place[is_shown, 0]
    ids, label, intensity = (cloud[name][is_shown] for name in ("object_id", "label", "intensity"))
    style = {"linewidths": 0, "rasterized": True}
    mappable = None
    if color == "object":
        is_actor = np.isin(ids, agent.frame.boxes["object_id"])
        axes.scatter(x[~is_actor], y[~is_actor], s=1.0, color="0.45", zorder=1, **style)
        axes.scatter(x[is_actor], y[is_actor], s=4.0, c=object_colors(ids[is_actor]) / 255.0, zorder=1, **style)
    elif color == "label":
        from matplotlib.colors import LinearSegmentedColormap, PowerNorm

        is_surface = label == 0
        # The weakest return stands out from the dark ground.
        grey = {"cmap": LinearSegmentedColormap.from_list("grey", ["0.35", "1.0"]), "norm": PowerNorm(0.5, *INTENSITY)}
        mappable = axes.scatter(
            x[is_surface], y[is_surface], s=1.0, c=intensity[is_surface], zorder=1, **grey, **style
        )  # fmt: skip
        axes.scatter(x[~is_surface], y[~is_surface], s=3.0, c=LABEL_COLORS[label[~is_surface]] / 255.0, **style)
    else:
        value, (low, high) = (
            (intensity, INTENSITY) if color == "intensity" else (place[is_shown, 2], HEIGHT_M)
        )  # fmt: skip
        mappable = axes.scatter(x, y, s=1.0, c=value, cmap="viridis", vmin=low, vmax=high, zorder=1, **style)
    _finish(axes, agent, extent_m, (-extent_m, extent_m), "white", None if boxes else ())
    axes.set_facecolor(DARK)
    return mappable


def draw_points(axes: Any, agent: Agent, cloud: PointCloud, *, extent_m: float = 60.0, boxes: bool = True) -> Any:
    """Draw a point cloud of any sensor from above, colored by height over the agent's origin.

    Arguments and return value are those of `draw_lidar`.
    """
    place = from_world(agent.pose, cloud.world)
    style = {"linewidths": 0, "rasterized": True, "zorder": 2}
    mappable = axes.scatter(
        -place[:, 1], place[:, 0], s=4.0, c=place[:, 2], cmap="viridis", vmin=HEIGHT_M[0], vmax=HEIGHT_M[1], **style
    )  # fmt: skip
    _finish(axes, agent, extent_m, (-extent_m, extent_m), "white", None if boxes else ())
    axes.set_facecolor(DARK)
    return mappable


def draw_radar(
    axes: Any, agent: Agent, sensor: str = "", *, extent_m: float = 60.0, boxes: bool = True, lidar: bool = True
) -> Any:
    """Draw one radar sample from above, colored by radial velocity, in the frame of the agent.

    Args:
        axes: matplotlib axes to draw on.
        agent: From `frame.agents`.
        sensor: Radar; the agent's first if empty.
        extent_m: Half of the width of what is shown [m]; it reaches `AHEAD` times as far ahead.
        boxes: Draw boxes of vehicles and people.
        lidar: Draw the surfaces that the agent's first LiDAR sees, if it has one, in gray behind.

    Returns:
        Mappable for a color bar.

    Raises:
        InputError: If the agent has no sample of this sensor in the frame.
    """
    cloud = sample_of(agent, agent.radars, sensor, "radar sample")
    place = from_world(agent.pose, cloud.world)
    if lidar and agent.sweeps:
        sweep = next(iter(agent.sweeps.values()))
        behind = from_world(agent.pose, sweep.world[sweep["label"] == 0])
        axes.scatter(-behind[:, 1], behind[:, 0], s=0.5, linewidths=0, color="0.8", rasterized=True, zorder=1)
    is_detection = has_snr(cloud)
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
    far = AHEAD * extent_m
    _finish(axes, agent, extent_m, (-0.05 * far, far), ORANGE, "0.25" if boxes else ())
    axes.legend(loc="upper right", fontsize="x-small", framealpha=0.9)
    return mappable


def _finish(axes: Any, agent: Agent, extent_m: float, ahead_m: tuple[float, float], mark: str, boxes: Any) -> None:
    """Add the agent, boxes in a color (None: by kind; empty: none), limits and labels to a view from above."""
    if boxes != ():
        draw_boxes_above(axes, agent, max(extent_m, ahead_m[1]), color=boxes)
    axes.plot(0, 0, marker="^", color=mark, markersize=7, markeredgecolor="black", zorder=5)
    axes.set(
        xlim=(-extent_m, extent_m), ylim=ahead_m, aspect="equal", xlabel="right of the agent [m]",
        ylabel="ahead of the agent [m]",
    )  # fmt: skip


def draw_lidar_ranges(axes: Any, agent: Agent, sensor: str = "") -> None:
    """Draw how many returns of a sweep come from surfaces, rain and fog at each range; arguments as of `draw_lidar`."""
    cloud, bins = sample_of(agent, agent.sweeps, sensor, "LiDAR sweep"), np.geomspace(*RANGE_M, 60)
    distance = np.linalg.norm(cloud.points, axis=1)
    for number, name in enumerate(LIDAR_LABELS):
        own, color = distance[cloud["label"] == number], LABEL_COLORS[number] / 255.0 * (0.7 if number == 0 else 1.0)
        if len(own):
            axes.hist(own, bins, histtype="stepfilled", color=color, alpha=0.35)
            axes.hist(own, bins, histtype="step", color=color, label=f"{name} ({len(own):,})")
    axes.legend(loc="upper right", fontsize="x-small")
    axes.set(xscale="log", yscale="log", xlabel="range [m]", ylabel="returns", ylim=(0.7, None), xlim=RANGE_M)
    plain_axes(axes)


def draw_radar_ranges(axes: Any, agent: Agent, sensor: str = "") -> None:
    """Draw SNR, in mode `carla` radial velocity, over range; arguments as of `draw_radar`."""
    cloud = sample_of(agent, agent.radars, sensor, "radar sample")
    value, label = ("snr_db", "SNR [dB]") if has_snr(cloud) else ("velocity", "radial velocity [m/s]")
    for number, marker, _ in RADAR_MARKS:
        is_it = cloud["label"] == number
        axes.scatter(
            cloud["range"][is_it], cloud[value][is_it], c=cloud["velocity"][is_it], cmap="coolwarm",
            vmin=-VELOCITY_M_S, vmax=VELOCITY_M_S, marker=marker, s=16, edgecolors="black", linewidths=0.4,
        )  # fmt: skip
    axes.set(xscale="log", xlabel="range [m]", ylabel=label, xlim=RANGE_M)
    plain_axes(axes)


def has_snr(cloud: PointCloud) -> bool:
    """Return whether points of a radar are detections, which have an SNR."""
    return cloud.columns.get("snr_db") is not None and bool(np.isfinite(cloud["snr_db"]).all())


def draw_boxes_above(axes: Any, agent: Agent, extent_m: float, color: str | None = None) -> None:
    """Draw the floors of boxes, with a line to their front, in the frame of an agent; colored by kind by default."""
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


def sample_of(agent: Agent, found: dict[str, Any], sensor: str, what: str) -> Any:
    """Return the sample of a sensor, of the first one if no name is given.

    Raises:
        InputError: If there is none; it says what the agent has instead.
    """
    if not found or (sensor and sensor not in found):
        frame = agent.frame
        raise InputError(
            f"{frame.data.root}: {agent.name} has no {what}{f' of {sensor!r}' if sensor else ''} in frame "
            f"{frame.frame} of {frame.scenario} {frame.weather}; it has {', '.join(found) or 'none'}; name another"
        )
    return found[sensor] if sensor else next(iter(found.values()))
