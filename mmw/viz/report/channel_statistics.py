"""Statistics of the channel: histograms of delays and angles, and which pairs of beams are best how often."""

import math
from typing import Any

import numpy as np

from mmw.dataset import BeamSearch, Dataset
from mmw.viz.plots.link import search_beams
from mmw.viz.report.css import COLORS
from mmw.viz.report.figures import new_chart, svg
from mmw.viz.report.html import card, legend, paragraph, plural
from mmw.viz.report.inventory import Inventory
from mmw.viz.report.links import LinkRows
from mmw.viz.report.sampling import sample_range, sampled

PATH_FRAMES = 200
"""Frames of a scenario whose paths are read at most."""

BEAM_LINKS = 1500
"""Links of a page whose best beams are searched at most: about 1.5 ms of one core each; scenarios share them."""

MIN_BEAM_LINKS = 100
"""Links that each scenario may search at least."""

KINDS = ("los", "specular", "diffuse", "transmission", "diffraction")
"""`paths.kind`, in the order of their colors."""

BINS = 36
"""Bins of a histogram."""

AZIMUTH = (-180.0, 180.0)
"""Ends of the histogram of an azimuth [deg]."""


def radio_section(data: Dataset, inventory: Inventory, scenario: str, rows: LinkRows, scenarios: int) -> str:
    """Return histograms and the beam heat map of a scenario, empty without paths; scenarios share the beam searches."""
    weather, carrier = next(iter(rows.by_weather)), rows.carriers[-1]
    if "paths" not in data.views:
        return ""
    frames = sample_range(inventory.frames(scenario, weather), PATH_FRAMES)
    where = {"scenario": scenario, "weather": weather, "frames": frames}
    paths = data.numpy("paths", columns=["carrier_hz", "kind", "tau_s", "aod_az", "aoa_az", "aoa_ze"], **where)
    paths = {name: values[paths["carrier_hz"] == carrier] for name, values in paths.items()}
    if not len(paths["kind"]):
        return ""
    kinds = [kind for kind in KINDS if (paths["kind"] == kind).any()]
    delay = paths["tau_s"] * 1e9
    charts = [
        _paths_card("Delay of the paths", paths["kind"], delay, _edges(delay), "delay [ns]"),
        _spreads(rows, weather, carrier),
    ]
    for title, column, label, zenith in (
        ("Azimuth of departure", "aod_az", "azimuth from the transmitter [deg]", False),
        ("Azimuth of arrival", "aoa_az", "azimuth at the receiver [deg]", False),
        ("Zenith angle of arrival", "aoa_ze", "zenith angle at the receiver [deg]", True),
    ):
        angle = np.degrees(paths[column])
        edges = np.linspace(*(_zenith(angle) if zenith else AZIMUTH), BINS + 1)
        charts.append(_paths_card(title, paths["kind"], angle, edges, label))
    if "poses" in data.tables:
        max_links = max(MIN_BEAM_LINKS, BEAM_LINKS // scenarios)
        charts.insert(2, _beams(data, scenario, weather, carrier, rows, max_links))
    entries = [(f"s{KINDS.index(kind)}", kind) for kind in kinds]
    note = (
        f"{plural(len(paths['kind']), 'path')} at {carrier / 1e9:g} GHz in {weather}, {sampled(frames)}. Azimuths are "
        "counter-clockwise from east, in the world. Carriers and weathers have the same paths; their gains differ."
    )
    return legend(entries) + f"<div class=grid>{''.join(charts)}</div>" + paragraph(note, "note")


def draw_histogram(parts: list[np.ndarray], colors: list[str], edges: np.ndarray, x_label: str, y_label: str) -> Any:
    """Return a histogram of stacked parts, each in its color, a name in `COLORS`."""
    figure, axes = new_chart(x_label, y_label)
    colors = [COLORS[name] for name in colors]
    axes.hist(parts, edges, stacked=True, color=colors, histtype="stepfilled", zorder=2)
    axes.set_xlim(edges[0], edges[-1])
    axes.yaxis.get_major_locator().set_params(integer=True)
    if edges[-1] - edges[0] >= 180.0 and x_label.endswith("[deg]"):
        axes.set_xticks(np.arange(edges[0], edges[-1] + 1.0, 90.0))
    return figure


def _paths_card(title: str, kind: np.ndarray, values: np.ndarray, edges: np.ndarray, x_label: str) -> str:
    """Return a card with a histogram of the paths, stacked by kind."""
    shown = [one for one in KINDS if (kind == one).any()]
    parts, colors = [values[kind == one] for one in shown], [f"s{KINDS.index(one)}" for one in shown]
    return card(title, svg(draw_histogram(parts, colors, edges, x_label, "paths"), f"Histogram: {x_label}"))


def _edges(values: np.ndarray) -> np.ndarray:
    """Return the edges of bins of equal width from 0 to the greatest value, at least 1."""
    return np.linspace(0.0, max(float(values.max(initial=0.0)), 1.0), BINS + 1)


def _spreads(rows: LinkRows, weather: str, carrier: float) -> str:
    own = rows.by_weather[weather]
    is_it = (own["carrier_hz"] == carrier) & np.isfinite(own["rms_delay_s"].astype(float))
    spread, is_los = own["rms_delay_s"][is_it].astype(float) * 1e9, own["is_los"][is_it].astype(bool)
    label = "RMS delay spread [ns]"
    parts = [spread[is_los], spread[~is_los]]
    figure = draw_histogram(parts, ["s2", "s1"], _edges(spread), label, "links and frames")
    entries = legend([("free", "line of sight"), ("blocked", "blocked")])
    return card("RMS delay spread of the links", svg(figure, f"Histogram: {label}") + entries)


def _zenith(angle: np.ndarray) -> tuple[float, float]:
    """Return ends, in steps of 10 degrees, between which all angles are [deg]."""
    low, high = math.floor(angle.min() / 10.0) * 10.0, math.ceil(angle.max() / 10.0) * 10.0
    return low, max(high, low + 10.0)


def _beams(data: Dataset, scenario: str, weather: str, carrier: float, rows: LinkRows, max_links: int) -> str:
    own = rows.by_weather[weather]
    each = max(len(rows.ends), 1)
    frames = sample_range(range(int(own["frame"].min()), int(own["frame"].max()) + 1), max(1, max_links // each))
    search = BeamSearch()
    paths = data.paths(carrier, scenario=scenario, weather=weather, frames=frames)
    best = search_beams(data, paths, scenario, weather, frames, search)
    pairs = np.stack([best.tx_beam, best.rx_beam], axis=1)[best.tx_beam >= 0]
    pairs, counts = np.unique(pairs, axis=0, return_counts=True)
    if not len(counts):
        return card("Best pairs of beams", "", "No link has a path.")
    tx_count, rx_count = (book.shape[1] for book in search.codebooks)
    figure = draw_beams(*pairs.T, counts / counts.max(), (tx_count, rx_count))
    note = (
        f"Best pairs of {plural(int(counts.sum()), 'link and frame', 'links and frames')} at {carrier / 1e9:g} GHz in "
        f"{weather}, {sampled(frames)}; {(best.tx_beam < 0).sum()} without any path. {search.tx_array.antenna_count} "
        f"transmit and {search.rx_array.antenna_count} receive antennas in line, DFT codebooks of {tx_count} and "
        f"{rx_count} beams, mean of {search.subcarriers} subcarriers."
    )
    entries = legend([("h1", "best once"), ("h2", plural(int(counts.max()), "time"))])
    return card("Best pairs of beams", svg(figure, "Best pairs of beams") + entries, note)


def draw_beams(tx_beam: np.ndarray, rx_beam: np.ndarray, share: np.ndarray, counts: tuple[int, int]) -> Any:
    """Return a heat map of pairs of beams, the darker the greater their share, 0 to 1; shape [N] each."""
    from matplotlib.collections import PolyCollection

    figure, axes = new_chart("transmit beam (index)", "receive beam (index)")
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    cells = np.stack([tx_beam, rx_beam], axis=1)[:, None] + corners
    style = {"facecolors": COLORS["heat"], "edgecolors": "face", "linewidths": 1.5, "zorder": 2}
    axes.add_collection(PolyCollection(list(cells), alpha=0.15 + 0.85 * share, **style))
    axes.set(xlim=(-0.5, counts[0] - 0.5), ylim=(-0.5, counts[1] - 0.5))
    return figure
