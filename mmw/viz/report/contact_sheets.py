"""Contact sheets: what each agent sensed in each weather at some frames, as rows of small pictures."""

import base64
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from mmw.core.constants import FRAME_DT
from mmw.dataset import Dataset
from mmw.viz.report.html import details, paragraph, plural, text
from mmw.viz.report.inventory import Inventory
from mmw.viz.report.thumbnails import depth_thumb, image_thumb, radar_thumb, sweep_thumb

FRAMES = 3
"""Frames of a scenario that are shown at most."""

MAX_PICTURES = 480
"""Pictures on a page at most; scenarios share them."""

MIN_PICTURES = 16
"""Pictures that a scenario may have at least."""

MAX_BYTES = 6_000_000
"""Bytes of all pictures at most, before they are written as text, which takes a third more."""

Thumb = tuple[str, bytes]
"""Media type and bytes."""


@dataclass(frozen=True)
class Cell:
    """One picture to be: a sensor of an agent."""

    table: str
    agent: str
    sensor: str


class Budget:
    """Pictures and bytes that the page has left."""

    def __init__(self, scenarios: int) -> None:
        """Share the pictures out between scenarios."""
        self.each = max(MIN_PICTURES, MAX_PICTURES // max(scenarios, 1))
        self.bytes = MAX_BYTES

    def take(self, data: bytes) -> bool:
        """Return whether a picture still fits, and count it."""
        if len(data) > self.bytes:
            self.bytes = 0  # the rest of the page has none, not just what happens to be large
            return False
        self.bytes -= len(data)
        return True


def _rgb(row: dict[str, Any]) -> Thumb | None:
    return None if row["image"] is None else image_thumb(row["image"]["bytes"])


def _lidar(row: dict[str, Any]) -> Thumb:
    return sweep_thumb(*(np.asarray(row[name], dtype=np.float32) for name in ("x", "y", "intensity")))


def _radar(row: dict[str, Any]) -> Thumb:
    return radar_thumb(*(np.asarray(row[name], dtype=np.float64) for name in ("range", "azimuth", "velocity")))


def _depth(row: dict[str, Any]) -> Thumb | None:
    image = None if row["image"] is None else row["image"]["bytes"]
    if image is None and row["depth_m"] is None:
        return None
    return depth_thumb(image, row["depth_m"], (row["width"], row["height"]))


TABLES: dict[str, tuple[tuple[str, ...], Callable[[dict[str, Any]], Thumb | None]]] = {
    "rgb": (("image",), _rgb),
    "depth": (("image", "depth_m"), _depth),
    "lidar": (("x", "y", "intensity"), _lidar),
    "radar": (("range", "azimuth", "velocity"), _radar),
}
"""Table -> columns that a picture needs, and what draws a row; in the order of a sheet."""


def contact_sheets(data: Dataset, inventory: Inventory, scenario: str, budget: Budget) -> str:
    """Return the contact sheets of a scenario; empty if it has no sensor that can be shown."""
    weathers = inventory.weathers(scenario)
    taken = sensor_cells(data, scenario, weathers)
    cells = list(taken)
    if not cells or not weathers:
        return ""
    agents = list(dict.fromkeys(cell.agent for cell in cells))
    shown = list(agents)
    if len(cells) * len(weathers) > budget.each:
        shown = _one_of_each_role(agents)
    cells = [cell for cell in cells if cell.agent in shown][: max(budget.each // len(weathers), 1)]
    most = max(1, min(FRAMES, budget.each // (len(cells) * len(weathers))))
    frames = picture_frames([taken[cell] for cell in cells], most)
    size = {row["sensor"]: (row["width"], row["height"]) for row in _cameras(data, scenario)}
    made = [_sheet(data, scenario, frame, weathers, cells, size, budget) for frame in frames]
    sheets = [sheet for sheet in made if sheet is not None]
    if not sheets:
        return ""
    (first, pictures), *others = sheets
    parts = [f"<h4>{first}</h4>{pictures}", *(details(*sheet) for sheet in others)]
    left_out = [f"{len(shown)} of {plural(len(agents), 'agent')}"] if len(shown) < len(agents) else []
    note = (
        f"Shown: {plural(len(sheets), 'frame')} of {plural(len(inventory.frames(scenario)), 'frame')}"
        f"{', ' + left_out[0] if left_out else ''}. Sweeps and radar samples from above, ahead is up, 90 m by 120 m "
        "(sweep: bright is a strong return; radar: blue approaches, orange recedes); depth: near is bright, white is "
        "nothing."
    )
    return "".join(parts) + paragraph(note, "note")


def sensor_cells(data: Dataset, scenario: str, weathers: list[str]) -> dict[Cell, set[int]]:
    """Return the sensors of a scenario that have samples in its first weather, and in which frames, by agent."""
    found: dict[Cell, set[int]] = {}
    for table in TABLES:
        if table in data.tables and weathers:
            names = ["agent", "sensor", "frame"]
            rows = data.read(table, columns=names, scenario=scenario, weather=weathers[0])
            for agent, sensor, frame in zip(*(rows.column(name).to_pylist() for name in names), strict=True):
                found.setdefault(Cell(table, agent, sensor), set()).add(frame)
    order = list(TABLES)
    cells = sorted(found, key=lambda cell: (cell.agent, order.index(cell.table), _place(cell.sensor)))
    return {cell: found[cell] for cell in cells}


def _place(sensor: str) -> tuple[int, str]:
    """Sort the usual four cameras as one turns from the left to the rear."""
    usual = ("left", "front", "right", "back")
    return (usual.index(sensor) if sensor in usual else -1, sensor)


def picture_frames(taken: list[set[int]], most: int) -> list[int]:
    """Return frames to show, evenly spread, of those in which most of the sensors have a sample.

    Args:
        taken: Frames of each sensor.
        most: Frames at most.
    """
    counts = Counter(frame for frames in taken for frame in frames)
    best = sorted(frame for frame, number in counts.items() if number == max(counts.values()))
    picked = np.unique(np.linspace(0, len(best) - 1, min(most, len(best))).round().astype(int))
    return [best[index] for index in picked]


def _one_of_each_role(agents: list[str]) -> list[str]:
    """Return the first agent of each kind of name, such as cav_1 and rsu_1."""
    kinds: dict[str, str] = {}
    for agent in agents:
        kinds.setdefault(agent.rstrip("0123456789_"), agent)
    return list(kinds.values())


def _cameras(data: Dataset, scenario: str) -> list[dict[str, Any]]:
    if "sensors" not in data.tables:
        return []
    return data.read("sensors", columns=["sensor", "width", "height"], scenario=scenario).to_pylist()


def _sheet(
    data: Dataset, scenario: str, frame: int, weathers: list[str], cells: list[Cell],
    size: dict[str, tuple[int, int]], budget: Budget,
) -> tuple[str, str] | None:  # fmt: skip
    """Return title and pictures of one frame; None if nothing is left to show."""
    pictures: dict[tuple[str, Cell], str] = {}
    for weather in weathers:
        for cell, thumb in _thumbs(data, scenario, weather, frame, cells, size):
            if budget.take(thumb[1]):
                source = f"data:{thumb[0]};base64,{base64.b64encode(thumb[1]).decode()}"
                label = f"{cell.agent} {cell.sensor}, {weather}, frame {frame}"
                pictures[weather, cell] = (
                    f'<figure><img src="{source}" alt="{text(label)}" loading=lazy>'
                    f"<figcaption>{text(cell.sensor)}</figcaption></figure>"
                )
    strips = []
    for agent in dict.fromkeys(cell.agent for cell in cells):
        for weather in weathers:
            found = [pictures[key] for cell in cells if cell.agent == agent and (key := (weather, cell)) in pictures]
            if found:
                strips.append(
                    f"<div class=strip><b>{text(agent)}<small>{text(weather)}</small></b>{''.join(found)}</div>"
                )
    if not strips:
        return None
    title = f"Frame {frame} ({frame * FRAME_DT:.2f} s)"
    return title, f"<div class=sheet tabindex=0>{''.join(strips)}</div>"


def _thumbs(
    data: Dataset, scenario: str, weather: str, frame: int, cells: list[Cell], size: dict[str, tuple[int, int]]
) -> Iterator[tuple[Cell, Thumb]]:
    """Yield the pictures of one frame; a sensor without a sample has none."""
    for table in dict.fromkeys(cell.table for cell in cells):
        columns, draw = TABLES[table]
        names = ["agent", "sensor", *columns]
        rows = data.read(table, columns=names, scenario=scenario, weather=weather, frames=range(frame, frame + 1))
        for index in range(rows.num_rows):
            row = _row(rows.slice(index, 1))
            cell = Cell(table, row["agent"], row["sensor"])
            row["width"], row["height"] = size.get(cell.sensor, (0, 0))
            thumb = draw(row) if cell in cells else None
            if thumb is not None:
                yield cell, thumb


def _row(one: pa.Table) -> dict[str, Any]:
    """Return a row with its lists as arrays."""
    found: dict[str, Any] = {}
    for name in one.column_names:
        value = one.column(name)[0]
        is_list = pa.types.is_list(value.type) and value.is_valid
        found[name] = value.values.to_numpy(zero_copy_only=False) if is_list else value.as_py()
    return found
