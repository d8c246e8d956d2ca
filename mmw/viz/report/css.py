"""Style sheet of the report: light and dark by the reader's setting, readable at the width of a phone."""

from pathlib import Path

from mmw.viz.plots.style import BUILDING, ROAD

RULES = Path(__file__).with_name("page.css")
"""Rules of the style sheet, which name colors by variables."""

SERIES_COUNT = 6
"""Colors s0 to s5 of lines, bars and samples; more series begin again."""

COLORS = {
    "page": "#f6f7f9", "card": "#fefefe", "ink": "#1c2128", "muted": "#5a6472", "line": "#d9dee5", "grid": "#e9ecf0",
    "accent": "#0a5fa8", "warn": "#8a4b00", "warnback": "#fff3df", "road": ROAD, "building": BUILDING,
    "other": "#8b94a1", "heat": "#08519c", "s0": "#0072b2", "s1": "#d55e00", "s2": "#00805e", "s3": "#b0508a",
    "s4": "#8a6d00", "s5": "#3c8dbc",
}  # fmt: skip
"""Name of a color -> its value in the light scheme; figures are drawn in these, see `mmw.viz.report.figures`."""

_DARK = {
    "page": "#12151a", "card": "#1b2027", "ink": "#e6e9ee", "muted": "#a2acb9", "line": "#333b46", "grid": "#2a313a",
    "accent": "#6cb6f5", "warn": "#ffc46b", "warnback": "#3a2c12", "road": "#343c47", "building": "#59636f",
    "other": "#8b94a1", "heat": "#7cc4ff", "s0": "#5ab4ee", "s1": "#ff8f5a", "s2": "#3cc79c", "s3": "#e39bc6",
    "s4": "#e8c547", "s5": "#9ad1f2",
}  # fmt: skip

DASHES = ((0, ()), (0, (6, 3)), (0, (2, 2.5)), (0, (8, 3, 2, 3)), (0, (1, 3)), (0, (4, 4)))
"""Dashes of the lines of each series."""


def _variables(colors: dict[str, str]) -> str:
    return ";".join(f"--{name}:{value}" for name, value in colors.items())


def _series() -> str:
    return "".join(
        f"i.s{i}{{background:var(--s{i})}}i.line.s{i}{{background:none;border-top:2.5px "
        f"{'solid' if i == 0 else 'dashed' if i % 2 else 'dotted'} var(--s{i})}}"
        for i in range(SERIES_COUNT)
    )


STYLE = (
    f":root{{color-scheme:light dark;{_variables(COLORS)}}}"
    f"@media(prefers-color-scheme:dark){{:root{{{_variables(_DARK)}}}}}"
    "\n" + RULES.read_text(encoding="utf-8") + _series()
)
"""The whole style sheet. Nothing in it refers to a file."""
