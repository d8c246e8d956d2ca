"""Make the rows of the tables of the radio channel; `path_view` joins those of paths."""

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from mmw.channel.links import Links
from mmw.channel.path_table import first_segments
from mmw.channel.paths import LOS_STATES, PATH_KINDS, PathSet
from mmw.scene.table_rows import Columns, choices


def link_rows(
    agents: Sequence[str], antennas: Sequence[str], kinds: Sequence[str], links: Links, paths: PathSet, weather: str
) -> Columns:
    """Return the `links` table: every link at every carrier, also those without a path.

    `agents` has the names that `tx_actor` and `rx_actor` of the links count, `antennas` those that `tx_antenna` and
    `rx_antenna` count, `kinds` those of `kind`.
    """
    count, carriers = len(links), len(paths.carriers_hz)
    los_state = paths.los_state(weather)
    power = np.abs(paths.a[weather]) ** 2
    doppler = paths.doppler_hz

    def total(values: np.ndarray) -> np.ndarray:
        out = np.empty((count, carriers))
        for carrier in range(carriers):
            out[:, carrier] = np.bincount(paths.link, weights=values[:, carrier], minlength=count)
        return out

    gain = total(power)
    has = gain > 0
    weight = np.where(has, gain, 1.0)

    def moments(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        mean = total(power * values) / weight
        spread = total(power * (values - mean[paths.link]) ** 2) / weight
        return mean, np.sqrt(spread)

    mean_delay, rms_delay = moments(np.broadcast_to(paths.tau[:, None], power.shape))
    doppler_spread = moments(doppler)[1]
    link, carrier = np.repeat(np.arange(count), carriers), np.tile(np.arange(carriers), count)

    def optional(values: np.ndarray) -> pa.Array:
        return pa.array(values[link, carrier], mask=~has[link, carrier])

    return {
        **_ends(agents, antennas, links, link),
        **_carriers(paths, carrier),
        "link": choices(kinds, links.kind[link]),
        "path_count": paths.count[link],
        "is_los": los_state[link] != LOS_STATES.index("blocked"),
        "los_state": choices(LOS_STATES, los_state[link]),
        "gain_db": optional(10.0 * np.log10(weight)),
        "mean_delay_s": optional(mean_delay),
        "rms_delay_s": optional(rms_delay),
        "doppler_spread_hz": optional(doppler_spread),
    }


def path_geometry_rows(agents: Sequence[str], antennas: Sequence[str], links: Links, paths: PathSet) -> Columns:
    """Return the `path_geometry` table: every path once; `agents` and `antennas` as for `link_rows`."""
    interactions = paths.interaction != 0

    def lists(values: np.ndarray, width: int = 1, is_there: np.ndarray = interactions) -> pa.Array:
        offsets = np.concatenate([[0], np.cumsum(is_there.sum(axis=1))]).astype(np.int32)
        flat = pa.array(np.ascontiguousarray(values[is_there]).reshape(-1))
        ends = pa.array(offsets * np.int32(width))
        return pa.ListArray.from_arrays(ends, flat, type=pa.list_(pa.field("element", flat.type, nullable=False)))

    return {
        **_ends(agents, antennas, links, paths.link),
        "path": paths.index,
        "path_id": paths.path_id,
        "kind": choices(PATH_KINDS, paths.kind),
        "order": paths.order,
        "tau_s": paths.tau,
        "aod_az": paths.phi_t,
        "aod_ze": paths.theta_t,
        "aoa_az": paths.phi_r,
        "aoa_ze": paths.theta_r,
        "range_rate": paths.range_rate,
        "interactions": lists(paths.interaction),
        "vertices": lists(paths.vertex, 3),
        "objects": lists(paths.object_id),
        "materials": lists(paths.material_id),
        "surfaces": lists(paths.surface),
        "first_segment_m": first_segments(links.tx.position[paths.link], paths.vertex, paths.tau),
        "edge": lists(paths.edge[:, None], 3, ~np.isnan(paths.edge[:, :1])),
        "curvature": lists(paths.curvature[:, None], 6, ~np.isnan(paths.curvature[:, :1])),
    }


def path_gain_rows(
    agents: Sequence[str], antennas: Sequence[str], links: Links, paths: PathSet, weather: str
) -> Columns:
    """Return the `path_gains` table: every path at every carrier; `agents` and `antennas` as for `link_rows`."""
    count, carriers = len(paths), len(paths.carriers_hz)
    path, carrier = np.repeat(np.arange(count), carriers), np.tile(np.arange(carriers), count)
    a, transfer = paths.a[weather][path, carrier], paths.transfer[weather][path, carrier]
    matrix = {
        f"t_{to}{of}_{part}": np.ascontiguousarray(getattr(transfer[:, row, column], word))
        for row, to in enumerate("tp")
        for column, of in enumerate("tp")
        for part, word in (("re", "real"), ("im", "imag"))
    }
    return {
        **_ends(agents, antennas, links, paths.link[path]),
        **_carriers(paths, carrier),
        "path": paths.index[path],
        "a_re": np.ascontiguousarray(a.real),
        "a_im": np.ascontiguousarray(a.imag),
        **matrix,
        **{name: values[path, carrier].astype(np.float32) for name, values in paths.loss_db[weather].items()},
    }


def _ends(agents: Sequence[str], antennas: Sequence[str], links: Links, link: np.ndarray) -> Columns:
    """Return the columns that name links."""
    return {
        "frame": links.frame[link],
        "agent": choices(agents, links.rx_actor[link]),
        "peer": choices(agents, links.tx_actor[link]),
        "antenna": choices(antennas, links.rx_antenna[link]),
        "peer_antenna": choices(antennas, links.tx_antenna[link]),
    }


def _carriers(paths: PathSet, carrier: np.ndarray) -> Columns:
    """Return the columns that name carriers."""
    return {"carrier": carrier.astype(np.int8), "carrier_hz": paths.carriers_hz[carrier]}
