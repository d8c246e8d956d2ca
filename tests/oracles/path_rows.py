"""Rows of the view `paths` made at once from solved paths, without tables and their join."""

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from mmw.channel.links import Links
from mmw.channel.path_table import first_segments
from mmw.channel.paths import PATH_KINDS, PathSet
from mmw.channel.tables import PATHS
from mmw.scene.table_rows import Columns, choices
from mmw.storage.parquet_schema import arrow_schema


def path_table(columns: Columns) -> pa.Table:
    """Return columns, and texts that all rows have, as the view has them, in the order of its key."""
    schema, count = arrow_schema(PATHS), len(columns["frame"])
    values = [columns[field.name] for field in schema]
    arrays = [pa.array([one] * count if isinstance(one, str) else one) for one in values]
    table = pa.Table.from_arrays([a.cast(f.type) for a, f in zip(arrays, schema, strict=True)], schema=schema)
    keys = list(zip(*(table[name].to_pylist() for name in PATHS.full_key), strict=True))
    return table.take(pa.array(sorted(range(count), key=keys.__getitem__), pa.int64()))


def path_rows(
    agents: Sequence[str], links: Links, paths: PathSet, weather: str, antennas: Sequence[str] = ("antenna",)
) -> Columns:
    """Return the columns of the view `paths`, every path at every carrier; arguments as those of `link_rows`."""
    count, carriers = len(paths), len(paths.carriers_hz)
    path, carrier = np.repeat(np.arange(count), carriers), np.tile(np.arange(carriers), count)
    link = paths.link[path]
    a, transfer = paths.a[weather][path, carrier], paths.transfer[weather][path, carrier]
    is_there = paths.interaction[path] != 0
    offsets = np.concatenate([[0], np.cumsum(is_there.sum(axis=1))]).astype(np.int32)

    def lists(values: np.ndarray, width: int = 1) -> pa.Array:
        flat = pa.array(np.ascontiguousarray(values[path][is_there]).reshape(-1))
        ends = pa.array(offsets * np.int32(width))
        return pa.ListArray.from_arrays(ends, flat, type=pa.list_(pa.field("element", flat.type, nullable=False)))

    matrix = {
        f"t_{to}{of}_{part}": np.ascontiguousarray(getattr(transfer[:, row, column], word))
        for row, to in enumerate("tp")
        for column, of in enumerate("tp")
        for part, word in (("re", "real"), ("im", "imag"))
    }
    return {
        "frame": links.frame[link],
        "agent": choices(agents, links.rx_actor[link]),
        "peer": choices(agents, links.tx_actor[link]),
        "antenna": choices(antennas, links.rx_antenna[link]),
        "peer_antenna": choices(antennas, links.tx_antenna[link]),
        "carrier": carrier.astype(np.int8),
        "carrier_hz": paths.carriers_hz[carrier],
        "path": paths.index[path],
        "path_id": paths.path_id[path],
        "kind": choices(PATH_KINDS, paths.kind[path]),
        "order": paths.order[path],
        "tau_s": paths.tau[path],
        "a_re": np.ascontiguousarray(a.real),
        "a_im": np.ascontiguousarray(a.imag),
        **matrix,
        "aod_az": paths.phi_t[path],
        "aod_ze": paths.theta_t[path],
        "aoa_az": paths.phi_r[path],
        "aoa_ze": paths.theta_r[path],
        "doppler_hz": paths.doppler_hz[path, carrier],
        **{name: values[path, carrier].astype(np.float32) for name, values in paths.loss_db[weather].items()},
        "interactions": lists(paths.interaction),
        "vertices": lists(paths.vertex, 3),
        "objects": lists(paths.object_id),
        "materials": lists(paths.material_id),
        "surfaces": lists(paths.surface),
        "first_segment_m": first_segments(links.tx.position[link], paths.vertex[path], paths.tau[path]),
        **{
            name: pa.array(
                [[] if np.isnan(one).any() else one.tolist() for one in values[path]], pa.list_(pa.float64())
            )
            for name, values in (("edge", paths.edge), ("curvature", paths.curvature))
        },
    }
