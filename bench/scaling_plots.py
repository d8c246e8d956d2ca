"""Pictures of what `bench.scaling` measured: four figures, of those curves that its file has."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullLocator

from mmw.viz.plots.style import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY, plain_axes

STAGES = {
    "cameras": (BLUE, "cameras"), "lidar": (ORANGE, "LiDARs"), "radar": (GREEN, "radar"), "channel": (RED, "channel"),
    "ground truth": (PURPLE, "ground truth"), "": (SKY, "everything else"),
}  # fmt: skip
"""Stage -> color and name; what has none is summed up as the last."""

KINDS = {"sphere": (RED, "sphere"), "camera": (BLUE, "camera"), "lidar": (ORANGE, "LiDAR")}
"""Kind of rays -> color and name."""

METHODS = {"larger": ("-", "o", "more blocks"), "finer": ("--", "s", "finer triangles")}
"""Curve of towns -> line, marker and name."""

PANEL_INCH = (4.1, 3.3)
"""Width and height of one set of axes [inch]."""

DPI = 110

Curves = dict[str, list[dict[str, Any]]]
Panel = tuple[tuple[str, ...], str, Callable[[Any, Curves], None]]
"""Curves, at least one of which must exist, their required value, and the function that draws them."""


def draw(measured: dict[str, Any], folder: Path) -> list[Path]:
    """Write the pictures into a folder and return their paths.

    Args:
        measured: Content of the file.
        folder: Where they go; made if it does not exist.

    Raises:
        ValueError: If the file has no curve that belongs to a picture.
    """
    curves: Curves = measured["curves"]
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, (columns, panels) in PICTURES.items():
        there = [
            plot for needed, key, plot in panels
            if any(point[key] is not None for curve in needed for point in curves.get(curve, []))
        ]  # fmt: skip
        if not there:
            continue
        columns = min(columns, len(there))
        rows = -(-len(there) // columns)
        figure = Figure(figsize=(PANEL_INCH[0] * columns, PANEL_INCH[1] * rows + 0.3), layout="constrained")
        every = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes, plot in zip(every, there, strict=False):
            plot(axes, curves)
            plain_axes(axes)
        for axes in every[len(there) :]:
            axes.set_visible(False)
        figure.suptitle(measured["machine"]["device"], fontsize="small", color="0.35")
        path = folder / f"{name}.png"
        figure.savefig(path, dpi=DPI)
        written.append(path)
    if not written:
        raise ValueError(f"the file has the curves {', '.join(curves) or 'none'}; there is no picture of them")
    return written


def _short(value: float, _: int = 0) -> str:
    """Return a number of an axis: 0.2, 50, 30 k, 2 M."""
    for limit, letter in ((1e6, " M"), (1e3, " k")):
        if value >= limit:
            return f"{value / limit:.3g}{letter}"
    return f"{value:g}"


def _scales(axes: Any, xlabel: str, ylabel: str, *, x: bool = True, y: bool = True) -> None:
    """Name both axes, and make them logarithmic."""
    axes.set(xlabel=xlabel, ylabel=ylabel, xscale="log" if x else "linear", yscale="log" if y else "linear")
    for axis, is_log, (low, high) in ((axes.xaxis, x, axes.get_xlim()), (axes.yaxis, y, axes.get_ylim())):
        if is_log:
            few = high / low > 100.0
            axis.set_major_locator(LogLocator(subs=(1.0,) if few else (1.0, 2.0, 5.0)))
            axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)) if few else NullLocator())
        axis.set_major_formatter(FuncFormatter(_short))
        axis.set_minor_formatter(FuncFormatter(lambda *_: ""))
    if not y:
        axes.set_ylim(bottom=0.0)


def _tick_at(axes: Any, values: np.ndarray) -> None:
    """Put the ticks of the x axis where something was measured."""
    axes.xaxis.set_major_locator(FixedLocator(values.tolist()))
    axes.xaxis.set_minor_locator(NullLocator())


def _columns(points: list[dict[str, Any]], key: str) -> np.ndarray:
    """Return one value of every point, NaN where it was not measured."""
    return np.array([np.nan if point[key] is None else point[key] for point in points], dtype=np.float64)


def _town_rays(axes: Any, curves: Curves) -> None:
    names = []
    for method, (style, marker, _) in METHODS.items():
        points = curves.get(method, [])
        for kind, (color, name) in KINDS.items():
            there = [point for point in points if kind in point["rays_per_s"]]
            if there:
                speed = [point["rays_per_s"][kind] / 1e9 for point in there]
                axes.plot(_columns(there, "value"), speed, style, marker=marker, ms=4, color=color)
                names.append((color, name))
    _scales(axes, "triangles of the town", "G rays a second")
    lines = [Line2D([], [], color=color, label=name) for color, name in dict.fromkeys(names)]
    lines += [
        Line2D([], [], color="0.3", ls=style, marker=marker, ms=4, label=name)
        for method, (style, marker, name) in METHODS.items() if method in curves
    ]  # fmt: skip
    axes.legend(loc="best", handles=lines, fontsize="x-small", handlelength=3)


def _town_build(axes: Any, curves: Curves) -> None:
    for method, (style, marker, name) in METHODS.items():
        if method in curves:
            value, found = _columns(curves[method], "value"), _columns(curves[method], "build_s")
            axes.plot(value, found, style, marker=marker, ms=4, color=BLUE, label=name)
    _scales(axes, "triangles of the town", "trees built in [s]")
    axes.legend(loc="best", fontsize="x-small", handlelength=3)


def _stages(curve: str, xlabel: str, *, log: bool = False) -> Callable[[Any, Curves], None]:
    """Return what draws the time of every stage."""

    def plot(axes: Any, curves: Curves) -> None:
        points = curves[curve]
        value = _columns(points, "value")
        for stage, (color, name) in STAGES.items():
            rest = not stage
            spent = [
                sum(ms for key, ms in point["stages_ms"].items() if key == stage or (rest and key not in STAGES))
                for point in points
            ]
            if any(spent):
                axes.plot(value, spent, "-o", ms=4, color=color, label=name)
        _device(axes, points)
        _scales(axes, xlabel, "time of a frame [ms]", x=log, y=log)
        _tick_at(axes, value)
        axes.legend(loc="best", fontsize="x-small")

    return plot


def _one(curve: str, stage: str, xlabel: str) -> Callable[[Any, Curves], None]:
    """Return what draws the time of one stage, and what would be in proportion to the largest."""

    def plot(axes: Any, curves: Curves) -> None:
        _line(axes, curves[curve], stage, "-", STAGES[stage][1])
        _device(axes, curves[curve])
        _proportion(axes, curves[curve], stage)
        _scales(axes, xlabel, "time of a frame [ms]")
        _tick_at(axes, _columns(curves[curve], "value"))
        axes.legend(loc="best", fontsize="x-small")

    return plot


def _links(axes: Any, curves: Curves) -> None:
    for curve, style, name in (("v2i", "-", "one unit to vehicles"), ("v2v", "--", "pairs of vehicles")):
        if curve in curves:
            _line(axes, curves[curve], "channel", style, name)
    _scales(axes, "links of a frame, each direction one", "time of a frame [ms]")
    axes.legend(loc="best", fontsize="x-small", handlelength=3)


def _line(axes: Any, points: list[dict[str, Any]], stage: str, style: str, name: str) -> None:
    spent = [point["stages_ms"][stage] for point in points]
    axes.plot(_columns(points, "value"), spent, style, marker="o", ms=4, color=STAGES[stage][0], label=name)


def _device(axes: Any, points: list[dict[str, Any]]) -> None:
    """Draw the device's own part, where there is a device."""
    spent = _columns(points, "device_ms")
    if np.isfinite(spent).any():
        axes.plot(_columns(points, "value"), spent, ":", marker="x", ms=4, color="0.25", label="kernels and copies")


def _proportion(axes: Any, points: list[dict[str, Any]], stage: str) -> None:
    value = _columns(points, "value")
    axes.plot(
        value, points[-1]["stages_ms"][stage] * value / value[-1], color=GREY, lw=0.8, zorder=0, label="in proportion"
    )


PICTURES: dict[str, tuple[int, tuple[Panel, ...]]] = {
    "scaling_triangles": (2, (
        (("larger", "finer"), "rays_per_s", _town_rays),
        (("larger", "finer"), "build_s", _town_build),
    )),
    "scaling_sensors": (2, (
        (("vehicles",), "frame_ms", _stages("vehicles", "vehicles")),
        (("images",), "frame_ms", _one("images", "cameras", "images of a frame")),
        (("resolution",), "frame_ms", _one("resolution", "cameras", "pixels of an image")),
        (("lidars",), "frame_ms", _one("lidars", "lidar", "sweeps of a frame")),
        (("points",), "frame_ms", _one("points", "lidar", "rays of a sweep")),
        (("weathers",), "frame_ms", _stages("weathers", "weathers of a frame")),
    )),
    "scaling_radio": (2, (
        (("rays",), "frame_ms", _one("rays", "channel", "rays of the transmitter")),
        (("v2i", "v2v"), "frame_ms", _links),
    )),
    "scaling_batch": (1, (
        (("batch",), "frame_ms", _stages("batch", "frames of a batch", log=True)),
    )),
}  # fmt: skip
"""File -> columns and panels."""
