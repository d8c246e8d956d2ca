"""Charts as inline SVG: axes with ticks, lines, bars, a strip, cells. Colours come from the page's style sheet."""

import math
from collections.abc import Sequence

import numpy as np

from mmw.viz.report.html import text

Range = tuple[float, float]

WIDTH, HEIGHT = 420, 210
"""Size of a chart [user units]; it is shown as wide as there is room."""

TICKS = 5
"""Ticks on an axis, about. Design value."""


def ticks(low: float, high: float, step: float | None = None) -> list[float]:
    """Return round numbers, or multiples of a step, between two values, both included where they are such."""
    step = step or nice_step((high - low) / TICKS)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [round(index * step, 10) for index in range(first, last + 1)]


def nice_step(least: float) -> float:
    """Return the smallest of 1, 2, 5 times a power of ten that is not below a value above 0."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= least * (1.0 - 1e-9))


def padded(values: np.ndarray, least: float, share: float = 0.06) -> Range:
    """Return a range around values with a margin, at least so wide; NaN and infinity are left out."""
    kept = values[np.isfinite(values)]
    low, high = (float(kept.min()), float(kept.max())) if len(kept) else (0.0, 0.0)
    span = max((high - low) * (1.0 + 2.0 * share), least)
    middle = (low + high) / 2.0
    return middle - span / 2.0, middle + span / 2.0


class Chart:
    """One chart. Things are drawn in the order of the calls; `svg` gives the element."""

    def __init__(
        self, x: Range, y: Range, *, x_label: str, y_label: str, below: int = 0, x_step: float | None = None
    ) -> None:
        """Begin a chart.

        Args:
            x: Values at the left and the right edge.
            y: Values at the lower and the upper edge.
            x_label: Quantity and unit.
            y_label: Quantity and unit.
            below: Room for a strip between the chart and its x axis [user units].
            x_step: Distance between the ticks of the x axis; a round one by default.
        """
        self.x, self.y = x, y
        self.left, self.right, self.top, self.bottom = 50.0, WIDTH - 12.0, 8.0, HEIGHT - 36.0 - below
        self.strip_top = self.bottom + 4.0
        self.parts: list[str] = []
        self._axes(x_label, y_label, below, x_step)

    def px(self, value: np.ndarray | float) -> np.ndarray:
        """Return columns of x values."""
        return self.left + (np.asarray(value, dtype=float) - self.x[0]) / (self.x[1] - self.x[0]) * (
            self.right - self.left
        )

    def py(self, value: np.ndarray | float) -> np.ndarray:
        """Return rows of y values."""
        return self.bottom - (np.asarray(value, dtype=float) - self.y[0]) / (self.y[1] - self.y[0]) * (
            self.bottom - self.top
        )

    def _axes(self, x_label: str, y_label: str, below: int, x_step: float | None) -> None:
        base = self.bottom + below
        for value in ticks(*self.y):
            row = float(self.py(value))
            self.parts.append(f'<path class=g d="M{self.left:.1f} {row:.1f}H{self.right:.1f}"/>')
            self.parts.append(f'<text x="{self.left - 6:.1f}" y="{row + 4:.1f}" text-anchor=end>{value:g}</text>')
        for value in ticks(*self.x, x_step):
            column = float(self.px(value))
            self.parts.append(f'<path class=axis d="M{column:.1f} {base:.1f}v4"/>')
            self.parts.append(f'<text x="{column:.1f}" y="{base + 16:.1f}" text-anchor=middle>{value:g}</text>')
        self.parts.append(f'<path class=axis d="M{self.left:.1f} {base:.1f}H{self.right:.1f}"/>')
        middle = (self.left + self.right) / 2.0
        self.parts.append(f'<text x="{middle:.1f}" y="{HEIGHT - 4}" text-anchor=middle>{text(x_label)}</text>')
        row = (self.top + self.bottom) / 2.0
        turn = f"rotate(-90 12 {row:.1f})"
        self.parts.append(f'<text x="12" y="{row:.1f}" transform="{turn}" text-anchor=middle>{text(y_label)}</text>')

    def line(self, x: np.ndarray, y: np.ndarray, kind: str) -> None:
        """Draw a line of a class; where y is NaN there is a gap."""
        columns, rows, commands, is_on = self.px(x), self.py(y), [], False
        for column, row in zip(columns, rows, strict=True):
            if math.isfinite(row):
                commands.append(f"{'L' if is_on else 'M'}{column:.1f} {row:.1f}")
            is_on = math.isfinite(row)
        if len(commands) == 1:
            commands.append("h1")  # a single value is seen as a dot
        if commands:
            self.parts.append(f'<path class={kind} d="{"".join(commands)}"/>')

    def strip(self, x: np.ndarray, is_on: np.ndarray, step: float, kinds: tuple[str, str], row: int = 0) -> None:
        """Draw when something holds as a strip below the chart.

        Args:
            x: Instants, growing, shape [T].
            is_on: Whether it holds at each, shape [T], bool.
            step: Time that an instant stands for.
            kinds: Classes where it holds, and where it does not.
            row: Number of the strip from above.
        """
        top, edges = self.strip_top + 9.0 * row, np.flatnonzero(np.diff(is_on.astype(int))) + 1
        for first, end in zip([0, *edges], [*edges, len(x)], strict=True):
            ends = np.clip([x[first] - step / 2.0, x[end - 1] + step / 2.0], *self.x)
            left, right = self.px(ends)
            kind = kinds[0] if is_on[first] else kinds[1]
            self.parts.append(
                f'<rect class={kind} x="{left:.1f}" y="{top:.1f}" width="{max(right - left, 0.5):.1f}" height="7"/>'
            )

    def bars(self, edges: np.ndarray, counts: Sequence[np.ndarray], kinds: Sequence[str]) -> None:
        """Draw a histogram of stacked bars.

        Args:
            edges: Edges of the bins, shape [B + 1].
            counts: Heights of each stack's part, shape [B] each.
            kinds: Class of each part.
        """
        base, columns = np.zeros(len(edges) - 1), self.px(edges)
        for heights, kind in zip(counts, kinds, strict=True):
            for i in np.flatnonzero(heights):
                low, high = float(self.py(base[i])), float(self.py(base[i] + heights[i]))
                wide = max(columns[i + 1] - columns[i] - 0.8, 0.4)
                self.parts.append(
                    f'<rect class={kind} x="{columns[i] + 0.4:.1f}" y="{high:.1f}" width="{wide:.1f}" '
                    f'height="{low - high:.2f}"/>'
                )
            base = base + heights

    def cells(self, x: np.ndarray, y: np.ndarray, share: np.ndarray) -> None:
        """Draw unit cells around whole numbers, the darker the greater their share, 0 to 1; shape [N] each."""
        wide, tall = float(self.px(1.0) - self.px(0.0)), float(self.py(0.0) - self.py(1.0))
        for column, row, value in zip(self.px(x), self.py(y), share, strict=True):
            self.parts.append(
                f'<rect class=h x="{column - wide / 2:.1f}" y="{row - tall / 2:.1f}" width="{wide:.2f}" '
                f'height="{tall:.2f}" opacity="{0.15 + 0.85 * value:.2f}"/>'
            )

    def svg(self, label: str) -> str:
        """Return the chart.

        Args:
            label: What it shows, for readers that do not see it.
        """
        return (
            f'<svg class=c viewBox="0 0 {WIDTH} {HEIGHT}" role=img aria-label="{text(label)}">'
            f"{''.join(self.parts)}</svg>"
        )
