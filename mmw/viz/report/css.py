"""Style sheet of the report: light and dark by the reader's setting, readable at the width of a phone."""

from pathlib import Path

from mmw.viz.plots.style import BUILDING, ROAD

SERIES_COUNT = 6
"""Colors s0 to s5 of lines, bars and samples; more series begin again."""

COLORS = {
    "page": "#f6f7f9", "card": "#fefefe", "ink": "#1c2128", "muted": "#5a6472", "line": "#d9dee5", "grid": "#e9ecf0",
    "accent": "#0a5fa8", "warn": "#8a4b00", "warnback": "#fff3df", "road": ROAD, "building": BUILDING,
    "other": "#8b94a1", "heat": "#08519c", "s0": "#0072b2", "s1": "#d55e00", "s2": "#00805e", "s3": "#b0508a",
    "s4": "#8a6d00", "s5": "#3c8dbc",
}  # fmt: skip
"""Name of a color -> its value in the light scheme; figures are drawn in these, see `mmw.viz.report.figures`."""

DASHES = ((0, ()), (0, (6, 3)), (0, (2, 2.5)), (0, (8, 3, 2, 3)), (0, (1, 3)), (0, (4, 4)))
"""Dashes of the lines of each series."""

_LIGHT = ";".join(f"--{name}:{value}" for name, value in COLORS.items())
_RULES = Path(__file__).with_name("page.css").read_text(encoding="utf-8")

STYLE = f":root{{color-scheme:light dark;{_LIGHT}}}\n{_RULES}"
"""The whole style sheet; `page.css` has its rules and the dark colors. Nothing in it refers to a file."""
