"""Channel estimation and CSI prediction from path tracks.

    python -m examples.csi_prediction out/quickstart

Tracks give the channel between frames, here in every slot of 0.5 ms. Estimation: noisy pilots on every fourth
subcarrier become the whole band, by straight lines and by the linear estimator of least mean square error (LMMSE).
Prediction: the channel some slots ahead, by holding the last one, by a linear predictor on past noisy channels, and by
the paths, each turned on by its own Doppler shift. Estimator and predictor learn on the first half of the recording and
are measured on the second, by the normalised mean square error (NMSE).

Source: S. M. Kay, Fundamentals of Statistical Signal Processing: Estimation Theory, section 12.3 (LMMSE).
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mmw.channel import CarrierPaths, frequency_response, subcarrier_frequencies, tracks_from_table
from mmw.channel.path_tracks import TRACK_COLUMNS, PathTracks
from mmw.dataset import open_dataset

SLOT_S = 0.5e-3
"""Length of a slot at 30 kHz between subcarriers [s]. Source: 3GPP TS 38.211, section 4.3.2."""

F_K = subcarrier_frequencies(64, 30e3)
"""Subcarriers, counted from the carrier [Hz], shape [K]."""

PILOTS = np.arange(0, 64, 4)
ORDER = 4
"""Past slots that the linear predictor looks at. Design value."""

AHEAD = (1, 2, 4, 8)
"""Slots from the last known channel to the predicted one."""


def read_tracks(root: Path, carrier_hz: float) -> PathTracks:
    """Return the path tracks of the first scenario and weather of a dataset."""
    data = open_dataset(root)
    first = data.read("frames", columns=["scenario", "weather"]).slice(0, 1).to_pylist()[0]
    paths, links = data.read("paths", columns=TRACK_COLUMNS, **first), data.read("links", **first)
    return tracks_from_table(paths, carrier_hz, links, rate_hz=data.frame_rate_hz(first["scenario"]))


def response(rows: CarrierPaths, ahead_s: float = 0.0) -> np.ndarray:
    """Return H(f_k) of every link, its paths turned on by their Doppler shifts for some time [s], shape [L, K]."""
    return frequency_response(rows.a[:, None, None], rows, F_K, rows.carrier_hz, ahead_s)[:, 0, 0]


def with_noise(h: np.ndarray, snr_db: float, rng: np.random.Generator) -> np.ndarray:
    """Return channels as pilots show them, with noise of a power that is `snr_db` below that of each link."""
    power = np.mean(np.abs(h) ** 2, axis=(0, 2), keepdims=True) * 10 ** (-snr_db / 10)
    return h + np.sqrt(power / 2) * (rng.standard_normal(h.shape) + 1j * rng.standard_normal(h.shape))


def nmse_db(found: np.ndarray, true: np.ndarray) -> float:
    """Return the squared error over the power, each link's own, mean over links [dB]."""
    error = np.sum(np.abs(found - true) ** 2, axis=(0, 2)) / np.sum(np.abs(true) ** 2, axis=(0, 2))
    return float(10 * np.log10(error.mean()))


def interpolate(pilots: np.ndarray) -> np.ndarray:
    """Return the band by straight lines between pilots, shape [T, L, K], held beyond the last."""
    flat = pilots.reshape(-1, len(PILOTS))
    full = [np.interp(F_K, F_K[PILOTS], one.real) + 1j * np.interp(F_K, F_K[PILOTS], one.imag) for one in flat]
    return np.reshape(full, (*pilots.shape[:2], len(F_K)))


def lmmse(known: np.ndarray, pilots: np.ndarray, snr_db: float) -> np.ndarray:
    """Return the band by R_hp (R_pp + N)^-1 y, the covariances being those of known channels, link by link.

    Args:
        known: Channels of the first half, shape [T, L, K].
        pilots: Noisy pilots y, shape [T, L, pilots].
        snr_db: Signal over noise [dB].
    """
    covariance = np.einsum("tlj,tlk->ljk", known, known.conj()) / len(known)
    noise = np.mean(np.abs(known) ** 2, axis=(0, 2)) * 10 ** (-snr_db / 10)
    observed = covariance[:, PILOTS[:, None], PILOTS] + noise[:, None, None] * np.eye(len(PILOTS))
    weights = np.linalg.solve(observed.swapaxes(1, 2), covariance[:, :, PILOTS].swapaxes(1, 2)).swapaxes(1, 2)
    return np.einsum("lkp,tlp->tlk", weights, pilots)


def predictor(known: np.ndarray, ahead: int) -> np.ndarray:
    """Return the weights of the last `ORDER` channels that predict the one `ahead` slots later, shape [L, ORDER]."""
    past = np.stack([known[i : len(known) - ahead - ORDER + 1 + i] for i in range(ORDER)], axis=-1)
    target = known[ORDER - 1 + ahead :]
    weights = []
    for link in range(known.shape[1]):
        x, y = past[:, link].reshape(-1, ORDER), target[:, link].reshape(-1)
        weights.append(np.linalg.lstsq(x, y, rcond=1e-6)[0])
    return np.array(weights)


def main(argv: Sequence[str] | None = None) -> None:
    """Estimate, predict, print."""
    parser = argparse.ArgumentParser(prog="python -m examples.csi_prediction")
    parser.add_argument("root", type=Path, help="dataset with paths")
    parser.add_argument("--carrier", type=float, default=28e9, help="carrier [Hz]")
    parser.add_argument("--snr", type=float, default=20.0, help="signal over noise of a pilot [dB]")
    given = parser.parse_args(argv)
    tracks, rng = read_tracks(given.root, given.carrier), np.random.default_rng(0)
    times = np.arange(tracks.frames[0] / tracks.rate_hz, tracks.frames[-1] / tracks.rate_hz, SLOT_S)
    half = len(times) // 2
    moments = [tracks.at(time) for time in times]
    h = np.stack([response(rows) for rows in moments])  # [T, L, K]
    alive = (np.abs(h) > 0).all(axis=(0, 2))
    if not alive.any() or half <= max(AHEAD) + 2 * ORDER:
        sys.exit(f"{given.root}: {alive.sum()} links with paths all along, {len(times)} slots; take a longer dataset")
    h = h[:, alive]
    noisy = with_noise(h, given.snr, rng)
    pilots, late = noisy[half:, :, PILOTS], h[half:]
    print(f"{tracks.scenario}, {tracks.weather}: {alive.sum()} links, {len(times)} slots, pilots at {given.snr:g} dB")
    print(f"estimation, NMSE: straight lines {nmse_db(interpolate(pilots), late):.1f} dB, LMMSE "
          f"{nmse_db(lmmse(h[:half], pilots, given.snr), late):.1f} dB")  # fmt: skip
    print("prediction, NMSE [dB]   ms ahead   hold   linear   paths and Doppler")
    for ahead in AHEAD:
        weights = predictor(noisy[:half], ahead)
        first, last = half + ORDER - 1, len(times) - ahead
        past = np.stack([noisy[first + i - ORDER + 1 : last + i - ORDER + 1] for i in range(ORDER)], axis=-1)
        turned = np.stack([response(moments[t], ahead * SLOT_S)[alive] for t in range(first, last)])
        found = (noisy[first:last], np.einsum("tlko,lo->tlk", past, weights), turned)
        errors = [nmse_db(one, h[first + ahead : last + ahead]) for one in found]
        print(f"{ahead * SLOT_S * 1e3:31.1f} {errors[0]:6.1f} {errors[1]:8.1f} {errors[2]:19.1f}")


if __name__ == "__main__":
    main(sys.argv[1:])
