"""Colours and figure sizes that the plots share."""

from typing import TYPE_CHECKING, Any

import numpy as np

from mmw.core.extras import needed_by

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

BLUE, ORANGE, GREEN, RED, PURPLE, SKY, GREY = (
    "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#8A8F98",
)  # fmt: skip
"""Colours that people with any colour vision tell apart. Source: Okabe and Ito, "Color Universal Design", 2008."""

BOX_STYLES = {
    "connected": (ORANGE, "connected vehicle"),
    "person": (PURPLE, "person"),
    "vehicle": (SKY, "other vehicle"),
}
"""Kind of a box -> its colour on images and sweeps, and its name."""

OBJECT_COLORS = np.array([
    [0.34, 0.71, 0.91], [0.90, 0.62, 0.00], [0.00, 0.62, 0.45], [0.94, 0.89, 0.26], [0.84, 0.37, 0.00],
    [0.80, 0.47, 0.65], [0.53, 0.80, 0.93], [0.60, 0.60, 0.20], [0.67, 0.27, 0.60], [0.87, 0.80, 0.47],
])  # fmt: skip
"""Colours of objects by number, red, green, blue; neighbours in number differ. Source: Okabe-Ito and Tol's `muted`."""

DARK = "#14171C"
"""Background of sweeps."""

PATH_MARKS = {
    "specular": ("o", "specular reflection", 1),
    "diffuse": ("x", "diffuse scattering", 2),
    "transmission": ("s", "transmission", 4),
    "diffraction": ("^", "diffraction", 8),
}
"""Kind of an interaction -> marker, name, number in `paths.interactions`."""


def new_figure(figure: "Figure | SubFigure | None", size: tuple[float, float]) -> "Figure | SubFigure":
    """Return the figure to draw into, a new one of the size [inch] if none is given; it belongs to no window."""
    if figure is not None:
        return figure
    with needed_by("mmw.viz.plots"):
        from matplotlib.figure import Figure
    return Figure(figsize=size, layout="constrained")


def box_kind(agent: Any, category: str) -> str:
    """Return which of `BOX_STYLES` a row of `boxes` has."""
    if agent is not None:
        return "connected"
    return "person" if category == "pedestrian" else "vehicle"


def object_color(object_id: np.ndarray) -> np.ndarray:
    """Return the colour of objects, shape [N, 3]."""
    return OBJECT_COLORS[np.asarray(object_id) % len(OBJECT_COLORS)]


def box_legend(axes: Any, kinds: set[str], **options: Any) -> None:
    """Add a legend of the kinds of boxes that were drawn; none without boxes."""
    from matplotlib.lines import Line2D

    lines = [Line2D([], [], color=color, lw=1.8, label=name) for kind, (color, name) in BOX_STYLES.items()
             if kind in kinds]  # fmt: skip
    if lines:
        axes.legend(handles=lines, fontsize="x-small", **options)


def plain_axes(axes: Any) -> None:
    """Take away the frame lines that carry nothing and add a faint grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(True, color="0.9", lw=0.6)
    axes.set_axisbelow(True)


def side_bar(axes: Any, mappable: Any, label: str) -> None:
    """Add a colour bar as high as the axes to their right."""
    place = axes.inset_axes((1.03, 0.0, 0.035, 1.0))
    axes.figure.colorbar(mappable, cax=place, label=label)


def at_least(axes: Any, span: float) -> None:
    """Widen the y axis around its middle to a span, so that a constant does not look like a change."""
    low, high = axes.get_ylim()
    if high - low < span:
        axes.set_ylim((low + high - span) / 2.0, (low + high + span) / 2.0)
