"""Draw a scene in 3-D with matplotlib, where there is no Rerun: the largest triangles, antennas, paths and coverage."""

from typing import TYPE_CHECKING, Any

import numpy as np

from mmw.core.mesh import separate
from mmw.viz.plots.style import BLUE, ORANGE, SCALE, new_figure, scale_colors
from mmw.viz.scene_view.content import SceneContent
from mmw.viz.scene_view.surfaces import EVERYTHING, ClipBox

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_TRIANGLES = 20_000
"""Triangles that are drawn at most, the largest: matplotlib sorts and draws each by itself. Design value."""

MARGIN = 0.35
"""Border around antennas and paths, in their extent [-]. Design value."""

MARGIN_M = 15.0
"""Least border around them [m]. Design value."""

SUN = np.array([0.35, -0.5, 0.79])
"""Direction of the light that shades the triangles."""

AMBIENT = 0.55
"""Share of a color that a triangle has turned away from the light [-]. Design value."""

DPI = 100


def plot_scene(content: SceneContent, reason: str, height_px: int) -> "Figure":
    """Return a figure of a scene; it can be turned where matplotlib has a window or a widget.

    Surfaces are drawn around antennas and paths, the largest `MAX_TRIANGLES`. matplotlib sorts triangles by their
    middle, so a large one may cover a nearer one, and paths are drawn over everything.

    Args:
        content: The scene.
        reason: Why matplotlib draws it; a line below the picture.
        height_px: Height of the figure [px].
    """
    figure = new_figure(None, (1.6 * height_px / DPI, height_px / DPI))
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    box = _region(content)
    corners, colors, total = _triangles(content, box)
    _add(axes, corners, _shaded(corners, colors), zorder=1)
    if content.coverage is not None:
        cells, face = box.cut(content.coverage_triangles)
        _add(axes, cells, content.coverage_colors[face] / 255.0, zorder=2)
        _bar(figure, axes, f"coverage: {content.coverage.label}", content.coverage.limits)
    _draw_paths(figure, axes, content)
    for found, color, marker in ((content.transmitters, BLUE, "^"), (content.receivers, ORANGE, "o")):
        for name, antenna in found.items():
            axes.scatter(*antenna.position, c=color, marker=marker, s=60, edgecolors="black", zorder=5)
            axes.text(*antenna.position, f" {name}", zorder=6, fontsize="small")
    for name, place in content.places.items():
        if name in content.actors and ((place >= box.low) & (place <= box.high)).all():
            axes.text(*place, name, zorder=6, fontsize="x-small", color="0.2", ha="center")
    low, high = _limits(content, box)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set(xlabel="x east [m]", ylabel="y north [m]", zlabel="z [m]")
    axes.set_box_aspect(high - low)
    axes.locator_params("z", nbins=2)
    axes.view_init(elev=50.0, azim=-120.0)
    left_out = [f"the largest {len(corners):,} of {total:,} triangles"] if len(corners) < total else []
    axes.set_title(content.name, fontsize="medium")
    figure.text(0.01, 0.01, "; ".join([reason, *left_out, *content.notes]), fontsize="x-small", color="0.35")
    return figure


def _region(content: SceneContent) -> ClipBox:
    """Return the surroundings of antennas and paths in plan; everything where there are none."""
    focus = content.focus
    if len(focus) < 2:
        return EVERYTHING
    low, high = focus.min(axis=0), focus.max(axis=0)
    border = max(MARGIN_M, MARGIN * float(np.linalg.norm(high - low)))
    return ClipBox((*(low[:2] - border).tolist(), -np.inf), (*(high[:2] + border).tolist(), np.inf))


def _triangles(content: SceneContent, box: ClipBox) -> tuple[np.ndarray, np.ndarray, int]:
    """Return corners [N, 3, 3] and colors [N, 3], 0 to 1, of the largest triangles in a box, and how many are in it."""
    corners, colors = [np.zeros((0, 3, 3))], [np.zeros((0, 3))]
    for mesh in (*content.town, *(one for own in content.actors.values() for one in own)):
        inside, _ = box.cut(mesh.points.astype(np.float64)[mesh.faces])
        corners.append(inside)
        colors.append(np.broadcast_to(np.array(mesh.color) / 255.0, (len(inside), 3)))
    every, shade = np.concatenate(corners), np.concatenate(colors)
    largest = np.sort(np.argsort(-separate(every).areas, kind="stable")[:MAX_TRIANGLES])
    return every[largest], shade[largest], len(every)


def _shaded(corners: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """Return colors of triangles in the light of `SUN`, shape [N, 3], 0 to 1."""
    lit = np.abs(separate(corners).normals @ SUN)[:, None]
    return colors * (AMBIENT + (1.0 - AMBIENT) * lit)


def _add(axes: Any, corners: np.ndarray, colors: np.ndarray, zorder: float) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    if len(corners):
        axes.add_collection3d(Poly3DCollection(corners, facecolors=colors, edgecolors=colors, lw=0.2, zorder=zorder))


def _draw_paths(figure: Any, axes: Any, content: SceneContent) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    paths = content.paths
    if paths is None or not len(paths):
        return
    colors, widths = scale_colors(paths.share, 0.0, 1.0) / 255.0, 0.4 + 2.0 * paths.share
    axes.add_collection3d(Line3DCollection(list(paths.lines), colors=colors, linewidths=widths, zorder=4))
    _bar(figure, axes, "path gain [dB]", paths.limits_db)


def _bar(figure: Any, axes: Any, label: str, limits: tuple[float, float]) -> None:
    """Add a color bar of `SCALE`."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, Normalize

    colors = LinearSegmentedColormap.from_list("scale", SCALE / 255.0)
    figure.colorbar(ScalarMappable(Normalize(*limits), colors), ax=axes, label=label, shrink=0.6, pad=0.06)


def _limits(content: SceneContent, box: ClipBox) -> tuple[np.ndarray, np.ndarray]:
    low, high = content.bounds
    low, high = np.maximum(low, box.low), np.minimum(high, box.high)
    return low, np.maximum(high, low + 1.0)
