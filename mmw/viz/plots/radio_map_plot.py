"""Plot of a radio map in plan with matplotlib (extra `plot`): signal strength and SINR over the town's outline."""

from pathlib import Path
from typing import Any

import numpy as np

from mmw.channel.radio_map.solver import RadioMap
from mmw.core.mesh import TriangleMesh
from mmw.core.transforms import transform_points
from mmw.scene.scene_data import MODEL_NONE, SceneData
from mmw.viz.plots.style import label_place

MARGIN_M = 5.0
"""Border around the cells in the picture [m]."""

FLAT_COSINE = 0.2
"""Faces of buildings whose normal is nearer to the vertical than this show in plan; the others are walls."""

LOWEST_SHARE = 2.0
"""The color scale begins above the lowest values of this many percent of the cells."""


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
        _draw_cells(figure, axes, plan[server >= 0], values[server >= 0], label)
        x, y = result.transmitters.position[:, 0], result.transmitters.position[:, 1]
        axes.plot(x, y, "^", color="red", markersize=8, markeredgecolor="white", zorder=5)
        for name, place in zip(result.transmitters.names, result.transmitters.position, strict=True):
            label_place(axes, name, place[:2], color="red")
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x [m]", ylabel="y [m]")
        axes.label_outer()
    figure.suptitle(title, fontsize="medium")
    figure.savefig(out, dpi=100)


def _draw_cells(figure: Any, axes: Any, plan: np.ndarray, values: np.ndarray, label: str) -> None:
    from matplotlib.collections import PolyCollection

    cells = PolyCollection(list(plan), array=values, cmap="viridis", antialiased=False, edgecolors="none", zorder=2)
    if len(values):
        cells.set_clim(np.percentile(values, LOWEST_SHARE), values.max())
    axes.add_collection(cells)
    figure.colorbar(cells, ax=axes, label=label, extend="min", shrink=0.9)


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
