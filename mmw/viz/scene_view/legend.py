"""Draw legends as images: bars of the color scale with numbers, and lines of text."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from mmw.viz.plots.style import carrier_name, scale_colors
from mmw.viz.scene_view.coverage import Coverage
from mmw.viz.scene_view.path_lines import PathLines

TEXT_PX, BAR_PX, GAP_PX, WIDTH_PX = 13, 12, 8, 190
"""Height of text and of a bar, gap between things, and width of a bar. Design values."""

PLATE, INK = (255, 255, 255, 225), (20, 23, 28, 255)
"""Colors of the plate of a legend and of its text, RGBA."""


@dataclass(frozen=True)
class Bar:
    """Color scale with a title."""

    title: str
    low: float
    """Value of the first color."""
    high: float
    """Value of the last color."""


def bars_of(paths: PathLines | None, coverage: Coverage | None) -> tuple[list[Bar], list[str]]:
    """Return the color scales of paths and coverage, and lines that say what is drawn."""
    bars, lines = [], []
    if paths is not None:
        lines.append(f"{len(paths):,} paths at {carrier_name(paths.carrier_hz)}")
        if len(paths):
            bars.append(Bar("path gain [dB]", *paths.limits_db))
            lines.append(f"strongest: {paths.labels[-1]}")
    if coverage is not None:
        if len(coverage.values):
            bars.append(Bar(f"coverage: {coverage.label}", *coverage.limits))
        else:
            lines.append("coverage: no cell is reached")
    return bars, lines


@lru_cache(maxsize=8)
def font(size_px: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return the font that Pillow comes with, at a size [px]."""
    return ImageFont.load_default(size_px)


def legend_image(bars: Sequence[Bar], lines: Sequence[str], scale: float = 1.0) -> Image.Image:
    """Return a legend on a plate, RGBA.

    Args:
        bars: Color scales, from the top.
        lines: Text below them.
        scale: Size of everything; 1 has text of `TEXT_PX`.
    """
    text_px, bar_px, gap = (round(size * scale) for size in (TEXT_PX, BAR_PX, GAP_PX))
    letters = font(text_px)
    widths = [letters.getlength(text) for text in (*(bar.title for bar in bars), *lines)]
    inner = round(max([WIDTH_PX * scale, *widths]))
    row = round(1.4 * text_px)
    height = len(bars) * (2 * row + bar_px + gap) + len(lines) * row + gap
    image = Image.new("RGBA", (inner + 2 * gap, height + gap), PLATE)
    draw, y = ImageDraw.Draw(image), gap
    for bar in bars:
        draw.text((gap, y), bar.title, INK, letters)
        y += row
        ramp = scale_colors(np.linspace(bar.low, bar.high, inner), bar.low, bar.high)
        image.paste(Image.fromarray(np.broadcast_to(ramp, (bar_px, inner, 3)).copy()), (gap, y))
        y += bar_px + round(0.15 * text_px)
        middle = 0.5 * (bar.low + bar.high)
        for value, place, anchor in ((bar.low, 0.0, "la"), (middle, 0.5, "ma"), (bar.high, 1.0, "ra")):
            draw.text((gap + place * inner, y), f"{value:.0f}", INK, letters, anchor=anchor)
        y += row + gap - round(0.15 * text_px)
    for text in lines:
        draw.text((gap, y), text, INK, letters)
        y += row
    return image
