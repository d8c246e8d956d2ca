"""Write the results of checks as one Markdown page with figures."""

from collections.abc import Sequence
from pathlib import Path

from mmw.core.extras import needed_by
from mmw.validation.run import Result

SIZE_IN = (6.4, 3.4)
"""Width and height of a figure [inch]."""

HEAD = (
    "# Validation\n\nThe simulator beside measurements, standards and closed forms. Every row is code "
    "(`mmw.validation.checks`); `mmw validate --page FILE` writes this page.\n\n"
    "- **green**: the computed value lies in the range that agrees. The reason of the range stands with each row.\n"
    "- **red**: it does not. Why, and what would mend it, stands with the row.\n"
    "- *seen* says how a published number was checked: in the document, in its abstract, in the code of another "
    "project that implements it, or only as other documents cite it.\n"
)

COLORS = {True: "🟢 green", False: "🔴 red"}


def write_page(results: Sequence[Result], file: Path) -> None:
    """Write the page, and its figures into a folder of its name beside it.

    Args:
        results: Results in the order of the page.
        file: Markdown file; an older one is replaced.

    Raises:
        ImportError: If Matplotlib is not installed.
    """
    figures = file.with_suffix("")
    figures.mkdir(parents=True, exist_ok=True)
    green = sum(result.is_green for result in results)
    parts = [HEAD, f"**{green} of {len(results)} rows are green.**\n"]
    for topic in dict.fromkeys(result.check.topic for result in results):
        own = [result for result in results if result.check.topic == topic]
        parts.append(f"## {topic.replace('_', ' ').capitalize()}\n\n{_table(own)}\n")
        parts += [_section(result, figures) for result in own]
    file.write_text("\n".join(parts), encoding="utf-8")


def _table(results: Sequence[Result]) -> str:
    lines = ["| row | computed | published | agrees | |", "|---|---|---|---|---|"]
    for result in results:
        check = result.check
        computed, published = (
            _quantity(value, check.unit) for value in (result.measurement.value, check.reference.value)
        )
        agrees = f"{check.reference.low:.3g} to {check.reference.high:.3g}"
        lines.append(f"| {check.title} | {computed} | {published} | {agrees} | {COLORS[result.is_green]} |")
    return "\n".join(lines)


def _quantity(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}".strip()


def _section(result: Result, figures: Path) -> str:
    """Return what is to be said about a row, with its figure."""
    check, measurement = result.check, result.measurement
    sources = "; ".join(f"[{own.title}]({own.link}), {own.place} (seen: {own.seen})" for own in check.sources)
    lines = [f"### {check.title}", "", f"- `{check.name}`: {check.computed}", f"- Published: {sources}"]
    lines.append(f"- Range: {check.tolerance}")
    if measurement.detail:
        lines.append(f"- Found: {measurement.detail}")
    if check.known_red:
        lines.append(f"- Red: {check.known_red}")
    if measurement.draw is not None:
        name = f"{check.name}.svg"
        _draw(result, figures / name)
        lines += ["", f"![{check.title}]({figures.name}/{name})"]
    return "\n".join([*lines, ""])


def _draw(result: Result, file: Path) -> None:
    """Draw the figure of a row."""
    with needed_by("mmw validate --page"):
        import matplotlib as mpl
        from matplotlib.figure import Figure
    draw = result.measurement.draw
    assert draw is not None
    with mpl.rc_context({"svg.hashsalt": "mmw", "svg.fonttype": "none", "font.size": 9.0}):
        figure = Figure(figsize=SIZE_IN, layout="constrained")
        axes = figure.add_subplot()
        axes.grid(visible=True, color="#e3e6ea", lw=0.7)
        draw(axes)
        figure.savefig(file, format="svg", metadata={"Date": None}, facecolor="white")
