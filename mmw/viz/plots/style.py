"""Colors and helpers that all drawings share, those of the Rerun viewer too; importing it needs no matplotlib."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.extras import needed_by
from mmw.usd.semantics import CARLA_TAG
from mmw.viz.notebook import show_figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure
    from typing_extensions import TypeVar

    Canvas = TypeVar("Canvas", bound=Figure | SubFigure, default=Figure)
    """The figure or part of one that a function is given to draw into; a new figure by default."""

BLUE, ORANGE, GREEN, RED, PURPLE, SKY, GREY = (
    "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#8A8F98",
)  # fmt: skip
"""Colors that people with any color vision tell apart. Source: Okabe and Ito, "Color Universal Design", 2008."""

AGENT_COLORS = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY)
"""Colors of the lines of agents in turn."""

BOX_STYLES = {
    "connected": (ORANGE, "agent"),
    "person": (PURPLE, "person"),
    "vehicle": (SKY, "other vehicle"),
}
"""Kind of a box -> its color on images and sweeps, and its name."""

GOLDEN = 0.6180339887498949
"""Step of the hue from one object to the next: neighbors in number are far apart in color. Source: golden ratio."""

LABEL_COLORS = np.array([[184, 190, 200], [86, 180, 233], [230, 159, 0]], dtype=np.uint8)
"""Colors of LiDAR returns from surfaces, rain and fog, `lidar.label`, shape [3, 3]."""

SCALE = np.array([[70, 90, 255], [40, 200, 255], [120, 235, 110], [255, 220, 50], [255, 70, 40]], dtype=np.float64)
"""Stops of the color scale of the 3-D viewer from low (blue) to high (red), evenly spaced. Design value."""

GAIN_DB = (-140.0, -70.0)
"""Path gain at the ends of that scale [dB]: the line of sight at 28 GHz loses 80 dB in 8 m and 121 dB in 1 km.
Design value."""

INTENSITY = (0.0, 0.5)
"""LiDAR intensity at the ends of a scale [-]; few returns are brighter. Design value."""

VELOCITY_M_S = 8.0
"""Radial velocity at the ends of a scale [m/s]. Design value."""

DEPTH_M = (2.0, 150.0)
"""Ends of the logarithmic depth scale [m]. Design value."""

CLASS_COLORS = {
    "unlabeled": (90, 90, 90), "road": (128, 64, 128), "sidewalk": (244, 35, 232), "building": (110, 110, 130),
    "wall": (102, 102, 156), "fence": (190, 153, 153), "pole": (153, 153, 153), "traffic_light": (250, 170, 30),
    "traffic_sign": (220, 220, 0), "vegetation": (107, 142, 35), "terrain": (152, 251, 152), "sky": (70, 130, 180),
    "pedestrian": (220, 20, 60), "rider": (255, 0, 0), "car": (60, 110, 255), "truck": (0, 180, 200),
    "bus": (0, 130, 160), "train": (0, 80, 100), "motorcycle": (120, 60, 230), "bicycle": (200, 90, 90),
    "static": (110, 190, 160), "dynamic": (170, 120, 50), "other": (55, 90, 80), "water": (45, 60, 150),
    "road_line": (157, 234, 50), "ground": (81, 0, 81), "bridge": (150, 100, 100), "rail_track": (230, 150, 140),
    "guard_rail": (180, 165, 180),
}  # fmt: skip
"""Class -> color. Source: palette of Cityscapes where it has the class, lighter where that is nearly black; design
values for the others."""

ROAD, BUILDING = "#dfe3e8", "#b9c0ca"
"""Colors of roads and buildings on maps."""

DARK = "#14171C"
"""Background of sweeps."""

PATH_MARKS = {
    "specular": ("o", "specular reflection", 1),
    "diffuse": ("x", "diffuse scattering", 2),
    "transmission": ("s", "transmission", 4),
    "diffraction": ("^", "diffraction", 8),
}
"""Kind of an interaction -> marker, name, number in `paths.interactions`."""


def new_figure(figure: "Canvas | None", size: tuple[float, float]) -> "Canvas":
    """Return the figure to draw into, a new one of the size [inch] if none is given; it belongs to no window."""
    if figure is not None:
        return figure
    with needed_by("mmw.viz.plots"):
        from matplotlib.figure import Figure
    show_figures()
    made: Any = Figure(figsize=size, layout="constrained")
    return made


def carrier_name(carrier_hz: float) -> str:
    """Return a carrier for people: 28 GHz, 4.9 GHz."""
    return f"{carrier_hz / 1e9:.6g} GHz"


def box_kind(agent: Any, category: str) -> str:
    """Return which of `BOX_STYLES` a row of `boxes` has."""
    if agent is not None:
        return "connected"
    return "person" if category == "pedestrian" else "vehicle"


def object_colors(object_id: ArrayLike, is_actor: ArrayLike = True) -> np.ndarray:
    """Return a color for each object, shape [..., 3], uint8: actors bright, the town pale, nothing (-1) white.

    Source of the conversion from hue, saturation and value: A. R. Smith, "Color gamut transform pairs", SIGGRAPH 1978,
    in its form with one clipped ramp a channel.

    Args:
        object_id: Objects, -1 for rain, fog and sky, shape [...].
        is_actor: True for an object that has a box, shape [...].
    """
    ids, actor = np.asarray(object_id, dtype=np.int64)[..., None], np.asarray(is_actor, dtype=bool)[..., None]
    ramp = np.abs(np.mod(ids * GOLDEN * 6.0 + np.array([0.0, 4.0, 2.0]), 6.0) - 3.0) - 1.0
    saturation, value = np.where(actor, 0.85, 0.25), np.where(actor, 1.0, 0.62)
    color = 255.0 * value * (1.0 - saturation * (1.0 - np.clip(ramp, 0.0, 1.0)))
    return np.where(ids < 0, 255, color).astype(np.uint8)


def class_colors(tags: ArrayLike) -> np.ndarray:
    """Return the colors of CARLA's numbers of classes, shape [..., 3], uint8; black for a number that is none."""
    table = np.zeros((256, 3), dtype=np.uint8)
    for label, color in CLASS_COLORS.items():
        table[CARLA_TAG[label]] = color
    return table[np.asarray(tags, dtype=np.uint8)]


def scale_colors(values: ArrayLike, low: float, high: float) -> np.ndarray:
    """Return colors of `SCALE` for numbers between two ends, shape [..., 3], uint8; NaN has the color of `low`."""
    share = (np.asarray(values, dtype=np.float64) - low) / (high - low)
    place = np.clip(np.nan_to_num(share, nan=0.0, neginf=0.0, posinf=1.0), 0.0, 1.0) * (len(SCALE) - 1)
    return np.stack([np.interp(place, np.arange(len(SCALE)), stop) for stop in SCALE.T], axis=-1).astype(np.uint8)


def velocity_colors(velocity: ArrayLike) -> np.ndarray:
    """Return colors of radial velocities [m/s], shape [..., 3], uint8: approaching blue, receding red, rest gray."""
    share = np.clip(np.asarray(velocity, dtype=np.float64) / VELOCITY_M_S, -1.0, 1.0)[..., None]
    rest, away, near = np.array([[210.0, 210, 210], [255, 60, 40], [60, 110, 255]])
    return (rest + np.abs(share) * (np.where(share > 0.0, away, near) - rest)).astype(np.uint8)


def box_legend(axes: Any, kinds: set[str], **options: Any) -> None:
    """Add a legend of the kinds of boxes that were drawn; none without boxes."""
    from matplotlib.lines import Line2D

    lines = [Line2D([], [], color=color, lw=1.8, label=name) for kind, (color, name) in BOX_STYLES.items()
             if kind in kinds]  # fmt: skip
    if lines:
        axes.legend(handles=lines, fontsize="x-small", **options)


def label_place(axes: Any, name: str, place: ArrayLike, offset: float = 6.0, **text: Any) -> None:
    """Write a name on a white plate beside a place, `offset` points to the right and above."""
    plate = {"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.0}
    style = {"textcoords": "offset points", "fontsize": "small", "zorder": 8, "bbox": plate}
    axes.annotate(name, place, (offset, offset), **style | text)


def plain_axes(axes: Any) -> None:
    """Remove the upper and right frame lines and add a faint grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(True, color="0.9", lw=0.6)
    axes.set_axisbelow(True)


def shade_blocked(axes: Any, time_s: np.ndarray, is_los: np.ndarray, step_s: float, color: str = RED) -> None:
    """Shade the times at which a link has no line of sight.

    Args:
        axes: matplotlib axes with the time [s] along x.
        time_s: Times, growing [s], shape [T].
        is_los: Whether the line of sight is free in each, shape [T], bool.
        step_s: Time from one to the next [s].
        color: Color of the shade.
    """
    half = step_s / 2.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], ~is_los, [False]]).astype(int)))
    for number, (first, end) in enumerate(edges.reshape(-1, 2)):
        label = "no line of sight" if number == 0 else None
        ends = time_s[first] - half, time_s[end - 1] + half
        axes.axvspan(*ends, color=color, alpha=0.16, lw=0, label=label, zorder=1)


def side_bar(axes: Any, mappable: Any, label: str) -> None:
    """Add a color bar as high as the axes to their right."""
    place = axes.inset_axes((1.03, 0.0, 0.035, 1.0))
    plain_ticks(axes.figure.colorbar(mappable, cax=place, label=label))


def plain_ticks(bar: Any) -> None:
    """Write the numbers of a logarithmic color bar as 2, 5, 10, 20 ... instead of powers of ten."""
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    if isinstance(bar.norm, LogNorm):
        bar.locator, bar.formatter = LogLocator(subs=(1.0, 2.0, 5.0)), FuncFormatter(lambda value, _: f"{value:g}")
        bar.minorformatter = NullFormatter()
        bar.update_ticks()


def gain_colors() -> Any:
    """Return the color map of path gains: plasma without its yellow end, which does not show on white."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["plasma"](np.linspace(0.0, 0.88, 256)))


def at_least(axes: Any, span: float) -> None:
    """Widen the y axis around its middle to a span, so that a constant does not look like a change."""
    low, high = axes.get_ylim()
    if high - low < span:
        axes.set_ylim((low + high - span) / 2.0, (low + high + span) / 2.0)
