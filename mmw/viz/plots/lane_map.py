"""Map of a town's lanes with matplotlib (extra `plot`)."""

from pathlib import Path
from typing import Any

import numpy as np

from mmw.config import load_config
from mmw.core.resources import configs_dir
from mmw.scene.scene_data import SceneData
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.viz.plots.radio_map_plot import draw_scene
from mmw.viz.plots.style import label_place

MARGIN_M = 20.0
"""Border around the lanes [m]."""

ARROW_EVERY_M = 40.0
"""Distance between the arrows on a lane [m]."""

SCALE_M = 100.0
"""Length of the scale bar [m]."""

SIZE_PX, DPI = 1200, 120


def plot_lanes(lanes: LaneGraph, arrays: SceneData, town: str, out: Path) -> None:
    """Draw a town's lanes by speed limit, connections through junctions, buildings and scenarios to a PNG file."""
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    figure = Figure(figsize=(SIZE_PX / DPI, SIZE_PX / DPI), layout="constrained")
    axes = figure.subplots()
    draw_scene(axes, arrays, arrays.frames[0])
    connections = [lane for lane in lanes.lanes.values() if lane.junction]
    roads = [lane for lane in lanes.lanes.values() if not lane.junction]
    axes.add_collection(
        LineCollection([lane.points[:, :2] for lane in connections], colors="tab:orange", linewidths=0.5, zorder=3)
    )
    lines = LineCollection(
        [lane.points[:, :2] for lane in roads], array=np.array([lane.speed * 3.6 for lane in roads]), cmap="viridis",
        linewidths=1.2, zorder=4,
    )  # fmt: skip
    axes.add_collection(lines)
    if roads:
        figure.colorbar(lines, ax=axes, label="speed limit [km/h]", shrink=0.6)
    for lane in roads:
        _draw_arrows(axes, lane.points[:, :2], lane.station)
    points = np.concatenate([lane.points[:, :2] for lane in lanes.lanes.values()])
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x [m]", ylabel="y [m]")
    _draw_scale_and_north(axes, low, high)
    for name, centre, rsus in scenarios_of(town):
        axes.plot(*centre, "*", color="red", markersize=13, markeredgecolor="white", zorder=7)
        if len(rsus):
            axes.plot(rsus[:, 0], rsus[:, 1], "^", color="magenta", markersize=7, markeredgecolor="white", zorder=7)
        label_place(axes, name, centre, color="red")
    length = sum(lane.length for lane in roads) / 1000.0
    axes.set_title(
        f"{town}: {len(roads)} lanes of {length:.1f} km, {len(connections)} connections through junctions (orange)\n"
        "stars: spawn centers of scenarios; triangles: roadside units", fontsize="medium",
    )  # fmt: skip
    figure.savefig(out, dpi=DPI)


def scenarios_of(town: str) -> list[tuple[str, tuple[float, float], np.ndarray]]:
    """Return name, spawn center (x, y) [m] and roadside units [N, 2] [m] of the shipped scenarios of a town."""
    found = {}
    for path in sorted([*configs_dir().glob("*.yaml"), *configs_dir().glob("scenarios/*.yaml")]):
        for scenario in load_config(path).scenarios:
            if scenario.town is not None and Path(scenario.town).stem == town and scenario.traffic is not None:
                x, y = scenario.traffic.spawn_center_m[:2]
                rsus = np.array([rsu.position_m[:2] for rsu in scenario.rsus]).reshape(-1, 2)
                found[scenario.name] = (scenario.name, (float(x), float(y)), rsus)
    return [found[name] for name in sorted(found)]


def _draw_arrows(axes: Any, points: np.ndarray, station: np.ndarray) -> None:
    """Draw arrow heads along a lane, one at least."""
    count = max(int(station[-1] / ARROW_EVERY_M), 1)
    at = (np.arange(count) + 0.5) * station[-1] / count
    place = np.stack([np.interp(at, station, points[:, k]) for k in range(2)], axis=1)
    segment = np.clip(np.searchsorted(station, at, "right") - 1, 0, len(points) - 2)
    along = points[segment + 1] - points[segment]
    turn = np.degrees(np.arctan2(along[:, 1], along[:, 0]))
    for (x, y), angle in zip(place, turn, strict=True):
        axes.plot(x, y, marker=(3, 0, float(angle) - 90.0), color="0.15", markersize=3.5, zorder=5)


def _draw_scale_and_north(axes: Any, low: np.ndarray, high: np.ndarray) -> None:
    wide, tall = high - low
    bar = SCALE_M if wide > 3.0 * SCALE_M else 10.0 ** np.floor(np.log10(wide / 3.0))
    x, y = low[0] + 0.04 * wide, low[1] + 0.03 * tall
    axes.plot([x, x + bar], [y, y], color="black", linewidth=3, solid_capstyle="butt", zorder=6)
    axes.annotate(f"{bar:g} m", (x + bar / 2, y), (0, 4), textcoords="offset points", ha="center", zorder=6)
    x, y = low[0] + 0.04 * wide, high[1] - 0.10 * tall
    axes.annotate("", xy=(x, y + 0.06 * tall), xytext=(x, y), arrowprops={"arrowstyle": "-|>", "lw": 2}, zorder=6)
    axes.annotate("N", (x, y + 0.06 * tall), ha="center", va="bottom", fontsize="large", zorder=6)
