"""Plots of radio maps with matplotlib (extra `plot`): a metric, or signal strength and SINR over the town's outline."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mmw.channel.radio_map.radio_map import METRICS, RadioMap
from mmw.core.errors import InputError
from mmw.core.mesh import TriangleMesh
from mmw.core.transforms import transform_points
from mmw.scene.scene_data import MODEL_NONE, SceneData
from mmw.viz.plots.style import label_place, new_figure

MARGIN_M = 5.0
"""Border around the cells in the picture [m]."""

FLAT_COSINE = 0.2
"""Faces of buildings whose normal is nearer to the vertical than this show in plan; the others are walls."""

LOWEST_SHARE = 2.0
"""The color scale begins above the lowest values of this many percent of the cells."""

ASSOCIATION = "association"
"""Name of the picture of the transmitter that serves each cell."""

LABELS = {"path_gain": "path gain [dB]", "rss": "RSS [dBm]", "sinr": "SINR [dB]"}
"""Metric -> label of its color bar."""


def plot_radio_map(result: RadioMap, arrays: SceneData, frame: int, out: Path, title: str) -> None:
    """Draw the signal strength of the strongest transmitter and its SINR; a cell that nothing reaches stays empty.

    Args:
        result: The map.
        arrays: The scene, for buildings and vehicles.
        frame: Frame whose vehicles are drawn.
        out: PNG file.
        title: Title, one line.
    """
    from matplotlib.figure import Figure

    plan = result.surface.corners[..., :2]
    low, high = plan.min(axis=(0, 1)) - MARGIN_M, plan.max(axis=(0, 1)) + MARGIN_M
    server, cell = result.tx_association, np.arange(len(plan))
    wide, tall = high - low
    beside = bool(tall >= wide)
    panel = (6.5, 6.5 * tall / wide) if not beside else (6.5 * wide / tall, 6.5)
    size = (2 * panel[0] + 3.5, panel[1] + 1.2) if beside else (panel[0] + 3.0, 2 * panel[1] + 2.0)
    figure = Figure(figsize=size, layout="constrained")
    axes_of = figure.subplots(*((1, 2) if beside else (2, 1)), sharex=True, sharey=True)
    for axes, values, label in zip(
        axes_of,
        (result.rss_dbm[server, cell], result.sinr_db[server, cell]),
        ("RSS of the strongest transmitter [dBm]", "SINR of the strongest transmitter [dB]"),
        strict=True,
    ):
        draw_scene(axes, arrays, frame)
        _add_scale(axes, _draw_cells(axes, plan[server >= 0], values[server >= 0]), label)
        x, y = result.transmitters.position[:, 0], result.transmitters.position[:, 1]
        axes.plot(x, y, "^", color="red", markersize=8, markeredgecolor="white", zorder=5)
        _label_transmitters(axes, result.transmitters.names, result.transmitters.position)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x [m]", ylabel="y [m]")
        axes.label_outer()
    figure.suptitle(title, fontsize="medium")
    figure.savefig(out, dpi=100)


def draw_radio_map(result: RadioMap, metric: str, tx: str | None, ax: Any, scene: Any) -> Any:
    """Draw one metric of a map and return the figure; see `RadioMap.plot`.

    Raises:
        InputError: If there is no such metric or transmitter, or upright surfaces are to be drawn into plane axes.
    """
    if metric not in (*METRICS, ASSOCIATION):
        raise InputError(
            f"radio map: metric = {metric!r}; one of {', '.join((*METRICS, ASSOCIATION))} is needed; correct it"
        )
    if metric == ASSOCIATION and tx is not None:
        raise InputError(f"radio map: plot of {ASSOCIATION!r} for {tx!r}; it shows all transmitters; leave tx out")
    values = result.tx_association.astype(float) if metric == ASSOCIATION else result.metric_db(metric, tx)
    is_plan = bool((np.abs(result.surface.mesh.normals[:, 2]) > FLAT_COSINE).all())
    if ax is None:
        ax = new_figure(None, (7.5, 6.0)).subplots(subplot_kw={} if is_plan else {"projection": "3d"})
    elif hasattr(ax, "get_zlim") == is_plan:
        raise InputError(
            f"radio map: these axes have {2 + is_plan} dimensions, the surface needs {3 - is_plan}; "
            f"{'make plain axes' if is_plan else 'make them with projection=3d'}, or leave ax out"
        )
    reached = np.isfinite(values) & (values >= 0 if metric == ASSOCIATION else True)
    corners, place = result.surface.corners, result.transmitters.position
    size = 2 if is_plan else 3
    low, high = corners.min(axis=(0, 1)) - MARGIN_M, corners.max(axis=(0, 1)) + MARGIN_M
    if is_plan and scene is not None:
        draw_scene(ax, scene.arrays, scene.frame, (low[:2], high[:2]))
    draw = _draw_cells if is_plan else _draw_cells_3d
    cells = draw(ax, corners[reached, :, :size], values[reached])
    if metric == ASSOCIATION:
        _color_by_transmitter(ax, cells, result.tx_names)
    else:
        _add_scale(ax, cells, LABELS[metric] if tx is None else f"{LABELS[metric]} of {tx}")
    near = place[((place >= low) & (place <= high))[:, :size].all(axis=1)]  # axes in three dimensions clip nothing
    ax.plot(*near.T[:size], "^", color="red", markersize=8, markeredgecolor="white", zorder=5)
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]", ylabel="y [m]", aspect="equal")
    if is_plan:
        _label_transmitters(ax, result.tx_names, place)
    else:
        ax.set(zlim=(low[2], high[2]), zlabel="z [m]")
    return ax.figure


def _label_transmitters(axes: Any, names: Sequence[str], position: np.ndarray) -> None:
    """Write the names of transmitters beside them, those at one place, such as sectors, in one label."""
    together: dict[tuple[float, ...], list[str]] = {}
    for name, place in zip(names, position, strict=True):
        together.setdefault(tuple(np.round(place[:2], 2).tolist()), []).append(name)
    for place, some in together.items():
        label_place(axes, "\n".join(some), np.array(place), color="red")


def _color_by_transmitter(axes: Any, cells: Any, names: tuple[str, ...]) -> None:
    """Color cells by the number of their transmitter, with the names beside the color bar."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    table = colormaps["tab10" if len(names) <= 10 else "tab20"]
    cells.set_cmap(ListedColormap([table(k % table.N) for k in range(len(names))]))
    cells.set_clim(-0.5, len(names) - 0.5)
    bar = axes.figure.colorbar(cells, ax=axes, label="transmitter", shrink=0.9, ticks=range(len(names)))
    bar.ax.set_yticklabels(names)


def _draw_cells_3d(axes: Any, corners: np.ndarray, values: np.ndarray) -> Any:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    cells = Poly3DCollection(list(corners), array=values, cmap="viridis", edgecolors="none")
    axes.add_collection3d(cells)
    return cells


def _draw_cells(axes: Any, plan: np.ndarray, values: np.ndarray) -> Any:
    from matplotlib.collections import PolyCollection

    cells = PolyCollection(list(plan), array=values, cmap="viridis", antialiased=False, edgecolors="none", zorder=2)
    axes.add_collection(cells)
    return cells


def _add_scale(axes: Any, cells: Any, label: str) -> None:
    values = np.asarray(cells.get_array())
    if len(values):
        cells.set_clim(np.percentile(values, LOWEST_SHARE), values.max())
    axes.figure.colorbar(cells, ax=axes, label=label, extend="min", shrink=0.9)


def draw_scene(axes: Any, arrays: SceneData, frame: int, within: tuple[np.ndarray, np.ndarray] | None = None) -> None:
    """Draw buildings as gray areas with their walls as lines, and the vehicles of a frame as outlines over them.

    Args:
        axes: matplotlib axes to draw on.
        arrays: The scene.
        frame: Frame whose vehicles are drawn.
        within: Least and greatest x and y of what is drawn [m], shape [2] each; everything by default.
    """
    from matplotlib.collections import LineCollection, PolyCollection

    is_building = np.array([one.label == "building" for one in arrays.objects], dtype=bool)
    mesh = TriangleMesh(arrays.points, arrays.faces[is_building[arrays.object_id]])
    plan, is_flat = mesh.corners[..., :2], np.abs(mesh.normals[:, 2]) > FLAT_COSINE
    is_near = np.ones(len(plan), dtype=bool)
    if within is not None:
        is_near = ((plan.max(axis=1) >= within[0]) & (plan.min(axis=1) <= within[1])).all(axis=1)
    areas = PolyCollection(list(plan[is_flat & is_near]), facecolors="0.75", edgecolors="0.75", zorder=1)
    axes.add_collection(areas)
    axes.add_collection(LineCollection(_wall_lines(plan[~is_flat & is_near]), colors="0.6", linewidths=0.8, zorder=1))
    pose, outlines = arrays.poses[arrays.frame_row(frame)], []
    for row, actor in enumerate(arrays.actors):
        if actor.model != MODEL_NONE and np.isfinite(pose[row]).all():
            half, signs = np.array(actor.size) / 2.0, np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
            outlines.append(transform_points(pose[row], np.array(actor.center) + signs * half)[:, :2])
    axes.add_collection(PolyCollection(outlines, facecolors="none", edgecolors="black", linewidths=0.7, zorder=3))


def _wall_lines(plan: np.ndarray) -> np.ndarray:
    """Return the longest edge of each triangle, each line once, shape [M, 3, 2] -> [N, 2, 2]."""
    edges = np.stack([plan, np.roll(plan, -1, axis=1)], axis=2)
    longest = np.argmax(np.linalg.norm(edges[:, :, 1] - edges[:, :, 0], axis=-1), axis=1)
    lines = np.round(edges[np.arange(len(plan)), longest], 2)
    turned = np.lexsort(np.moveaxis(lines, 2, 0)[::-1], axis=-1)  # from the end with the lower x
    lines = np.take_along_axis(lines, turned[..., None], axis=1).reshape(-1, 4)
    lines = np.unique(lines, axis=0).reshape(-1, 2, 2)
    return lines[(lines[:, 0] != lines[:, 1]).any(axis=1)]
