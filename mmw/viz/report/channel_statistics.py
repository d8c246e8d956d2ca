"""Statistics of the channel: histograms of delays and angles, and which pairs of beams are best how often."""

import math

import numpy as np

from mmw.core.transforms import normalize, quaternion_to_matrix
from mmw.dataset import BeamSearch, Dataset
from mmw.viz.report.css import SERIES_COUNT
from mmw.viz.report.html import card, legend, paragraph, plural
from mmw.viz.report.inventory import Inventory
from mmw.viz.report.links import LinkRows
from mmw.viz.report.sampling import sample_range, sampled
from mmw.viz.report.svg import Chart, nice_step

PATH_FRAMES = 200
"""Frames of a scenario whose paths are read at most."""

BEAM_LINKS = 1500
"""Links of a page whose best beams are searched at most: about 1.5 ms of one core each; scenarios share them."""

MIN_BEAM_LINKS = 100
"""Links that each scenario may search at least."""

KINDS = ("los", "specular", "diffuse", "transmission", "diffraction")
"""`paths.kind`, in the order of their colours."""

BINS = 36
"""Bins of a histogram."""

AZIMUTH = (-180.0, 180.0, 90.0)
"""First and last angle of a histogram, and distance between its ticks [deg]."""


def radio_section(data: Dataset, inventory: Inventory, scenario: str, rows: LinkRows, scenarios: int) -> str:
    """Return histograms and the beam heat map of a scenario; empty if it has no path.

    Args:
        data: The dataset.
        inventory: What there is.
        scenario: Scenario name.
        rows: Its links.
        scenarios: Scenarios on the page, which share the beam searches.
    """
    weather, carrier = next(iter(rows.by_weather)), rows.carriers[-1]
    if "paths" not in data.tables:
        return ""
    frames = sample_range(inventory.frames(scenario, weather), PATH_FRAMES)
    where = {"scenario": scenario, "weather": weather, "frames": frames}
    paths = data.numpy("paths", columns=["carrier_hz", "kind", "tau_s", "aod_az", "aoa_az", "aoa_ze"], **where)
    paths = {name: values[paths["carrier_hz"] == carrier] for name, values in paths.items()}
    if not len(paths["kind"]):
        return ""
    kinds = [kind for kind in KINDS if (paths["kind"] == kind).any()]
    charts = [
        card("Delay of the paths", _delays(paths, kinds)),
        card("RMS delay spread of the links", _spreads(rows, weather, carrier)),
        card("Azimuth of departure", _angles(paths, kinds, "aod_az", AZIMUTH, "azimuth from the transmitter [deg]")),
        card("Azimuth of arrival", _angles(paths, kinds, "aoa_az", AZIMUTH, "azimuth at the receiver [deg]")),
        card(
            "Zenith angle of arrival",
            _angles(paths, kinds, "aoa_ze", _zenith(paths["aoa_ze"]), "zenith angle at the receiver [deg]"),
        ),
    ]
    if "poses" in data.tables:
        most = max(MIN_BEAM_LINKS, BEAM_LINKS // scenarios)
        charts.insert(2, _beams(data, scenario, weather, carrier, rows, most))
    entries = [(f"s{KINDS.index(kind)}", kind) for kind in kinds]
    note = (
        f"{plural(len(paths['kind']), 'path')} at {carrier / 1e9:g} GHz in {weather}, {sampled(frames)}. Azimuths are "
        "counter-clockwise from east, in the world. Carriers and weathers have the same paths; their gains differ."
    )
    return legend(entries) + f"<div class=grid>{''.join(charts)}</div>" + paragraph(note, "note")


def _stacked(values: np.ndarray, group: np.ndarray, groups: list[str], edges: np.ndarray) -> list[np.ndarray]:
    """Return a histogram of each group, shape [B] each."""
    return [np.histogram(values[group == name], edges)[0] for name in groups]


def _histogram(
    edges: np.ndarray, counts: list[np.ndarray], kinds: list[str], x_label: str, what: str, x_step: float | None = None
) -> str:
    top = max(int(np.sum(counts, axis=0).max()), 1)
    chart = Chart((float(edges[0]), float(edges[-1])), (0.0, top * 1.05), x_label=x_label, y_label=what, x_step=x_step)
    chart.bars(edges, counts, kinds)
    return chart.svg(f"Histogram: {x_label}")


def _edges(values: np.ndarray) -> np.ndarray:
    """Return the edges of bins of a round width from 0 to the greatest value."""
    width = nice_step(max(float(values.max(initial=0.0)), 1.0) / BINS)
    return np.arange(0.0, max(float(values.max(initial=0.0)), 1.0) + width, width)


def _delays(paths: dict[str, np.ndarray], kinds: list[str]) -> str:
    delay = paths["tau_s"] * 1e9
    edges = _edges(delay)
    counts = _stacked(delay, paths["kind"], kinds, edges)
    return _histogram(edges, counts, [_color(kind) for kind in kinds], "delay [ns]", "paths")


def _spreads(rows: LinkRows, weather: str, carrier: float) -> str:
    own = rows.by_weather[weather]
    is_it = (own["carrier_hz"] == carrier) & np.isfinite(own["rms_delay_s"].astype(float))
    spread, is_los = own["rms_delay_s"][is_it].astype(float) * 1e9, own["is_los"][is_it].astype(bool)
    edges = _edges(spread)
    counts = [np.histogram(spread[is_los], edges)[0], np.histogram(spread[~is_los], edges)[0]]
    entries = legend([("free", "line of sight"), ("blocked", "blocked")])
    return _histogram(edges, counts, ["free", "blocked"], "RMS delay spread [ns]", "links and frames") + entries


def _angles(
    paths: dict[str, np.ndarray], kinds: list[str], column: str, ends: tuple[float, float, float], x_label: str
) -> str:
    """Return a histogram of an angle [deg] between two ends with a distance between ticks."""
    edges = np.linspace(ends[0], ends[1], BINS + 1)
    counts = _stacked(np.degrees(paths[column]), paths["kind"], kinds, edges)
    return _histogram(edges, counts, [_color(kind) for kind in kinds], x_label, "paths", ends[2])


def _zenith(angle: np.ndarray) -> tuple[float, float, float]:
    """Return ends, in steps of 10 degrees, between which all angles [rad] are, and a distance between ticks [deg]."""
    low, high = math.floor(np.degrees(angle.min()) / 10.0) * 10.0, math.ceil(np.degrees(angle.max()) / 10.0) * 10.0
    return low, max(high, low + 10.0), 10.0 if high - low <= 60.0 else 30.0


def _color(kind: str) -> str:
    return f"s{KINDS.index(kind) % SERIES_COUNT}"


def beam_counts(
    data: Dataset, scenario: str, weather: str, carrier_hz: float, frames: range, search: BeamSearch
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Return how often each pair of beams is the best.

    Args:
        data: The dataset.
        scenario: Scenario name.
        weather: Weather name.
        carrier_hz: Carrier [Hz].
        frames: Frames to search at.
        search: Arrays, codebooks and band.

    Returns:
        Transmit beam, receive beam and count of every pair that is the best at least once, shape [N] each; and the
        number of links without any path.
    """
    paths = data.paths(carrier_hz, scenario=scenario, weather=weather, frames=frames)
    names = ["qx", "qy", "qz", "qw"]
    rows = data.numpy("poses", columns=["frame", "agent", *names], scenario=scenario, weather=weather, frames=frames)
    turn = quaternion_to_matrix(normalize(np.stack([rows[name] for name in names], axis=1)))
    at = {key: index for index, key in enumerate(zip(rows["frame"].tolist(), rows["agent"].tolist(), strict=True))}
    keys = paths.keys
    rotations = [
        turn[[at[int(frame), str(agent)] for frame, agent in zip(keys["frame"], keys[end], strict=True)]]
        for end in ("peer", "agent")
    ]
    pairs = search.best(paths, *rotations)
    is_found = pairs.tx_beam >= 0
    found, counts = np.unique(
        np.stack([pairs.tx_beam[is_found], pairs.rx_beam[is_found]], axis=1), axis=0, return_counts=True
    )
    return found[:, 0], found[:, 1], counts, int((~is_found).sum())


def _beams(data: Dataset, scenario: str, weather: str, carrier: float, rows: LinkRows, most: int) -> str:
    own = rows.by_weather[weather]
    each = max(len(rows.ends), 1)
    frames = sample_range(range(int(own["frame"].min()), int(own["frame"].max()) + 1), max(1, most // each))
    search = BeamSearch()
    tx_beam, rx_beam, counts, without = beam_counts(data, scenario, weather, carrier, frames, search)
    if not len(counts):
        return card("Best pairs of beams", "", "No link has a path.")
    tx_count, rx_count = (book.shape[1] for book in search.codebooks)
    chart = Chart(
        (-0.5, tx_count - 0.5), (-0.5, rx_count - 0.5), x_label="transmit beam (index)", y_label="receive beam (index)",
        x_step=8.0 if tx_count <= 64 else None,
    )  # fmt: skip
    chart.cells(tx_beam, rx_beam, counts / counts.max())
    note = (
        f"Best pairs of {plural(int(counts.sum()), 'link and frame', 'links and frames')} at {carrier / 1e9:g} GHz in "
        f"{weather}, {sampled(frames)}; {without} without any path. {search.tx_array.antenna_count} transmit and "
        f"{search.rx_array.antenna_count} receive antennas in line, DFT codebooks of {tx_count} and {rx_count} beams, "
        f"mean of {search.subcarriers} subcarriers."
    )
    entries = legend([("h1", "best once"), ("h2", plural(int(counts.max()), "time"))])
    return card("Best pairs of beams", chart.svg("Best pairs of beams") + entries, note)
