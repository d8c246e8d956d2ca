"""Plots that set weathers side by side: the same LiDAR sweep and the same radar sample in each of them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mmw.viz.stills.plots import RADAR_LABELS, draw_radar, read_rows

LIDAR_LABELS = (("surface", "tab:green"), ("rain echo", "tab:cyan"), ("fog echo", "tab:orange"))
"""Names and colours of `lidar.label`."""


def plot_lidar_weathers(
    root: Path, scenario: str, weathers: Sequence[str], frame: int, agent: str, out: Path, half: float = 40.0
) -> None:
    """Draw one sweep from above in each weather, surfaces by intensity, and how its returns are spread over range.

    Args:
        root: Dataset folder.
        scenario: Scenario name.
        weathers: Weathers of the dataset, one column each.
        frame: Frame.
        agent: Whose LiDAR it is.
        out: PNG file.
        half: Half width of the views from above [m].
    """
    from matplotlib.colors import LinearSegmentedColormap, PowerNorm
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.6 * len(weathers), 7.4), layout="constrained")
    top, bottom = figure.subplots(2, len(weathers), squeeze=False, height_ratios=(2.2, 1), sharex="row", sharey="row")
    grey = LinearSegmentedColormap.from_list("grey", ["0.35", "1.0"])  # the weakest return stands out from the black
    bins = np.geomspace(1.0, 120.0, 60)
    points = None
    for weather, above, below in zip(weathers, top, bottom, strict=True):
        key = {"scenario": scenario, "weather": weather, "frame": frame, "agent": agent}
        sweep = read_rows(root, "lidar", ["x", "y", "z", "intensity", "label"], **key)
        x, y, z, intensity, label = (np.array(values[0]) for values in sweep.values())
        above.set_facecolor("black")
        parts = [label == value for value in range(len(LIDAR_LABELS))]
        surface = parts[0]
        shade = {"c": intensity[surface], "cmap": grey, "norm": PowerNorm(0.5, 0.0, 0.5)}
        points = above.scatter(x[surface], y[surface], s=0.7, linewidths=0, **shade)
        for is_it, (_, color) in list(zip(parts, LIDAR_LABELS, strict=True))[1:]:
            above.scatter(x[is_it], y[is_it], s=3, linewidths=0, color=color)
        for is_it, (_, color) in zip(parts, LIDAR_LABELS, strict=True):
            if is_it.any():
                distance = np.sqrt(x**2 + y**2 + z**2)[is_it]
                below.hist(distance, bins, histtype="stepfilled", color=color, alpha=0.35)
                below.hist(distance, bins, histtype="step", color=color)
        counts = [
            f"{is_it.sum():,} {name}" for is_it, (name, _) in zip(parts, LIDAR_LABELS, strict=True) if is_it.any()
        ]
        above.set(xlim=(-half, half), ylim=(-half, half), aspect="equal", xlabel="x forward [m]")
        above.set_title(f"{weather}\n{', '.join(counts)}", fontsize=10)
        below.set(xscale="log", yscale="log", xlabel="range [m]", ylim=(0.7, None))
    top[0].set_ylabel("y left [m]")
    bottom[0].set_ylabel("returns")
    figure.colorbar(points, ax=list(top), label="intensity of surfaces", shrink=0.7)
    handles = [bottom[0].plot([], [], lw=6, alpha=0.7, color=color, label=name)[0] for name, color in LIDAR_LABELS]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    figure.savefig(out, dpi=80)


def plot_radar_weathers(root: Path, scenario: str, weathers: Sequence[str], frame: int, agent: str, out: Path) -> None:
    """Draw the radar points of one sample from above in each weather, with boxes, and their SNR over range.

    Args:
        root: Dataset folder.
        scenario: Scenario name.
        weathers: Weathers of the dataset, one column each.
        frame: Frame.
        agent: Whose radar it is.
        out: PNG file.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.6 * len(weathers), 6.6), layout="constrained")
    top, bottom = figure.subplots(2, len(weathers), squeeze=False, height_ratios=(1.6, 1), sharex="row", sharey="row")
    points = None
    for weather, above, below in zip(weathers, top, bottom, strict=True):
        points = draw_radar(root, scenario, weather, frame, agent, above, below)
    for row in (top, bottom):
        for panel in row[1:]:
            panel.set_ylabel("")
    figure.colorbar(points, ax=list(top), label="radial velocity,\n+ receding [m/s]", shrink=0.8)
    handles = [
        top[0].plot([], [], linestyle="", color="0.5", markeredgecolor="black", marker=marker, label=name)[0]
        for name, marker in RADAR_LABELS
    ]
    handles += top[0].plot([], [], color="tab:green", label="box of a vehicle or person")
    handles += top[0].plot([], [], linestyle="", marker=".", color="0.75", label="LiDAR in the same weather")
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    figure.savefig(out, dpi=80)
