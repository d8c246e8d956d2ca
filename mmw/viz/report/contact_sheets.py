"""Draw contact sheets: samples of each agent in each weather at some frames, as rows of small pictures."""

import base64
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mmw.config.sensor_spec import SENSORS
from mmw.core.constants import FRAME_RATE_HZ
from mmw.dataset import Dataset
from mmw.viz.plots.samples import drawn_types, has_sample
from mmw.viz.report.figures import Thumb, thumbnail
from mmw.viz.report.html import details, paragraph, plural, text
from mmw.viz.report.inventory import Inventory

FRAMES = 3
"""Frames of a scenario that are shown at most."""

MAX_PICTURES = 480
"""Pictures on a page at most; scenarios share them."""

MIN_PICTURES = 16
"""Pictures that a scenario may have at least."""

MAX_BYTES = 6_000_000
"""Bytes of all pictures at most, before they are written as text, which takes a third more."""


@dataclass(frozen=True)
class Cell:
    """Sensor of an agent, which has a picture."""

    type: str
    agent: str
    sensor: str


class Budget:
    """Pictures and bytes that the page has left."""

    def __init__(self, scenarios: int) -> None:
        """Share the pictures out between scenarios."""
        self.each = max(MIN_PICTURES, MAX_PICTURES // max(scenarios, 1))
        self.bytes = MAX_BYTES

    def spend(self, data: bytes) -> bool:
        """Return whether a picture still fits, and count it."""
        if len(data) > self.bytes:
            self.bytes = 0  # the rest of the page has none, not just what happens to be large
            return False
        self.bytes -= len(data)
        return True


def contact_sheets(data: Dataset, inventory: Inventory, scenario: str, budget: Budget) -> str:
    """Return the contact sheets of a scenario; empty if it has no sensor that can be shown."""
    weathers = inventory.weathers(scenario)
    sampled = sensor_cells(data, scenario, weathers)
    cells = list(sampled)
    if not cells or not weathers:
        return ""
    agents = list(dict.fromkeys(cell.agent for cell in cells))
    shown = list(agents)
    if len(cells) * len(weathers) > budget.each:
        shown = _one_of_each_role(agents)
    cells = [cell for cell in cells if cell.agent in shown][: max(budget.each // len(weathers), 1)]
    max_frames = max(1, min(FRAMES, budget.each // (len(cells) * len(weathers))))
    frames, legends = picture_frames([sampled[cell] for cell in cells], max_frames), dict[str, str]()
    made = [_sheet(data, scenario, frame, weathers, cells, budget, legends) for frame in frames]
    sheets = [sheet for sheet in made if sheet is not None]
    if not sheets:
        return ""
    (first, pictures), *others = sheets
    parts = [f"<h4>{first}</h4>{pictures}", *(details(*sheet) for sheet in others)]
    selected = [f"{len(shown)} of {plural(len(agents), 'agent')}"] if len(shown) < len(agents) else []
    colors = "".join(f" {SENSORS[type_].title}: {words}." for type_, words in legends.items() if words)
    note = (
        f"Shown: {plural(len(sheets), 'frame')} of {plural(len(inventory.frames(scenario)), 'frame')}"
        f"{', ' + selected[0] if selected else ''}. Points from above, ahead is up, 120 m by 90 m, with boxes of "
        f"vehicles and people.{colors}"
    )
    return "".join(parts) + paragraph(note, "note")


def sensor_cells(data: Dataset, scenario: str, weathers: list[str]) -> dict[Cell, set[int]]:
    """Return the sensors of a scenario that have samples in its first weather, and in which frames, by agent."""
    found: dict[Cell, set[int]] = {}
    order = drawn_types()
    for type_ in order:
        table = SENSORS[type_].tables[0].name
        if table in data.tables and weathers:
            names = ["agent", "sensor", "frame"]
            rows = data.read(table, columns=names, scenario=scenario, weather=weathers[0])
            for agent, sensor, frame in zip(*(rows.column(name).to_pylist() for name in names), strict=True):
                found.setdefault(Cell(type_, agent, sensor), set()).add(frame)
    cells = sorted(found, key=lambda cell: (cell.agent, order.index(cell.type), _place(cell.sensor)))
    return {cell: found[cell] for cell in cells}


def _place(sensor: str) -> tuple[int, str]:
    """Sort the usual four cameras as one turns from the left to the rear."""
    usual = ("left", "front", "right", "back")
    return (usual.index(sensor) if sensor in usual else -1, sensor)


def picture_frames(sampled: list[set[int]], max_count: int) -> list[int]:
    """Return frames to show, evenly spread, of those in which most of the sensors have a sample."""
    counts = Counter(frame for frames in sampled for frame in frames)
    best = sorted(frame for frame, number in counts.items() if number == max(counts.values()))
    picked = np.unique(np.linspace(0, len(best) - 1, min(max_count, len(best))).round().astype(int))
    return [best[index] for index in picked]


def _one_of_each_role(agents: list[str]) -> list[str]:
    """Return the first agent of each kind of name, such as cav_1 and rsu_1."""
    kinds: dict[str, str] = {}
    for agent in agents:
        kinds.setdefault(agent.rstrip("0123456789_"), agent)
    return list(kinds.values())


def _sheet(
    data: Dataset, scenario: str, frame: int, weathers: list[str], cells: list[Cell],
    budget: Budget, legends: dict[str, str],
) -> tuple[str, str] | None:  # fmt: skip
    """Return title and pictures of one frame, None if nothing is left to show; legends of types are added."""
    pictures: dict[tuple[str, Cell], str] = {}
    for weather in weathers:
        for cell, thumb, legend in _thumbs(data, scenario, weather, frame, cells):
            legends[cell.type] = legend
            if budget.spend(thumb[1]):
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
    rate_hz = data.frame_rate_hz(scenario)
    title = f"Frame {frame} ({frame / rate_hz:.{2 if rate_hz <= FRAME_RATE_HZ else 3}f} s)"
    return title, f"<div class=sheet tabindex=0>{''.join(strips)}</div>"


def _thumbs(
    data: Dataset, scenario: str, weather: str, frame: int, cells: list[Cell]
) -> Iterator[tuple[Cell, Thumb, str]]:
    """Yield the pictures of one frame and the meaning of their colors; a sensor without a sample has none."""
    agents = data.frame(scenario, weather, frame).agents
    for cell in cells:
        agent = agents.get(cell.agent)
        if agent is not None and has_sample(agent, cell.sensor):
            yield cell, *thumbnail(agent, cell.sensor)
