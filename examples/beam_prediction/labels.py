"""Labels: the best pair of beams of every link and frame, and what every other transmit beam would gain there."""

from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from examples.beam_prediction.config import RadioConfig
from mmw.channel import (
    CarrierPaths,
    apply_arrays,
    beam_gains,
    best_beams,
    frequency_response,
    normalized_gain,
    rotations_from_poses,
    subcarrier_frequencies,
    ula,
)
from mmw.channel.antennas.array_response import POSE_COLUMNS
from mmw.core.errors import InputError
from mmw.dataset import BeamSearch, Dataset

PORTION = 256
"""Links that are searched at once: 16 x 64 antennas and 5 paths take 21 MB of array responses. Design value."""


@dataclass(frozen=True, eq=False)
class BeamLabels:
    """Labels of L links. A link without any path has beams -1 and gains NaN."""

    rx_beam: np.ndarray
    """Best combiner p*, shape [L], int64."""
    tx_beam: np.ndarray
    """Best precoder q*, shape [L], int64."""
    gain_db: np.ndarray
    """|w(p*)^H H f(q*)|^2 [dB], shape [L]."""
    gains: np.ndarray
    """Normalised gain G(q) of every transmit beam q with combiner p*, shape [L, Q], float32."""


def beam_search(radio: RadioConfig) -> BeamSearch:
    """Return arrays, codebooks and band of the experiment."""
    return BeamSearch(
        tx_array=ula(radio.tx_antennas), rx_array=ula(radio.rx_antennas), tx_beams=radio.beams, rx_beams=radio.beams,
        subcarriers=radio.subcarriers, spacing_hz=radio.spacing_hz,
    )  # fmt: skip


def label_channels(h: np.ndarray, search: BeamSearch) -> BeamLabels:
    """Return the labels of channels by exhaustive search.

    Args:
        h: Channels averaged over subcarriers, shape [L, N_r, N_t].
        search: Whose codebooks are searched.
    """
    tx_book, rx_book = search.codebooks
    gains = beam_gains(h, tx_book, rx_book)
    best = best_beams(gains)
    every = np.broadcast_to(np.arange(tx_book.shape[1]), (len(h), tx_book.shape[1]))
    with np.errstate(divide="ignore"):
        gain_db = np.where(best.gain > 0, 10 * np.log10(best.gain), np.nan)
    return BeamLabels(best.rx_beam, best.tx_beam, gain_db, normalized_gain(gains, every, best).astype(np.float32))


def average_channels(
    paths: CarrierPaths, tx_rotation: np.ndarray, rx_rotation: np.ndarray, s: BeamSearch
) -> np.ndarray:
    """Return H averaged over subcarriers, the first path of a link at delay 0, shape [L, N_r, N_t].

    Args:
        paths: Paths of L links.
        tx_rotation: Agent-to-world rotations of the transmitters, shape [L, 3, 3].
        rx_rotation: The same for the receivers.
        s: Arrays and band.
    """
    a = apply_arrays(paths, s.tx_array, s.rx_array, paths.carrier_hz, tx_rotation, rx_rotation)
    band = subcarrier_frequencies(s.subcarriers, s.spacing_hz)
    return frequency_response(a, paths, band, paths.carrier_hz, average=True, normalize_delays=True)


def part_labels(dataset: Dataset, scenario: str, weather: str, radio: RadioConfig) -> pa.Table:
    """Return the labels of all links from the roadside unit of one scenario and weather, by agent and frame.

    Returns:
        Columns `agent`, `peer`, `frame`, `is_los`, and the arrays of `BeamLabels`.

    Raises:
        InputError: If not exactly one roadside unit transmits, or the dataset has no such carrier.
    """
    paths = dataset.paths(radio.carrier_hz, scenario=scenario, weather=weather)
    poses = dataset.read("poses", columns=[*POSE_COLUMNS, "role"], scenario=scenario, weather=weather)
    role = dict(zip(poses["agent"].to_pylist(), poses["role"].to_pylist(), strict=True))
    units = sorted(peer for peer in set(paths.keys["peer"]) if role[peer] == "rsu")
    if len(units) != 1:
        raise InputError(
            f"{dataset.root}: {scenario} {weather}: {', '.join(units) or 'no roadside unit'} transmits; the experiment "
            "needs exactly one roadside unit; use scenarios with one"
        )
    order = np.lexsort((paths.keys["frame"], paths.keys["agent"].astype(str)))
    paths = paths.take(order[paths.keys["peer"][order] == units[0]])
    is_los = np.zeros(paths.link_count, dtype=bool)
    is_los[paths.link[paths.is_los]] = True
    turns = [rotations_from_poses(poses, paths, end) for end in ("tx", "rx")]
    search, found = beam_search(radio), []
    for first in range(0, paths.link_count, PORTION):
        some = np.arange(first, min(first + PORTION, paths.link_count))
        found.append(
            label_channels(average_channels(paths.take(some), *(turn[some] for turn in turns), search), search)
        )
    gains = np.concatenate([one.gains for one in found])
    return pa.table({
        "agent": paths.keys["agent"].tolist(),
        "peer": paths.keys["peer"].tolist(),
        "frame": paths.keys["frame"],
        "is_los": is_los,
        **{name: np.concatenate([getattr(one, name) for one in found]) for name in ("rx_beam", "tx_beam", "gain_db")},
        "gains": pa.FixedSizeListArray.from_arrays(gains.reshape(-1), gains.shape[1]),
    })  # fmt: skip
