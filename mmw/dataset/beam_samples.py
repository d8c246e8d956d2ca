"""Samples of positions and beam powers: the common form of measured data and of links of a dataset."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mmw.channel.antennas.array_response import POSE_COLUMNS, apply_arrays, rotations_from_poses
from mmw.channel.antennas.arrays import ula
from mmw.channel.codebook import beam_gains
from mmw.channel.response import frequency_response, subcarrier_frequencies
from mmw.core.errors import InputError
from mmw.dataset.beams import PORTION, BeamSearch
from mmw.dataset.dataset import Dataset, open_dataset

__all__ = ["BeamSamples", "link_samples", "with_noise"]


@dataclass(frozen=True, eq=False)
class BeamSamples:
    """N samples of one base station and its users: where a user says it is, and what every beam receives.

    Raises:
        InputError: If lengths do not fit, or a sample has no beam with a power.
    """

    name: str
    """Scenario."""
    position_deg: np.ndarray
    """Measured latitude and longitude of the user, shape [N, 2]."""
    power: np.ndarray
    """Power of each beam, linear, in any unit, NaN where it was not measured, shape [N, Q]. Of links it is that of
    the vehicle's best beam."""
    sequence: np.ndarray
    """Drive of each sample; samples of a drive follow each other in time, shape [N], int64."""
    base_deg: np.ndarray | None = None
    """Measured latitude and longitude of the base station, shape [2]; None if it has none."""
    images: tuple[Path, ...] = ()
    """File of the base station's picture of each sample; empty without pictures."""

    def __post_init__(self) -> None:
        lengths = {name: len(getattr(self, name)) for name in ("position_deg", "power", "sequence")}
        if self.images:
            lengths["images"] = len(self.images)
        if len(set(lengths.values())) != 1 or self.position_deg.shape[1:] != (2,) or self.power.ndim != 2:
            raise InputError(
                f"{self.name}: samples {lengths}, position_deg {self.position_deg.shape}, power {self.power.shape}; "
                "each needs one row a sample, positions two columns and powers one a beam"
            )
        empty = np.flatnonzero(~np.isfinite(self.power).any(axis=1))
        if len(empty) or not len(self.power):
            where = f"sample {empty[0]} has no power of any beam" if len(empty) else "there is no sample"
            raise InputError(f"{self.name}: {where}; leave such samples out")

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.power)

    @property
    def beams(self) -> np.ndarray:
        """Best beam of each sample, the first of equal ones, shape [N], int64."""
        return np.nanargmax(self.power, axis=1)

    def select(self, which: np.ndarray) -> "BeamSamples":
        """Return some of the samples, by their numbers, shape [k], or a mask, shape [N]."""
        rows = np.arange(len(self))[which]
        images = tuple(self.images[row] for row in rows) if self.images else ()
        return replace(
            self, position_deg=self.position_deg[rows], power=self.power[rows], sequence=self.sequence[rows],
            images=images,
        )  # fmt: skip

    def windows(self, past: int, future: int) -> np.ndarray:
        """Return the samples of windows of `past` and then `future` samples within a drive, shape [n, past + future].

        `samples.beams[rows[:, :past]]` are the inputs of beam tracking and `samples.beams[rows[:, past:]]` its targets,
        as in `examples/beam_prediction`.

        Raises:
            InputError: If no drive is that long.
        """
        length = past + future
        if past < 1 or future < 0:
            raise InputError(f"{self.name}: windows of {past} past and {future} future samples; at least 1 and 0")
        starts = np.arange(max(len(self) - length + 1, 0))
        # A drive may be cut in two by samples of another; then its number changes in between.
        changes = np.concatenate([[0], np.cumsum(np.diff(self.sequence) != 0)])
        starts = starts[changes[starts] == changes[starts + length - 1]]
        if not len(starts):
            raise InputError(f"{self.name}: no drive has {length} samples in a row; shorten the windows")
        return starts[:, None] + np.arange(length)


def link_samples(
    dataset: Dataset | str | Path,
    *,
    scenario: str,
    carrier_hz: float,
    weather: str = "sunny",
    peer: str | None = None,
    agents: Sequence[str] | None = None,
    search: BeamSearch | None = None,
    snr_db: float | None = None,
    seed: int = 0,
) -> BeamSamples:
    """Return the samples of the links from a roadside unit to vehicles with GNSS.

    Frames without a path or without a position are left out.

    A drive is one vehicle. Positions are those that its receiver measures (table `gnss`).

    Args:
        dataset: A dataset with tables `gnss`, `poses`, `links` and paths.
        scenario: Its scenario.
        carrier_hz: Carrier of the links [Hz].
        weather: Its weather.
        peer: Transmitter; None for the only roadside unit.
        agents: Only these vehicles.
        search: Arrays, codebooks and band; by default 16 antennas in a row and 64 beams of a DFT codebook at the unit,
            and one antenna on the vehicle, as in DeepSense 6G, whose 64 beams fan over 90 degrees only.
        snr_db: Power of the best beam over the noise of the receiver in the median sample [dB]: every beam is measured
            once, with complex Gaussian noise. None for powers without noise.
        seed: Seed of the noise.

    Raises:
        InputError: If a table, the carrier or the roadside unit is missing, or no link has a path and a position.

    Examples:
        >>> samples = link_samples("out/quickstart", scenario="town03_roundabout", carrier_hz=28e9)
        >>> samples.power.shape[1], samples.name
        (64, 'town03_roundabout')
    """
    data = dataset if isinstance(dataset, Dataset) else open_dataset(dataset)
    search = search or BeamSearch(ula(16), ula(1), tx_beams=64, rx_beams=1, subcarriers=64)
    rows = {"scenario": scenario, "weather": weather}
    paths = data.paths(carrier_hz, **rows)
    poses = data.read("poses", columns=[*POSE_COLUMNS, "role"], **rows)
    roles = dict(zip(poses["agent"].to_pylist(), poses["role"].to_pylist(), strict=True))
    units = [peer] if peer else sorted({name for name in paths.keys["peer"] if roles[name] == "rsu"})
    if len(units) != 1:
        raise InputError(
            f"{data.root}: {scenario}: {', '.join(units) or 'no roadside unit'} transmits; one is needed; name it by "
            "peer"
        )
    fixes = {(row["frame"], row["agent"]): row for row in data.read("gnss", **rows).to_pylist()}
    keys = [(int(frame), agent) for frame, agent in zip(paths.keys["frame"], paths.keys["agent"], strict=True)]
    has_path = np.bincount(paths.link, minlength=paths.link_count) > 0
    is_used = has_path & (paths.keys["peer"] == units[0])
    is_used &= [key in fixes and (agents is None or key[1] in agents) for key in keys]
    if not is_used.any():
        raise InputError(
            f"{data.root}: {scenario}, {weather}: no link from {units[0]} has a path and a position by GNSS; record "
            "sensor gnss, and vehicles that the unit reaches"
        )
    chosen = np.flatnonzero(is_used)
    chosen = chosen[np.lexsort((paths.keys["frame"][chosen], paths.keys["agent"][chosen].astype(str)))]
    fix = [fixes[keys[link]] for link in chosen]
    _, sequence = np.unique([keys[link][1] for link in chosen], return_inverse=True)
    turns = [rotations_from_poses(poses, paths, end)[chosen] for end in ("tx", "rx")]
    band, books = subcarrier_frequencies(search.subcarriers, search.spacing_hz), search.codebooks
    power = []
    for first in range(0, len(chosen), PORTION):
        part = slice(first, first + PORTION)
        some = paths.take(chosen[part])
        ends = search.tx_array, search.rx_array, carrier_hz, *(turn[part] for turn in turns)
        a = apply_arrays(some, *ends, wavefront=search.wavefront)
        h = frequency_response(a, some, band, carrier_hz, average=True, normalize_delays=True)
        power.append(beam_gains(h, *books).max(axis=1))
    powers = np.concatenate(power)
    if snr_db is not None:
        powers = with_noise(powers, snr_db, np.random.default_rng(seed))
    return BeamSamples(
        scenario,
        np.array([[row["latitude_deg"], row["longitude_deg"]] for row in fix]),
        powers,
        sequence.astype(np.int64),
    )


def with_noise(power: np.ndarray, snr_db: float, rng: np.random.Generator) -> np.ndarray:
    """Return powers as a receiver with one noise level measures them, |sqrt(P) + n|^2, shape [N, Q].

    Args:
        power: Powers without noise, shape [N, Q].
        snr_db: Best beam of the median sample over noise [dB].
        rng: Random numbers.
    """
    noise = np.median(power.max(axis=1)) * 10.0 ** (-snr_db / 10.0)
    real, imaginary = rng.normal(scale=np.sqrt(noise / 2.0), size=(2, *power.shape))
    return (np.sqrt(power) + real) ** 2 + imaginary**2
