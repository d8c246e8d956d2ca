"""Generate random rows of a dataset again and compare them with the stored ones bit for bit."""

import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mmw.core.device import machine_kind
from mmw.generation.regenerate import RowRegenerator, differing_columns, other_machine, stored_rows
from mmw.storage.finding import Finding
from mmw.storage.manifest import read_markers
from mmw.storage.schemas import TABLES, table_spec
from mmw.storage.store import Root, store_of


@dataclass(frozen=True)
class RowName:
    """One row of a dataset."""

    table: str
    scenario: str
    weather: str | None
    """None for a table that is the same in every weather."""
    frame: int | None
    key: dict[str, Any]
    """The rest of the table's key."""
    path: str
    """File, relative to the dataset folder."""
    device: str
    """Kind of machine that generated it."""

    def __str__(self) -> str:
        parts = {"scenario": self.scenario, "weather": self.weather, "frame": self.frame, **self.key}
        return " ".join(f"{name}={value}" for name, value in parts.items() if value is not None)


def choose_rows(root: Root, count: int, seed: int) -> list[RowName]:
    """Return random rows of a dataset, by scenario and frame; every table is as likely as any other."""
    store = store_of(root)
    files: dict[str, list[tuple[dict, dict]]] = {}
    for marker in read_markers(store):
        for file in marker["files"]:
            if file["rows"] and file["table"] in TABLES:
                files.setdefault(file["table"], []).append((marker, file))
    draw = random.Random(seed)
    found: dict[str, RowName] = {}
    for _ in range(count if files else 0):
        table = draw.choice(sorted(files))
        ((marker, file),) = draw.choices(files[table], weights=[file["rows"] for _, file in files[table]])
        row = draw.randrange(file["rows"])
        (key,) = store.read_columns(file["path"], table_spec(table).key).slice(row, 1).to_pylist()
        frame = key.pop("frame", None)
        device = str(marker.get("device") or "")
        weather = marker["weather"] if table_spec(table).of_weather else None
        name = RowName(table, marker["scenario"], weather, frame, key, file["path"], device)
        found[f"{table} {name}"] = name
    return sorted(found.values(), key=lambda name: (name.scenario, str(name.weather), name.frame or 0, name.table))


def rerender(
    root: Root, count: int, *, seed: int = 0, device: str = "auto", tell: Callable[[str], None] = lambda _: None
) -> list[Finding]:
    """Generate random rows again and return those that differ from the stored ones.

    Args:
        root: Dataset with intact files.
        count: Rows to draw, see `choose_rows`.
        seed: Seed of the draw.
        device: Warp device name, or `auto`. Rows are equal bit for bit only on the kind of machine that generated
            them; on another one a difference is a note, not an error.
        tell: Receives one line for each compared row.

    Raises:
        InputError: If the folder is not a dataset, or its configuration or stages cannot be used.
    """
    findings = []
    with RowRegenerator(root, device) as regenerator:
        for name in choose_rows(root, count, seed):
            columns = compare_row(regenerator, name)
            tell(f"{name.table} {name}: {'differs in ' + ', '.join(columns) if columns else 'equal'}")
            if columns:
                text = f"row {name} made again differs in {', '.join(columns)}"
                now = machine_kind(regenerator.device)
                if name.device == now:
                    findings.append(Finding("regenerated", name.path, text))
                else:
                    findings.append(Finding("note", name.path, f"{text}; {other_machine(name.device, now)}"))
    return findings


def compare_row(regenerator: RowRegenerator, name: RowName) -> list[str]:
    """Return the columns in which a regenerated row differs from the stored one; `row` if there is no such row."""
    named = {"scenario": name.scenario, "weather": name.weather, "frame": name.frame}
    named = {column: value for column, value in named.items() if value is not None}
    made = regenerator.rows(name.table, **{**named, **name.key})
    stored = stored_rows(regenerator.address, name.table, {**named, **name.key})
    if made.num_rows != 1 or stored.num_rows != 1:
        return ["row"]
    return differing_columns(made, stored)
