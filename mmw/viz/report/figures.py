"""Convert figures of matplotlib to inline SVG in the colors of the page, and samples to small pictures."""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from mmw.core.extras import needed_by
from mmw.dataset.frame import Agent, sensor_spec
from mmw.viz.plots.samples import SampleStyle, draw_sample
from mmw.viz.plots.style import new_figure, plain_axes
from mmw.viz.report.css import COLORS
from mmw.viz.report.html import text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE_IN = (5.2, 2.5)
"""Width and height of a chart [inch]; it is shown as wide as there is room."""

STYLE = {
    "svg.fonttype": "none", "svg.hashsalt": "mmw", "font.family": "sans-serif", "font.size": 9.0,
    "font.sans-serif": ["DejaVu Sans"], "text.color": COLORS["ink"], "axes.labelcolor": COLORS["muted"],
    "xtick.color": COLORS["muted"], "ytick.color": COLORS["muted"], "axes.edgecolor": COLORS["muted"],
    "text.parse_math": False,
}  # fmt: skip
"""Settings under which figures are made and written: texts stay texts, names with $ too; equal figures, equal bytes."""

THUMB_PX, DPI = (320, 240), 100
"""Width and height of a small picture [px], and its resolution. Design values."""

EXTENT_M = 60.0
"""Half of the width of a view from above [m]. Design value."""

QUALITY = 70
"""JPEG quality. Design value."""

Thumb = tuple[str, bytes]
"""Media type and bytes."""


@contextmanager
def figure_style() -> Iterator[None]:
    """Make and write figures in the style of the page while this is used.

    Raises:
        ImportError: If matplotlib is not installed.
    """
    with needed_by("mmw report"):
        import matplotlib as mpl
    with mpl.rc_context(STYLE):
        yield


def new_chart(x_label: str, y_label: str) -> tuple["Figure", Any]:
    """Return an empty chart and its axes."""
    figure: Any = new_figure(None, SIZE_IN)
    figure.set_layout_engine("none")
    axes = figure.add_axes((0.12, 0.19, 0.84, 0.78))
    axes.set(xlabel=x_label, ylabel=y_label)
    plain_axes(axes)
    axes.grid(visible=True, color=COLORS["grid"], lw=0.7)
    return figure, axes


def svg(figure: "Figure", label: str) -> str:
    """Return a figure as an SVG element with a label for screen readers; `COLORS` become those of the style sheet."""
    out = io.StringIO()
    figure.savefig(out, format="svg", transparent=True, metadata={"Date": None})
    found = out.getvalue()
    box = re.search(r'viewBox="[^"]*"', found)
    body = found[found.index(">", found.index("<svg")) + 1 :]
    body = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->", "", body, flags=re.DOTALL)
    body = re.sub(r'<g id="[^"]*">', "<g>", body)  # these names would be there in every chart of the page
    body = re.sub(r'"[^"]*"', lambda value: re.sub(r"(\.\d)\d+", r"\1", value[0]), body)
    body = re.sub(r"\s+", " ", body.replace("font-family: 'DejaVu Sans', sans-serif; ", ""))
    for name, color in COLORS.items():
        body = body.replace(color, f"var(--{name})")
    return f'<svg class=c {box[0] if box else ""} role=img aria-label="{text(label)}">{body}'


def thumbnail(agent: Agent, sensor: str) -> tuple[Thumb, str]:
    """Return a small picture of a sample of a sensor, and the meaning of its colors.

    An image fills the picture. A view from above is scaled about the agent until it has the picture's shape.
    """
    is_image = sensor_spec(agent.sensors[sensor]).kind == "image"
    figure: Any = new_figure(None, (THUMB_PX[0] / DPI, THUMB_PX[1] / DPI))
    figure.set_layout_engine("none")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    drawn = draw_sample(axes, agent, sensor, SampleStyle(boxes="none" if is_image else "seen", extent_m=EXTENT_M))
    if axes.get_legend() is not None:
        axes.get_legend().remove()
    wide, tall = abs(np.ptp(axes.get_xlim())), abs(np.ptp(axes.get_ylim()))
    if is_image:
        figure.set_size_inches(THUMB_PX[0] / DPI, max(round(THUMB_PX[0] * tall / wide), 1) / DPI)
    else:
        axes.set_ylim(np.array(axes.get_ylim()) * (wide * THUMB_PX[1] / THUMB_PX[0] / tall))
    figure.set_facecolor(axes.get_facecolor())
    axes.set_axis_off()
    buffer, out = io.BytesIO(), io.BytesIO()
    figure.savefig(buffer, dpi=DPI)
    with Image.open(buffer) as image:
        if is_image:
            image.convert("RGB").save(out, "JPEG", quality=QUALITY, optimize=True)
        else:
            image.convert("RGB").quantize(64, dither=Image.Dither.NONE).save(out, "PNG", optimize=True)
    return ("image/jpeg" if is_image else "image/png", out.getvalue()), drawn.legend
