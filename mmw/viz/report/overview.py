"""Summarize a dataset in numbers: counts and sizes of every table, for each scenario and weather."""

import numpy as np

from mmw.config.sensor_spec import SENSORS
from mmw.storage.schemas import TABLES
from mmw.viz.report.html import count, details, paragraph, plural, size, table, tiles
from mmw.viz.report.inventory import LISTED, Inventory, quick_check

TILES = {"links": "link rows", "path_gains": "radio paths", "boxes": "boxes"}
"""Table without a sensor -> name of its rows on top of the page."""


def _tiles() -> dict[str, str]:
    """Return the name of the rows of each table on top of the page."""
    sensors = {
        spec.tables[0].name: f"{spec.title} {'images' if spec.kind == 'image' else 'samples'}"
        for spec in SENSORS.values()
    }
    return sensors | TILES


def state(inventory: Inventory, scenarios: list[str]) -> str:
    """Return a warning for a dataset that is not finished, and notes; empty if there is nothing to say."""
    parts = []
    if not inventory.shards:
        parts.append(paragraph("This dataset is not finished: no shard is complete yet.", "warning"))
    elif inventory.pending:
        listed = "; ".join(inventory.pending[:LISTED]) + ("; and more" if len(inventory.pending) > LISTED else "")
        parts.append(
            paragraph(
                f"This dataset is not finished: {plural(len(inventory.pending), 'part is', 'parts are')} pending "
                f"({listed}), of {plural(inventory.planned or 0, 'planned shard')} and the tables without frames. The "
                "page shows the finished parts. Run the same configuration again to continue.",
                "warning",
            )
        )
    if scenarios != inventory.scenarios:
        left = len(inventory.scenarios) - len(scenarios)
        parts.append(paragraph(f"{plural(left, 'other scenario')} of this dataset not shown.", "note"))
    return "".join(parts) + "".join(paragraph(f"{note}.", "warning") for note in inventory.notes)


def facts(inventory: Inventory, scenarios: list[str]) -> str:
    """Return the boxes on top of the page."""
    total = inventory.sizes(scenarios, "table")
    frames = sum(inventory.frame_count(s, w) for s in scenarios for w in inventory.weathers(s))
    weathers = {weather for scenario in scenarios for weather in inventory.weathers(scenario)}
    seconds = sum(len(inventory.frames(scenario)) / inventory.frame_rate_hz(scenario) for scenario in scenarios)
    found = [
        ("scenarios", count(len(scenarios))), ("weathers", count(len(weathers))), ("frames", count(frames)),
        ("simulated time", f"{seconds:,.2f} s"),
    ]  # fmt: skip
    found += [(name, count(total[table_,][1])) for table_, name in _tiles().items() if total[table_,][1]]
    return tiles([*found, ("size", size(sum(length for _, _, length in total.values())))])


def counts_section(inventory: Inventory, scenarios: list[str]) -> str:
    """Return counts and sizes of every table, and of every table in every scenario and weather."""
    total = inventory.sizes(scenarios, "table")
    total[("all",)] = sum(total.values(), np.zeros(3, dtype=np.int64))
    rows = [
        (name, count(files), count(some), size(length), _meaning(name))
        for (name,), (files, some, length) in total.items()
    ]
    parts = [table(("table", "files", "rows", "size", "one row is"), rows, numbers=range(1, 4))]
    parts.append(details("Rows and sizes of each scenario and weather", _matrix(inventory, scenarios)))
    return "".join(parts)


def _meaning(name: str) -> str:
    """Return the first sentence of what a row of a table is."""
    return TABLES[name].doc.split(".")[0].replace("`", "") if name in TABLES else ""


def _matrix(inventory: Inventory, scenarios: list[str]) -> str:
    sizes = inventory.sizes(scenarios, "table", "scenario", "weather")
    names = list(dict.fromkeys(name for name, _, _ in sizes))
    rows = []
    for scenario in scenarios:
        for weather in [*inventory.weathers(scenario), None]:
            own = [sizes.get((name, scenario, weather)) for name in names]
            if any(one is not None for one in own):
                frames = count(inventory.frame_count(scenario, weather)) if weather is not None else "-"
                cells = [f"{count(one[1])} ({size(one[2])})" if one is not None else "-" for one in own]
                length = size(sum(one[2] for one in own if one is not None))
                rows.append((scenario, weather if weather is not None else "all", frames, *cells, length))
    head = ("scenario", "weather", "frames", *names, "size")
    return table(head, rows, numbers=range(2, len(head)), caption="Rows, and bytes on disk.")


def check_section(inventory: Inventory) -> str:
    """Return the checks made and the problems found."""
    checked, wrong = quick_check(inventory)
    words = "Checked: " + "; ".join(checked) + ". Not checked: the content of the files; mmw verify reads them all."
    if not wrong:
        return paragraph("No problem found.") + paragraph(words, "note")
    listed = "; ".join(wrong[:LISTED]) + ("; and more" if len(wrong) > LISTED else "")
    return paragraph(f"{plural(len(wrong), 'problem', 'problems')}: {listed}.", "warning") + paragraph(words, "note")
