"""One radio link over time (gain, line of sight, delay spread, best beams), and its paths at one frame."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from mmw.channel.antennas.array_response import POSE_COLUMNS, rotations_from_poses
from mmw.channel.codebook import BeamPairs
from mmw.channel.path_table import CarrierPaths
from mmw.core.constants import FRAME_DT
from mmw.core.frame_rate import seconds
from mmw.dataset import BeamSearch, Dataset
from mmw.viz.plots.paths import choose_carrier, find_link, gains_db
from mmw.viz.plots.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    at_least,
    gain_colors,
    new_figure,
    plain_axes,
    shade_blocked,
)

if TYPE_CHECKING:
    from mmw.viz.plots.style import Canvas

BEAM_FRAMES = 200
"""Frames at which the best beams are searched at most: a search takes about 1.5 ms of one core. Design value."""

SERIES = (
    "frame", "peer", "antenna", "peer_antenna", "carrier_hz", "is_los", "path_count", "gain_db", "rms_delay_s",
    "doppler_spread_hz",
)  # fmt: skip
"""Columns of table `links` that are drawn."""

KINDS = {
    "los": ("o", BLUE), "specular": ("s", ORANGE), "diffuse": ("x", GREY), "transmission": ("D", GREEN),
    "diffraction": ("^", PURPLE),
}  # fmt: skip
"""`paths.kind` -> marker and color."""

MARKED = 50
"""Samples up to which each has a marker, or a large one. Design value."""

SPAN_DB = 50.0
"""Gain below the strongest path that delay profile and angles show at least [dB]. Design value."""


def read_link(
    data: Dataset, scenario: str, weather: str, tx: str, rx: str, carrier_hz: float | None, frames: range | None = None
) -> dict[str, np.ndarray]:
    """Return a link over time, at the first carrier if none is given: `SERIES` and `time_s` by frame, NaN
    where it has no path; between the first antennas of both ends.

    Raises:
        InputError: If the dataset has no such link or carrier.
    """
    rows = data.numpy("links", columns=[*SERIES, "agent"], frames=frames, scenario=scenario, weather=weather)
    links = sorted(set(zip(rows["peer"], rows["agent"], rows["carrier_hz"].tolist(), strict=True)))
    carrier_hz = choose_carrier(f"{data.root}: {scenario} {weather}", links, tx, rx, carrier_hz)
    is_own = (rows["agent"] == rx) & (rows["peer"] == tx) & (rows["carrier_hz"] == carrier_hz) & first_antennas(rows)
    order = np.flatnonzero(is_own)[np.argsort(rows["frame"][is_own], kind="stable")]
    found = {name: rows[name][order] for name in SERIES}
    return {**found, "time_s": seconds(found["frame"], data.frame_rate_hz(scenario))}


def first_antennas(links: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return whether each row is between the first antennas, by name, of its receiver and its transmitter, shape [n].

    Args:
        links: Columns `agent`, `peer`, `antenna` and `peer_antenna`.
    """
    is_first = np.ones(len(links["agent"]), dtype=bool)
    for end, antenna in (("agent", "antenna"), ("peer", "peer_antenna")):
        if len(set(links[antenna].tolist())) > 1:
            first: dict[str, str] = {}
            for name, one in zip(links[end].tolist(), links[antenna].tolist(), strict=True):
                first[name] = min(one, first.get(name, one))
            is_first &= links[antenna] == np.array([first[name] for name in links[end].tolist()], dtype=object)
    return is_first


def best_beams_over_time(
    data: Dataset, scenario: str, weather: str, tx: str, rx: str, carrier_hz: float, frames: range, search: BeamSearch
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return frames, and the best transmit and receive beam in each; NaN without any path; shape [T] each.

    Frames are searched that the link has; the other arguments are those of `plot_link`.
    """
    paths = data.paths(carrier_hz, scenario=scenario, weather=weather, frames=frames)
    keys = {name: paths.keys[name] for name in paths.keys.dtype.names or ()}
    own = paths.take((keys["agent"] == rx) & (keys["peer"] == tx) & first_antennas(keys))
    pairs = search_beams(data, own, scenario, weather, frames, search)
    beams = [np.where(beam < 0, np.nan, beam.astype(float)) for beam in (pairs.tx_beam, pairs.rx_beam)]
    return own.keys["frame"].astype(np.int64), beams[0], beams[1]


def search_beams(
    data: Dataset, paths: CarrierPaths, scenario: str, weather: str, frames: range, search: BeamSearch
) -> BeamPairs:
    """Return the best pair of beams of every link, its arrays turned as the agents of `data` are in the frames."""
    poses = data.read("poses", columns=list(POSE_COLUMNS), scenario=scenario, weather=weather, frames=frames)
    return search.best(paths, *(rotations_from_poses(poses, paths, end) for end in ("tx", "rx")))


def plot_link(
    data: Dataset,
    scenario: str,
    weather: str,
    tx: str,
    rx: str,
    *,
    carrier_hz: float | None = None,
    frame: int | None = None,
    frames: range | None = None,
    search: BeamSearch | None = None,
    beam_frames: int = BEAM_FRAMES,
    figure: "Canvas | None" = None,
) -> "Canvas":
    """Draw a link over time (gain and blockage, delay spread, best beams) and its delay profile and angles at a frame.

    Args:
        data: The dataset.
        scenario: Scenario name.
        weather: Weather name.
        tx: Transmitter, `peer` of the link.
        rx: Receiver, `agent` of the link.
        carrier_hz: Carrier [Hz]; None means the lowest.
        frame: Frame of delay profile and angles; None means the first with most paths.
        frames: Frames of the time series; None means all.
        search: Arrays, codebooks and band of the beam search; the paper's by default.
        beam_frames: Frames at which beams are searched at most, evenly spread; 0 leaves the beams out.
        figure: Figure or subfigure to draw into; None makes a new one.

    Returns:
        The figure.

    Raises:
        InputError: If the dataset has no such link, carrier or frame.
        ImportError: If matplotlib is not installed.

    Examples:
        >>> import mmw
        >>> data = mmw.open_dataset("out/quickstart")
        >>> plot_link(data, "town03_roundabout", "sunny", "rsu_1", "cav_1", frames=range(0, 3)).savefig("link.png")
    """
    series = read_link(data, scenario, weather, tx, rx, carrier_hz, frames)
    carrier_hz = float(series["carrier_hz"][0])
    rate_hz = data.frame_rate_hz(scenario)
    at = int(series["frame"][np.argmax(series["path_count"])]) if frame is None else frame
    found = data.frame(scenario, weather, at)
    link = find_link(found, tx, rx, carrier_hz)
    canvas = new_figure(figure, (14.0, 7.6))
    left, right = canvas.subfigures(1, 2, width_ratios=(1.1, 1.0))
    axes = list(left.subplots(3 if beam_frames else 2, 1, sharex=True))
    _draw_gain(axes[0], series)
    _draw_spread(axes[1], series)
    if beam_frames:
        stride = math.ceil(len(series["frame"]) / beam_frames)
        searched = range(int(series["frame"][0]), int(series["frame"][-1]) + 1, stride)
        beams = best_beams_over_time(data, scenario, weather, tx, rx, carrier_hz, searched, search or BeamSearch())
        _draw_beams(axes[2], seconds(beams[0], rate_hz), *beams[1:], stride)
    for one in axes:
        one.axvline(at / rate_hz, color="0.3", lw=0.8, ls=":")
    axes[-1].set_xlabel("time [s]")
    left.align_ylabels(axes)
    grid = right.add_gridspec(2, 2)
    gain, kind = gains_db(link.a), link.paths["kind"]
    profile = right.add_subplot(grid[0, :])
    profile.set_title(f"power-delay profile, frame {at}", fontsize="medium")
    draw_profile(profile, link.paths["tau_s"], gain, kind)
    for column, (side, end) in enumerate((("aod", f"departure from {tx}"), ("aoa", f"arrival at {rx}"))):
        polar = right.add_subplot(grid[1, column], projection="polar")
        polar.set_title(f"azimuth of {end}", fontsize="small", pad=10)
        draw_angles(polar, link.paths[f"{side}_az"], gain, kind)
    canvas.suptitle(f"{tx} to {rx} at {carrier_hz / 1e9:g} GHz: {scenario}, {weather}", fontsize="large")
    return canvas


def plot_path_history(
    data: Dataset,
    scenario: str,
    weather: str,
    tx: str,
    rx: str,
    *,
    carrier_hz: float | None = None,
    frames: range | None = None,
    figure: "Canvas | None" = None,
) -> "Canvas":
    """Draw the gain of a link over time, and delay and Doppler shift of every one of its paths, colored by gain.

    Arguments, return value and errors are those of `plot_link`.
    """
    series = read_link(data, scenario, weather, tx, rx, carrier_hz, frames)
    carrier_hz = float(series["carrier_hz"][0])
    ends = ["peer", "antenna", "peer_antenna"]
    names = ["frame", *ends, "carrier_hz", "tau_s", "a_re", "a_im", "doppler_hz"]
    rows = data.numpy("paths", columns=names, scenario=scenario, weather=weather, agent=rx, frames=frames)
    is_own = rows["carrier_hz"] == carrier_hz
    for name in ends:
        is_own &= rows[name] == series[name][0]
    rows = {name: values[is_own] for name, values in rows.items()}
    gain_db = 20.0 * np.log10(np.maximum(np.hypot(rows["a_re"], rows["a_im"]), 1e-30))
    order = np.argsort(gain_db, kind="stable")
    top = float(gain_db.max(initial=-300.0))
    size = 5 if len(series["frame"]) > MARKED else 24
    style = {"c": gain_db[order], "s": size, "linewidths": 0, "cmap": gain_colors(), "vmin": top - SPAN_DB, "vmax": top}
    canvas = new_figure(figure, (10.0, 8.0))
    axes = list(canvas.subplots(3, 1, sharex=True))
    _draw_gain(axes[0], series)
    points = None
    for one, values, label in (
        (axes[1], rows["tau_s"] * 1e9, "delay [ns]"), (axes[2], rows["doppler_hz"], "Doppler shift [Hz]"),
    ):  # fmt: skip
        points = one.scatter(seconds(rows["frame"][order], data.frame_rate_hz(scenario)), values[order], **style)
        one.set(ylabel=label)
        plain_axes(one)
    axes[2].set_xlabel("time [s]")
    canvas.align_ylabels(axes)
    canvas.colorbar(points, ax=axes[1:], label="path gain |a|² [dB]")
    canvas.suptitle(f"{tx} to {rx} at {carrier_hz / 1e9:g} GHz: {scenario}, {weather}", fontsize="large")
    return canvas


def _draw_gain(axes: Any, series: dict[str, np.ndarray]) -> None:
    axes.plot(series["time_s"], series["gain_db"], color=BLUE, lw=1.4, label="path gain", zorder=3)
    step = np.diff(series["time_s"]).min() if len(series["time_s"]) > 1 else FRAME_DT
    shade_blocked(axes, series["time_s"], series["is_los"].astype(bool), float(step))
    axes.set(ylabel="path gain [dB]")
    at_least(axes, 6.0)
    plain_axes(axes)
    axes.legend(loc="best", fontsize="small", framealpha=0.9)


def _draw_spread(axes: Any, series: dict[str, np.ndarray]) -> None:
    axes.plot(series["time_s"], series["rms_delay_s"] * 1e9, color=GREEN, lw=1.4)
    axes.set(ylabel="RMS delay spread [ns]")
    at_least(axes, 4.0)
    axes.set_ylim(bottom=0.0)
    plain_axes(axes)


def _draw_beams(axes: Any, time_s: np.ndarray, tx_beam: np.ndarray, rx_beam: np.ndarray, stride: int) -> None:
    style = {"drawstyle": "steps-mid", "markersize": 3.0 if len(time_s) <= MARKED else 0.0, "lw": 1.4}
    axes.plot(time_s, tx_beam, color=ORANGE, marker="^", label="transmitter", **style)
    axes.plot(time_s, rx_beam, color=PURPLE, marker="o", label="receiver", **style)
    axes.set(ylabel="best beam (index)" + (f",\nevery {stride} frames" if stride > 1 else ""))
    at_least(axes, 8.0)
    axes.yaxis.get_major_locator().set_params(integer=True)
    plain_axes(axes)
    axes.legend(loc="best", fontsize="small", framealpha=0.9)


def draw_profile(axes: Any, tau_s: np.ndarray, gain_db: np.ndarray, kind: np.ndarray) -> None:
    """Draw a power-delay profile.

    Args:
        axes: matplotlib axes to draw on.
        tau_s: Delay of each path [s], shape [P].
        gain_db: Gain of each path [dB], shape [P].
        kind: Kind of each path, a key of `KINDS`, shape [P].
    """
    axes.set(xlabel="delay [ns]", ylabel="path gain |a|² [dB]")
    plain_axes(axes)
    if not len(gain_db):
        axes.text(0.5, 0.5, "no path", transform=axes.transAxes, ha="center", color="0.4")
        return
    floor = min(float(gain_db.min()) - 5.0, float(gain_db.max()) - SPAN_DB)
    _draw_stems(axes, kind, np.asarray(tau_s) * 1e9, gain_db, floor)
    axes.set_ylim(floor, float(gain_db.max()) + 5.0)
    axes.legend(loc="best", fontsize="small", framealpha=0.9)


def _draw_stems(axes: Any, kinds: np.ndarray, along: np.ndarray, gain_db: np.ndarray, floor: float) -> None:
    """Draw the gain of each path as a line up from a floor, with a mark for its kind."""
    for kind, (marker, color) in KINDS.items():
        is_it = kinds == kind
        if is_it.any():
            axes.vlines(along[is_it], floor, gain_db[is_it], color=color, lw=1.2, zorder=2)
            axes.plot(along[is_it], gain_db[is_it], ls="", marker=marker, color=color, label=kind, zorder=3)


def draw_angles(axes: Any, azimuth: np.ndarray, gain_db: np.ndarray, kind: np.ndarray) -> None:
    """Draw the azimuths of paths as a compass with east to the right; the farther out, the stronger.

    Args:
        axes: Polar matplotlib axes to draw on.
        azimuth: Azimuth of each path, counter-clockwise from east [rad], shape [P].
        gain_db: Gain of each path [dB], shape [P].
        kind: Kind of each path, a key of `KINDS`, shape [P].
    """
    top = float(gain_db.max()) if len(gain_db) else 0.0
    floor = min(float(gain_db.min(initial=top)) - 5.0, top - SPAN_DB)
    _draw_stems(axes, kind, azimuth, gain_db, floor)
    axes.set_ylim(floor, top + 3.0)
    axes.set_rlabel_position(112.5)
    last = math.floor(top / 10.0) * 10.0
    axes.set_yticks([last, last - 20.0, last - 40.0][: 3 if last - 45.0 > floor else 2])
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g} dB")
    axes.tick_params(labelsize="x-small", pad=1)
    axes.set_xticks(np.radians([0, 90, 180, 270]), ["E", "N", "W", "S"])
