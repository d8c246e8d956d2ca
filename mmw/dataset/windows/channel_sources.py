"""Radio features of a window in memory: link figures, frequency responses and best beams, one link per agent."""

import dataclasses
import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from mmw.channel.antennas.array_response import POSE_COLUMNS, rotations_from_poses
from mmw.channel.antennas.patterns import PATTERNS
from mmw.channel.path_table import LINK_COLUMNS, CarrierPaths
from mmw.channel.response import frequency_response
from mmw.core.errors import InputError
from mmw.dataset.beams import BeamSearch
from mmw.dataset.windows.memory_sources import RowSource, in_order, no_samples, number_columns, parts_of, stacked
from mmw.dataset.windows.tracks import Track, find_latest, groups
from mmw.dataset.windows.window_spec import Feature
from mmw.storage.atomic_files import write_bytes_atomically

if TYPE_CHECKING:
    from mmw.dataset import Dataset

LINK = ("frame", "agent", "peer", "antenna", "peer_antenna", "carrier_hz", "link")


def link_source(dataset: "Dataset", feature: Feature, tracks: Sequence[Track], cache: Path | None) -> RowSource:
    """Return `links`, `beams` or `csi` of one link and carrier of every agent, the receiver, one row a frame.

    Raises:
        InputError: If several transmitters or carriers fit and none is named, no link has the one that is named, or a
            folder `cache` is given for a search that cannot be named in a file.
    """
    columns = number_columns(feature) if feature.kind == "numbers" else ()
    latest, count, found = no_samples(tracks), 0, []
    carrier = one_carrier(dataset, feature)
    for scenario, weather, agents in parts_of(tracks):
        names = list(dict.fromkeys([*LINK, *columns]))
        rows = dataset.read("links", columns=names, scenario=scenario, weather=weather)
        rows = rows.filter(pc.equal(rows.column("carrier_hz"), carrier))
        peer = one_peer(feature, rows, scenario)
        own = pc.and_(
            pc.equal(rows.column("peer").cast(pa.string()), peer or ""),
            pc.is_in(rows.column("agent").cast(pa.string()), pa.array(list(agents), pa.string())),
        )
        rows = of_antennas(feature, rows.filter(own), scenario)
        frames = rows.column("frame").to_numpy().astype(np.int64)
        for (agent,), some in groups(rows, ("agent",)).items():
            track = tracks[agents[agent]]
            some = in_order(frames, some, feature, track)
            latest[agents[agent]] = find_latest(track, frames[some], some + count, feature.max_age_frames or 0)
        count += len(frames)
        if feature.kind == "numbers":
            found.append({"": stacked(rows, columns, np.float32)})
        elif feature.kind == "csi":
            paths = _paths_of(dataset, rows, carrier, scenario, weather)
            h = frequency_response(paths.a[:, None, None], paths, feature.frequencies_hz, carrier)[:, 0, 0]
            found.append({"": np.stack([h.real, h.imag], axis=1).astype(np.float32)})
        else:
            found.append(_beams(dataset, rows, carrier, scenario, weather, feature.search, cache))
    if not count:
        raise InputError(
            f"Feature({feature.modality!r}): no link of {feature.peer or 'a roadside unit'} to these agents at "
            f"{carrier:g} Hz; name a `peer` that transmits to them"
        )
    return RowSource(latest, {name: np.concatenate([one[name] for one in found]) for name in found[0]})


def one_carrier(dataset: "Dataset", feature: Feature) -> float:
    """Return the carrier of a feature [Hz].

    Raises:
        InputError: If several are there and none is named, or the named one is not there.
    """
    known = sorted(pc.unique(dataset.read("links", columns=["carrier_hz"]).column("carrier_hz")).to_pylist())
    listed = ", ".join(f"{carrier:g}" for carrier in known) or "no carrier"
    if feature.carrier_hz is None and len(known) != 1:
        raise InputError(f"Feature({feature.modality!r}): the dataset has {listed} Hz; name one as `carrier_hz`")
    carrier = known[0] if feature.carrier_hz is None else feature.carrier_hz
    if carrier not in known:
        raise InputError(
            f"Feature({feature.modality!r}): carrier_hz = {carrier:g}; the dataset has {listed} Hz; name one"
        )
    return carrier


def one_peer(feature: Feature, rows: pa.Table, scenario: str) -> str | None:
    """Return the transmitter of a feature in one scenario; None if nothing transmits.

    Raises:
        InputError: If several roadside units transmit and none is named.
    """
    if feature.peer is not None:
        return feature.peer
    is_v2i = pc.equal(rows.column("link").cast(pa.string()), "v2i")
    known = sorted(pc.unique(rows.filter(is_v2i).column("peer").cast(pa.string())).to_pylist())
    if len(known) > 1:
        raise InputError(
            f"Feature({feature.modality!r}): {', '.join(known)} transmit in {scenario}; name one of them as `peer`"
        )
    return known[0] if known else None


def of_antennas(feature: Feature, rows: pa.Table, scenario: str) -> pa.Table:
    """Return the rows of links between the antennas of a feature.

    Raises:
        InputError: If an end has several and none is named.
    """
    for column in ("antenna", "peer_antenna"):
        names = rows.column(column).cast(pa.string())
        known, wanted = sorted(pc.unique(names).to_pylist()), getattr(feature, column)
        if wanted is None and len(known) > 1:
            raise InputError(
                f"Feature({feature.modality!r}): links of {scenario} have {', '.join(known)}; name one as `{column}`"
            )
        if wanted is not None:
            rows = rows.filter(pc.equal(names, wanted))
    return rows


def _paths_of(dataset: "Dataset", rows: pa.Table, carrier: float, scenario: str, weather: str) -> CarrierPaths:
    """Return the paths of rows of `links`; link n of the result is row n."""
    paths = dataset.paths(carrier, scenario=scenario, weather=weather)
    place = {tuple(key): n for n, (_, _, *key) in enumerate(paths.keys.tolist())}
    wanted = zip(*(rows.column(name).to_pylist() for name in LINK_COLUMNS[2:-1]), strict=True)
    return paths.take(np.array([place[key] for key in wanted], dtype=np.int64))


def _beams(
    dataset: "Dataset", rows: pa.Table, carrier: float, scenario: str, weather: str, search: BeamSearch,
    cache: Path | None,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Return the best pair of beams and its gain of rows of `links`."""
    file = None
    if cache is not None:
        links = list(zip(*(rows.column(name).to_pylist() for name in LINK_COLUMNS[2:-1]), strict=True))
        made = [dataset.info[name] for name in ("config_sha256", "created_utc")]
        about = [*made, scenario, weather, carrier, search_text(search), links]
        file = cache / f"beams-{hashlib.sha256(json.dumps(about).encode()).hexdigest()[:32]}.parquet"
        if file.is_file():
            stored = pq.read_table(file)
            pair = np.stack([stored.column(name).to_numpy() for name in ("rx_beam", "tx_beam")], axis=-1)
            return {"": pair, "_gain": stored.column("gain").to_numpy()}
    paths = _paths_of(dataset, rows, carrier, scenario, weather)
    poses = dataset.read("poses", columns=list(POSE_COLUMNS), scenario=scenario, weather=weather)
    best = search.best(paths, *(rotations_from_poses(poses, paths, end) for end in ("tx", "rx")))
    pair, gain = np.stack([best.rx_beam, best.tx_beam], axis=-1), best.gain.astype(np.float32)
    if file is not None:
        table = pa.table({"rx_beam": pair[:, 0], "tx_beam": pair[:, 1], "gain": gain})
        sink = pa.BufferOutputStream()
        pq.write_table(table, sink)
        write_bytes_atomically(file, memoryview(sink.getvalue()))
    return {"": pair, "_gain": gain}


def search_text(search: BeamSearch) -> dict[str, Any]:
    """Return everything that a search depends on as JSON values.

    Raises:
        InputError: If an array has a pattern that is not one of mmw's names, or a polarization that is no name or
            numbers.
    """
    about = dataclasses.asdict(search)
    patterns = (search.tx_array.pattern, search.rx_array.pattern)
    try:
        json.dumps(about)
        is_named = all(PATTERNS.owner(str(pattern)) == "mmw" for pattern in patterns)  # others may change between runs
    except TypeError:
        is_named = False
    if not is_named:
        raise InputError(
            "open_windows: beams of a pattern that is a table, a function or registered cannot be stored in `cache`; "
            "leave it out"
        )
    return about
