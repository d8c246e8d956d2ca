"""Camera and depth images with the ground-truth boxes drawn over them."""

from typing import Any

import numpy as np

from mmw.core.errors import InputError
from mmw.dataset.camera_geometry import EDGES
from mmw.dataset.frame import View
from mmw.viz.plots.style import BOX_STYLES, DEPTH_M, box_kind, object_colors

PIECES = 16
"""Pieces that an edge is drawn in, so that it bends with the lens. Design value."""

NEAREST_M = 0.05
"""Depth at which an edge that comes from behind the camera is cut off [m]. Design value."""

FARTHEST_M = 100.0
"""Distance up to which boxes are drawn [m]. Design value."""

SMALL_BOX_PX = 12
"""Height up to which a 2-D box gets no text [px]. Design value."""


def draw_camera(axes: Any, view: View, *, boxes: str = "seen", farthest_m: float = FARTHEST_M) -> set[str]:
    """Draw the image of a camera and the boxes of the frame over it.

    Image coordinates are those of `Camera.pixels`: pixel (0, 0) reaches from 0 to 1.

    Args:
        axes: matplotlib axes to draw on.
        view: The camera at one instant, from `frame.agents[name].views`.
        boxes: `seen`: boxes of which the camera shows at least a pixel, as table `box_visibility` says, all in front
            of it where there is no such table or no image; `all`: all in front of it; `none`.
        farthest_m: Distance up to which boxes are drawn [m].

    Returns:
        Kinds of the boxes that were drawn, keys of `BOX_STYLES`.

    Raises:
        InputError: If `boxes` is none of the three.
    """
    image = view.rgb
    _show(axes, view, image)
    if image is None:
        axes.text(0.5, 0.04, "no image stored in this frame", transform=axes.transAxes, ha="center", color="0.3")
    return _draw_boxes(axes, view, boxes, farthest_m, image is not None)


def draw_depth(axes: Any, view: View, *, boxes: str = "seen", farthest_m: float = FARTHEST_M) -> Any:
    """Draw a depth image on a logarithmic scale, with the boxes of the frame; what is infinitely far is white.

    Arguments and errors are those of `draw_camera`.

    Returns:
        Mappable for a color bar; None if no depth is stored.
    """
    from matplotlib.colors import LogNorm

    depth = view.depth
    if depth is None:
        draw_camera(axes, view, boxes=boxes, farthest_m=farthest_m)
        return None
    shown = _show(axes, view, np.where(np.isfinite(depth), depth, np.nan), cmap="magma_r", norm=LogNorm(*DEPTH_M))
    _draw_boxes(axes, view, boxes, farthest_m, True)
    return shown


def draw_instances(axes: Any, view: View) -> None:
    """Draw the instance image of a camera, a color for each object; nothing is white.

    Args:
        axes: matplotlib axes to draw on.
        view: The camera at one instant; it must have a segmentation.
    """
    ids = view.instance
    _show(axes, view, None if ids is None else object_colors(ids), interpolation="nearest")


def draw_boxes_2d(axes: Any, view: View, color: str = "black") -> None:
    """Draw the rectangles of table `boxes_2d`: solid around visible pixels, dashed around the whole body.

    Args:
        axes: matplotlib axes with an image of `draw_camera`, `draw_depth` or `draw_instances`.
        view: The camera at one instant.
        color: Color of the lines.
    """
    from matplotlib.patches import Rectangle

    for row in view.frame.rows("boxes_2d"):
        if (row["agent"], row["sensor"]) != (view.agent, view.sensor) or not row["pixels"]:
            continue
        for prefix, style in (("", "-"), ("amodal_", "--")):
            u0, v0, u1, v1 = (row[f"{prefix}{side}"] for side in ("u_min", "v_min", "u_max", "v_max"))
            axes.add_patch(Rectangle((u0, v0), u1 - u0, v1 - v0, fill=False, ec=color, ls=style, lw=1.2, clip_on=True))
        if row["v_max"] - row["v_min"] > SMALL_BOX_PX:
            plate = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
            place = max(row["u_min"], 6), row["v_min"] - 8
            axes.text(*place, f"{row['distance']:.0f} m", fontsize=8, va="bottom", bbox=plate, clip_on=True)


def _show(axes: Any, view: View, image: np.ndarray | None, **options: Any) -> Any:
    size = view.camera.intrinsics
    axes.set_facecolor("0.85" if image is None else "white")
    shown = None
    if image is not None:
        shown = axes.imshow(image, extent=(0, size.width, size.height, 0), **options)
    axes.set(xlim=(0, size.width), ylim=(size.height, 0), aspect="equal", xticks=[], yticks=[])
    return shown


def _draw_boxes(axes: Any, view: View, which: str, farthest_m: float, has_image: bool) -> set[str]:
    from matplotlib.collections import LineCollection

    if which not in ("seen", "all", "none"):
        raise InputError(f"boxes={which!r}: seen, all or none is needed; change it")
    rows = view.frame.boxes
    if which == "none" or not len(rows):
        return set()
    own = view.frame.agents[view.agent].row["object_id"]
    distance = np.linalg.norm(np.stack([rows[axis] for axis in "xyz"], axis=1) - view.camera.pose[:3], axis=1)
    is_drawn = (rows["object_id"] != own) & (distance <= farthest_m)
    if which == "seen" and has_image and "box_visibility" in view.frame.data.tables:
        is_drawn &= np.isin(rows["object_id"], seen_objects(view))
    kinds = set()
    corners = rows.corners
    for index in np.flatnonzero(is_drawn):
        lines = box_lines(view, corners[index])
        if not lines:
            continue
        kind = box_kind(rows["agent"][index], rows["category"][index])
        kinds.add(kind)
        axes.add_collection(LineCollection(lines, colors=BOX_STYLES[kind][0], linewidths=1.1, zorder=3))
    return kinds


def seen_objects(view: View) -> np.ndarray:
    """Return the objects of which a camera shows at least one pixel, shape [N]."""
    return np.array([
        row["object_id"] for row in view.frame.rows("box_visibility")
        if row["agent"] == view.agent and row["sensor"] == view.sensor and row["pixels"]
    ], dtype=np.int64)  # fmt: skip


def box_lines(view: View, corners: np.ndarray) -> list[np.ndarray]:
    """Return the edges of a box in the image as lines [px], shape [PIECES + 1, 2] each, none that is out of it.

    Args:
        view: The camera.
        corners: Corners in the world [m], shape [8, 3].
    """
    ends = corners[EDGES]
    depth = view.camera.depths(ends)
    if view.camera.intrinsics.distortion.model != "fisheye":
        ends, depth = _cut_behind(ends, depth)
    share = np.linspace(0.0, 1.0, PIECES + 1)[:, None]
    lines = []
    for first, last in ends:
        line = view.camera.pixels(first * (1.0 - share) + last * share)
        if np.isfinite(line).all() and view.camera.is_inside(line).any():
            lines.append(line)
    return lines


def _cut_behind(ends: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return edges without what lies behind a camera, ends [n, 2, 3] and their depths [n, 2]."""
    is_kept = (depth > NEAREST_M).any(axis=1)
    ends, depth = ends[is_kept].copy(), depth[is_kept].copy()
    for end in (0, 1):
        rows = np.flatnonzero(depth[:, end] < NEAREST_M)
        share = (NEAREST_M - depth[rows, end]) / (depth[rows, 1 - end] - depth[rows, end])
        ends[rows, end] += share[:, None] * (ends[rows, 1 - end] - ends[rows, end])
        depth[rows, end] = NEAREST_M
    return ends, depth
