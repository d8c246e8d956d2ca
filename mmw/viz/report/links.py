"""Radio links over time: gain in every weather, when the line of sight is free, and a table of the links."""

from dataclasses import dataclass

import numpy as np

from mmw.core.constants import FRAME_DT
from mmw.dataset import Dataset
from mmw.viz.report.css import SERIES_COUNT
from mmw.viz.report.html import card, legend, paragraph, plural, table
from mmw.viz.report.inventory import Inventory
from mmw.viz.report.sampling import sample_range, sampled
from mmw.viz.report.svg import Chart, padded

MAX_FRAMES = 5000
"""Frames of a scenario and weather whose links are read at most."""

MAX_POINTS = 300
"""Points of a line at most, on a page of few scenarios; more scenarios share them."""

MIN_POINTS = 80
"""Points of a line that a page of many scenarios still has."""

MAX_LINKS = 12
"""Links of a scenario and carrier that get a chart at most; vehicle-to-infrastructure links come first."""

COLUMNS = ("frame", "agent", "peer", "carrier_hz", "link", "path_count", "is_los", "gain_db", "rms_delay_s")
"""Columns of table `links` that are read."""

RadioDevices = tuple[str, str]
"""Transmitter and receiver."""


@dataclass(frozen=True)
class LinkRows:
    """Rows of table `links` of one scenario."""

    frames: range
    """Frames that were read."""
    by_weather: dict[str, dict[str, np.ndarray]]
    """Weather -> `COLUMNS`, sorted by frame."""

    def of(self, weather: str, ends: RadioDevices, carrier_hz: float) -> dict[str, np.ndarray]:
        """Return the rows of one link at one carrier."""
        rows = self.by_weather[weather]
        is_it = (rows["peer"] == ends[0]) & (rows["agent"] == ends[1]) & (rows["carrier_hz"] == carrier_hz)
        return {name: values[is_it] for name, values in rows.items()}

    @property
    def ends(self) -> list[tuple[str, RadioDevices]]:
        """Kind and ends of every link, v2i before v2v."""
        found = {
            (str(kind), (str(peer), str(agent)))
            for rows in self.by_weather.values()
            for kind, peer, agent in zip(rows["link"], rows["peer"], rows["agent"], strict=True)
        }
        return sorted(found)

    @property
    def carriers(self) -> list[float]:
        """Carriers [Hz]."""
        return sorted({float(value) for rows in self.by_weather.values() for value in np.unique(rows["carrier_hz"])})


def read_links(data: Dataset, inventory: Inventory, scenario: str) -> LinkRows | None:
    """Return the links of a scenario in all its weathers; None if it has none."""
    weathers = inventory.weathers(scenario)
    if "links" not in data.tables or not weathers:
        return None
    frames, found = sample_range(inventory.frames(scenario), MAX_FRAMES), {}
    for weather in weathers:
        rows = data.numpy("links", columns=COLUMNS, scenario=scenario, weather=weather, frames=frames)
        if len(rows["frame"]):
            order = np.argsort(rows["frame"], kind="stable")
            found[weather] = {name: values[order] for name, values in rows.items()}
    return LinkRows(frames, found) if found else None


def link_section(rows: LinkRows, scenarios: int) -> str:
    """Return charts and table of the links of a scenario.

    Args:
        rows: The links.
        scenarios: Scenarios on the page, which share the points of lines.
    """
    points = max(MIN_POINTS, min(MAX_POINTS, 4 * MAX_POINTS // max(scenarios, 1)))
    step = max(1, -(-len(rows.frames) // points))
    drawn = rows.frames[::step]
    ends = rows.ends
    shown = ends[:MAX_LINKS]
    weathers = list(rows.by_weather)
    entries = [(f"line s{i % SERIES_COUNT}", name) for i, name in enumerate(weathers)]
    parts = [legend([*entries, ("free", "line of sight is free"), ("blocked", "blocked")])]
    for carrier in rows.carriers:
        charts = [
            card(f"{peer} to {agent}, {carrier / 1e9:g} GHz", _chart(rows, (peer, agent), carrier, drawn))
            for _, (peer, agent) in shown
        ]
        parts.append(f"<div class=grid>{''.join(charts)}</div>")
    note = f"Gain: sum of the powers of the paths, a gap is no path. Lines show {sampled(drawn)}."
    if len(shown) < len(ends):
        note += f" Charts of {len(shown)} of {plural(len(ends), 'link')}; the table has all."
    parts.append(paragraph(note, "note"))
    parts.append(link_table(rows))
    return "".join(parts)


def _chart(rows: LinkRows, ends: RadioDevices, carrier_hz: float, drawn: range) -> str:
    lines = []
    for weather in rows.by_weather:
        own = rows.of(weather, ends, carrier_hz)
        kept = np.isin(own["frame"], np.asarray(drawn))
        lines.append({name: values[kept] for name, values in own.items()})
    gains = np.concatenate([line["gain_db"].astype(float) for line in lines])
    time = np.asarray(rows.frames) * FRAME_DT
    strips = _distinct_sights(lines)
    chart = Chart(
        (float(time[0]), float(time[-1]) + rows.frames.step * FRAME_DT), padded(gains, 6.0), x_label="time [s]",
        y_label="path gain [dB]", below=4 + 9 * len(strips),
    )  # fmt: skip
    for number, line in enumerate(lines):
        chart.line(*_with_gaps(line, drawn.step), f"s{number % SERIES_COUNT}")
    for number, (frame, is_los) in enumerate(strips):
        chart.strip(frame * FRAME_DT, is_los, drawn.step * FRAME_DT, ("free", "blocked"), number)
    return chart.svg(f"Path gain of {ends[0]} to {ends[1]} at {carrier_hz / 1e9:g} GHz over time")


def _with_gaps(line: dict[str, np.ndarray], step: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times and gains with a NaN where frames are missing, such as those of an unfinished shard."""
    frame, gain = line["frame"].astype(float), line["gain_db"].astype(float)
    holes = np.flatnonzero(np.diff(frame) > step) + 1
    return np.insert(frame, holes, np.nan) * FRAME_DT, np.insert(gain, holes, np.nan)


def _distinct_sights(lines: list[dict[str, np.ndarray]]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return frames and lines of sight without repeats: they are equal in all weathers that have the same frames."""
    found: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
    for line in lines:
        if len(line["frame"]):
            is_los = line["is_los"].astype(bool)
            found.setdefault(line["frame"].tobytes() + is_los.tobytes(), (line["frame"], is_los))
    return list(found.values())


def link_table(rows: LinkRows) -> str:
    """Return a table with one row a link, carrier and weather, over the frames that were read."""
    cells = []
    for kind, (peer, agent) in rows.ends:
        for carrier in rows.carriers:
            for weather in rows.by_weather:
                own = rows.of(weather, (peer, agent), carrier)
                if len(own["frame"]):
                    cells.append((
                        f"{peer} to {agent}", kind, weather, f"{carrier / 1e9:g}", len(own["frame"]),
                        f"{100.0 * own['is_los'].astype(float).mean():.1f}", _number(own["gain_db"], np.mean, 1),
                        _number(own["gain_db"], np.min, 1), _number(own["gain_db"], np.max, 1),
                        f"{own['path_count'].mean():.1f}", _number(own["rms_delay_s"] * 1e9, np.mean, 1),
                    ))  # fmt: skip
    head = (
        "link", "kind", "weather", "carrier [GHz]", "frames", "line of sight [%]", "mean gain [dB]", "least [dB]",
        "greatest [dB]", "paths", "mean RMS delay spread [ns]",
    )  # fmt: skip
    caption = f"Over {sampled(rows.frames)}; means of the values in dB and ns, frames without any path left out."
    return table(head, cells, numbers=range(3, 11), caption=caption)


def _number(values: np.ndarray, what: object, digits: int) -> str:
    """Return a number of the values that there are, a dash if there is none."""
    kept = values.astype(float)[np.isfinite(values.astype(float))]
    return f"{what(kept):.{digits}f}" if len(kept) and callable(what) else "-"
