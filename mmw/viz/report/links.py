"""Radio links over time: gain in every weather, when the line of sight is free, and a table of the links."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mmw.core.constants import FRAME_RATE_HZ
from mmw.dataset import Dataset
from mmw.viz.plots.link import first_antennas
from mmw.viz.plots.style import at_least, shade_blocked
from mmw.viz.report.css import COLORS, DASHES, SERIES_COUNT
from mmw.viz.report.figures import new_chart, svg
from mmw.viz.report.html import card, legend, paragraph, plural, table
from mmw.viz.report.inventory import Inventory
from mmw.viz.report.sampling import sample_range, sampled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_FRAMES = 5000
"""Frames of a scenario and weather whose links are read at most."""

MAX_POINTS = 300
"""Points of a line at most, on a page of few scenarios; more scenarios share them."""

MIN_POINTS = 80
"""Points of a line that a page of many scenarios still has."""

MAX_LINKS = 12
"""Links of a scenario and carrier that get a chart at most; vehicle-to-infrastructure links come first."""

COLUMNS = (
    "frame", "agent", "peer", "antenna", "peer_antenna", "carrier_hz", "link", "path_count", "is_los", "gain_db",
    "rms_delay_s",
)  # fmt: skip
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
    rate_hz: int = FRAME_RATE_HZ
    """Frames a second."""

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
    """Return the links of a scenario, between first antennas, in all its weathers; None if it has none."""
    weathers = inventory.weathers(scenario)
    if "links" not in data.tables or not weathers:
        return None
    frames, found = sample_range(inventory.link_frames(scenario), MAX_FRAMES), {}
    for weather in weathers:
        rows = data.numpy("links", columns=COLUMNS, scenario=scenario, weather=weather, frames=frames)
        if len(rows["frame"]):
            rows = {name: values[first_antennas(rows)] for name, values in rows.items()}
            order = np.argsort(rows["frame"], kind="stable")
            found[weather] = {name: values[order] for name, values in rows.items()}
    return LinkRows(frames, found, data.frame_rate_hz(scenario)) if found else None


def link_section(rows: LinkRows, scenarios: int) -> str:
    """Return charts and table of the links of a scenario; scenarios share the points of lines."""
    points = max(MIN_POINTS, min(MAX_POINTS, 4 * MAX_POINTS // max(scenarios, 1)))
    step = max(1, -(-len(rows.frames) // points))
    drawn = rows.frames[::step]
    ends = rows.ends
    shown = ends[:MAX_LINKS]
    weathers = list(rows.by_weather)
    entries = [(f"line s{i % SERIES_COUNT}", name) for i, name in enumerate(weathers)]
    parts = [legend([*entries, ("shade", "no line of sight")])]
    for carrier in rows.carriers:
        charts = [
            card(
                f"{peer} to {agent}, {carrier / 1e9:g} GHz",
                svg(
                    draw_gains(rows, (peer, agent), carrier, drawn),
                    f"Path gain of {peer} to {agent} at {carrier / 1e9:g} GHz over time",
                ),
            )
            for _, (peer, agent) in shown
        ]
        parts.append(f"<div class=grid>{''.join(charts)}</div>")
    note = f"Gain: sum of the powers of the paths, a gap is no path. Lines show {sampled(drawn)}."
    if len(shown) < len(ends):
        note += f" Charts of {len(shown)} of {plural(len(ends), 'link')}; the table has all."
    parts.append(paragraph(note, "note"))
    parts.append(link_table(rows))
    return "".join(parts)


def draw_gains(rows: LinkRows, ends: RadioDevices, carrier_hz: float, drawn: range) -> "Figure":
    """Return the gain of a link over time, a line for each weather, shaded where it has no line of sight."""
    figure, axes = new_chart("time [s]", "path gain [dB]")
    sight: dict[int, bool] = {}  # equal in all weathers, which may have different frames
    for number, weather in enumerate(rows.by_weather):
        own = rows.of(weather, ends, carrier_hz)
        is_drawn = np.isin(own["frame"], np.asarray(drawn))
        frame, gain = own["frame"][is_drawn].astype(float), own["gain_db"][is_drawn].astype(float)
        sight |= dict(zip(own["frame"][is_drawn].tolist(), own["is_los"][is_drawn].astype(bool).tolist(), strict=True))
        holes = np.flatnonzero(np.diff(frame) > drawn.step) + 1  # frames are missing, such as those of a shard
        series = number % SERIES_COUNT
        axes.plot(
            np.insert(frame, holes, np.nan) / rows.rate_hz, np.insert(gain, holes, np.nan), color=COLORS[f"s{series}"],
            ls=DASHES[series], lw=1.6, label=weather, marker="o" if len(frame) == 1 else "",
        )  # fmt: skip
    frames = np.array(sorted(sight), dtype=np.int64)
    is_los = np.array([sight[frame] for frame in frames.tolist()], dtype=bool)
    shade_blocked(axes, frames / rows.rate_hz, is_los, drawn.step / rows.rate_hz, COLORS["s1"])
    at_least(axes, 6.0)
    axes.set_xlim(rows.frames[0] / rows.rate_hz, (rows.frames[-1] + rows.frames.step) / rows.rate_hz)
    return figure


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
    caption = f"Over {sampled(rows.frames)}; means of the values in dB and ns, frames without any path do not count."
    return table(head, cells, numbers=range(3, 11), caption=caption)


def _number(values: np.ndarray, statistic: Callable[[np.ndarray], float], digits: int) -> str:
    """Return a statistic of the finite values, a dash if there is none."""
    finite = values.astype(float)[np.isfinite(values.astype(float))]
    return f"{statistic(finite):.{digits}f}" if len(finite) else "-"
