"""Read paths of any number of links at one carrier from rows of the view `paths` and table `links`, as flat arrays."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import ArrayLike

from mmw.channel.paths import PATH_LOS, PathSet
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.physics.em.vectors import norm

if TYPE_CHECKING:  # it brings Warp, which datasets are read without
    from mmw.channel.links import Links

LINK_COLUMNS = ("scenario", "weather", "frame", "agent", "peer", "antenna", "peer_antenna", "carrier_hz")
"""Columns that name a link, and its carrier, in both tables."""
NEEDED_COLUMNS = (
    *LINK_COLUMNS, "order", "tau_s", "a_re", "a_im", "t_tt_re", "t_tt_im", "t_tp_re", "t_tp_im", "t_pt_re", "t_pt_im",
    "t_pp_re", "t_pp_im", "aod_az", "aod_ze", "aoa_az", "aoa_ze", "doppler_hz",
)  # fmt: skip
"""Columns of the view `paths` that `CarrierPaths.from_table` needs."""
WAVEFRONT_COLUMNS = ("interactions", "vertices", "first_segment_m", "edge", "curvature")
"""Columns of the view `paths` that arrays need where waves are no planes over them."""
PATH_COLUMNS = (*NEEDED_COLUMNS, *WAVEFRONT_COLUMNS)
"""Columns of the view `paths` that `CarrierPaths.from_table` reads."""
KEY_TYPE = np.dtype([(name, np.int64 if name == "frame" else object) for name in LINK_COLUMNS[:-1]])
"""Type of `CarrierPaths.keys`."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PathSamples:
    """Samples of paths at one carrier, each from a row of the view `paths`. World frame, seconds, radians, e^{+jwt}."""

    carrier_hz: float
    """Carrier frequency of every path [Hz]."""
    row: np.ndarray
    """Row of the table (or of `PathSet`) that each came from, shape [P], int64; for columns that are not here."""
    is_los: np.ndarray
    """True for the line of sight, shape [P]."""
    tau: np.ndarray
    """Absolute delay [s], shape [P], float64."""
    transfer: np.ndarray
    """2x2 polarimetric transfer, shape [P, 2, 2], complex128: row = receive, column = transmit component in the
    world's (theta, phi) basis at arrival and departure. No antenna pattern, no carrier phase."""
    a: np.ndarray
    """Coefficient between the single antennas that were configured when the dataset was made, without the carrier
    phase, shape [P], complex128."""
    theta_t: np.ndarray
    """Zenith of departure, shape [P]."""
    phi_t: np.ndarray
    """Azimuth of departure, shape [P]."""
    theta_r: np.ndarray
    """Zenith of arrival: direction from the receiver back along the path, shape [P]."""
    phi_r: np.ndarray
    """Azimuth of arrival, shape [P]."""
    doppler_hz: np.ndarray
    """Doppler shift, positive while the path gets shorter [Hz], shape [P]."""
    interaction: np.ndarray
    """Each interaction from transmitter to receiver (`mmw.physics.em.interaction`), 0 behind the last, shape [P, D],
    int8; -1 in the first place where rows have no column of them."""
    vertex: np.ndarray
    """Point of each interaction [m], NaN behind the last, shape [P, D, 3]."""
    first_segment_m: np.ndarray
    """Length from the transmitter to the first point, or of a line of sight [m], NaN if not read, shape [P]."""
    edge: np.ndarray
    """Unit vector along the edge that diffracts, NaN without one, shape [P, 3]."""
    curvature: np.ndarray
    """Curvature of the surface that reflects, NaN for flat ones, xx, xy, xz, yy, yz, zz [1/m], shape [P, 6]."""


SAMPLE_COLUMNS = tuple(field.name for field in fields(PathSamples)[1:])
"""Arrays of `PathSamples`."""
_SAMPLES = attrgetter(*SAMPLE_COLUMNS)


@dataclass(frozen=True, eq=False, kw_only=True)
class CarrierPaths(PathSamples):
    """Paths of L links at one carrier, sorted by link.

    A link without any path is a row of `keys` that no entry of `link` names.

    Raises:
        InputError: If arrays differ in length, or paths are not sorted by link.

    Examples:
        >>> import mmw
        >>> paths = mmw.open_dataset("out/quickstart").paths(28e9, weather="sunny", frames=range(0, 1))
        >>> paths.link_count, paths.path_count.tolist()
        (3, [2, 1, 4])
        >>> paths.keys[0].tolist()  # scenario, weather, frame, receiver, transmitter, the antenna of each
        ('town03_roundabout', 'sunny', 0, 'cav_1', 'rsu_1', 'antenna', 'antenna')
    """

    keys: np.ndarray
    """Name of each link: scenario, weather, frame, agent (the receiver), peer (the transmitter) and the antennas of
    both, a structured array of `KEY_TYPE`, shape [L]."""
    link: np.ndarray
    """Link of each path, 0 to L - 1, growing, shape [P], int64."""

    def __post_init__(self) -> None:
        if set(map(len, _SAMPLES(self))) != {len(self.link)} or self.transfer.shape[1:] != (2, 2):
            lengths = {name: len(getattr(self, name)) for name in ("link", *SAMPLE_COLUMNS)}
            raise InputError(
                f"CarrierPaths: {lengths} paths, transfer {self.transfer.shape}; every array needs one row a path"
            )
        is_growing = not np.count_nonzero(self.link[1:] < self.link[:-1])
        if not is_growing or (len(self.link) and not 0 <= self.link[0] <= self.link[-1] < len(self.keys)):
            raise InputError(
                f"CarrierPaths: link is not growing from 0 to {len(self.keys) - 1}; sort the paths by link"
            )

    def __len__(self) -> int:
        """Return the number of paths."""
        return len(self.link)

    @property
    def link_count(self) -> int:
        """Number of links L, with and without paths."""
        return len(self.keys)

    @property
    def path_count(self) -> np.ndarray:
        """Number of paths of each link, shape [L], int64."""
        return np.bincount(self.link, minlength=self.link_count)

    def take(self, links: ArrayLike) -> "CarrierPaths":
        """Return some links and their paths; link n of the result is `links[n]`.

        Args:
            links: Indices of links, each once, shape [n]; or a mask, shape [L].
        """
        links = np.asarray(links)
        links = np.flatnonzero(links) if links.dtype == bool else links.astype(np.int64)
        where = np.full(self.link_count, -1, dtype=np.int64)
        where[links] = np.arange(len(links))
        if len(np.unique(links)) != len(links):
            raise InputError(f"CarrierPaths.take: {len(links)} links, some more than once; name each link once")
        link = where[self.link]
        path = np.flatnonzero(link >= 0)
        path = path[np.argsort(link[path], kind="stable")]
        columns = {name: getattr(self, name)[path] for name in SAMPLE_COLUMNS}
        return replace(self, keys=self.keys[links], link=link[path], **columns)

    @classmethod
    def from_table(cls, table: Any, carrier_hz: float | None = None, links: Any = None) -> "CarrierPaths":
        """Return the paths of rows of the view `paths`, grouped by link.

        Args:
            table: Rows of the view `paths` in any order, with `PATH_COLUMNS`: a pyarrow Table, a pandas DataFrame, or a
                mapping of column names to arrays. Without `WAVEFRONT_COLUMNS` arrays can have plane waves only.
            carrier_hz: Carrier [Hz]; None selects the only one there is.
            links: Rows of table `links` (at least `LINK_COLUMNS`), of any of those kinds. Links are then in the order
                of these rows, and links without any path are among them. Without it links are in the order in which
                they come in `table`, and a link without a path cannot be known.

        Raises:
            InputError: If a column is missing, a value is null, more than one carrier is there and none is named, the
                named one is not there, or a path belongs to no row of `links`.
        """
        carriers = [read_column(table, "paths", "carrier_hz", NEEDED_COLUMNS)]
        if links is not None:
            carriers.append(read_column(links, "links", "carrier_hz", LINK_COLUMNS))
        carrier_hz = _one_carrier(np.concatenate([read_numbers("carrier_hz", c) for c in carriers]), carrier_hz)
        rows = [np.flatnonzero(read_numbers("carrier_hz", c) == carrier_hz) for c in carriers]
        codes = keys = None
        for name in LINK_COLUMNS[:-1]:
            parts = [read_column(table, "paths", name, NEEDED_COLUMNS).take(pa.array(rows[0]))]
            if links is not None:
                parts.insert(0, read_column(links, "links", name, LINK_COLUMNS).take(pa.array(rows[1])))
            code, values = encode_key(name, parts)
            keys = np.empty(len(code), dtype=KEY_TYPE) if keys is None else keys
            keys[name] = values[code]
            codes = code if codes is None else np.unique(codes * len(values) + code, return_inverse=True)[1]
        assert codes is not None and keys is not None  # there is at least one key column
        _, first, link = np.unique(codes, return_index=True, return_inverse=True)
        order = np.argsort(first, kind="stable")
        rank = np.empty(len(order), dtype=np.int64)
        rank[order] = np.arange(len(order))
        link, first, head = rank[link], first[order], len(codes) - len(rows[0])
        if links is not None and (first >= head).any():
            lost = dict(zip(KEY_TYPE.names or (), keys[first[first >= head][0]], strict=True))
            raise InputError(
                f"table links: {int((first >= head).sum())} links of paths have no row in it, the first {lost}; give "
                "the rows of the same scenarios, weathers, frames and agents from both tables"
            )
        if links is not None and len(first) != head:
            raise InputError(f"table links: {head - len(first)} rows repeat a link; give each link once a carrier")
        link = link[head:]
        path = np.argsort(link, kind="stable")
        row = rows[0][path]

        def number(name: str) -> np.ndarray:
            return read_numbers(name, read_column(table, "paths", name, NEEDED_COLUMNS))[row]

        def pair(name: str) -> np.ndarray:
            return number(f"{name}_re") + 1j * number(f"{name}_im")

        return cls(
            carrier_hz=carrier_hz,
            keys=keys[first],
            link=link[path],
            row=row,
            is_los=number("order") == 0,
            tau=number("tau_s"),
            transfer=np.stack([pair("t_tt"), pair("t_tp"), pair("t_pt"), pair("t_pp")], axis=-1).reshape(-1, 2, 2),
            a=pair("a"),
            theta_t=number("aod_ze"),
            phi_t=number("aod_az"),
            theta_r=number("aoa_ze"),
            phi_r=number("aoa_az"),
            doppler_hz=number("doppler_hz"),
            **_read_geometry(table, row, number("order")),
        )


def rows_from_paths(
    links: "Links",
    paths: PathSet,
    weather: str,
    carrier_hz: float,
    actors: Sequence[str] | None = None,
    scenario: str = "",
    antennas: Sequence[str] | None = None,
) -> CarrierPaths:
    """Return paths in memory, of one weather and carrier, as the same arrays that rows of a dataset give.

    Args:
        links: Links of the paths.
        paths: Paths of `solve_paths`; `row` of the result counts these.
        weather: Weather of the gains.
        carrier_hz: Carrier of the gains [Hz].
        actors: Name of each actor, for `agent` and `peer`; None uses actor indices as text.
        scenario: Name of the scenario.
        antennas: Name of each antenna, for `antenna` and `peer_antenna`; None uses antenna indices as text.

    Raises:
        InputError: If weather or carrier are not there.
    """
    if weather not in paths.a:
        raise InputError(f"rows_from_paths: weather = {weather!r}; the paths have {', '.join(paths.a)}")
    column = np.flatnonzero(paths.carriers_hz == carrier_hz)
    if not len(column):
        known = ", ".join(f"{carrier:g}" for carrier in paths.carriers_hz)
        raise InputError(f"rows_from_paths: carrier_hz = {carrier_hz:g}; the paths have {known} Hz")
    keys = np.empty(len(links), dtype=KEY_TYPE)
    keys["scenario"], keys["weather"], keys["frame"] = scenario, weather, links.frame
    for name, actor in (("agent", links.rx_actor), ("peer", links.tx_actor)):
        keys[name] = [str(index) if actors is None else actors[index] for index in actor]
    for name, antenna in (("antenna", links.rx_antenna), ("peer_antenna", links.tx_antenna)):
        keys[name] = [str(index) if antennas is None else antennas[index] for index in antenna]
    samples = samples_from_paths(links, paths, weather, int(column[0]))
    return CarrierPaths(keys=keys, link=paths.link.astype(np.int64), **vars(samples))


def samples_from_paths(links: "Links", paths: PathSet, weather: str, column: int) -> PathSamples:
    """Return paths in memory, of one weather and carrier, without the names of their links.

    Args:
        links: Links of the paths.
        paths: Paths of `solve_paths`.
        weather: Weather of the gains.
        column: Row of the carrier in `paths.carriers_hz`.
    """
    return PathSamples(
        carrier_hz=float(paths.carriers_hz[column]),
        row=np.arange(len(paths)),
        is_los=paths.kind == PATH_LOS,
        tau=paths.tau,
        transfer=paths.transfer[weather][:, column],
        a=paths.a[weather][:, column],
        **{name: getattr(paths, name) for name in ("theta_t", "phi_t", "theta_r", "phi_r", "edge", "curvature")},
        **{name: getattr(paths, name)[:, : int(paths.order.max(initial=0))] for name in ("interaction", "vertex")},
        doppler_hz=paths.doppler_hz[:, column],
        first_segment_m=first_segments(links.tx.position[paths.link], paths.vertex, paths.tau),
    )


def first_segments(tx: np.ndarray, vertex: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return the length of each path to its first point, of a line of sight the whole [m], shape [P].

    Args:
        tx: Transmitter of each path [m], shape [P, 3].
        vertex: Points of the paths [m], NaN behind the last, shape [P, D, 3].
        tau: Delays [s], shape [P].
    """
    whole = SPEED_OF_LIGHT * tau
    return np.where(np.isnan(vertex[:, 0, 0]), whole, norm(vertex[:, 0] - tx)) if vertex.shape[1] else whole


def _read_geometry(table: Any, row: np.ndarray, order: np.ndarray) -> dict[str, np.ndarray]:
    """Return the arrays of `WAVEFRONT_COLUMNS` of rows of a table, as unknown where it has no column of them."""
    names = table.column_names if isinstance(table, pa.Table) else [str(column) for column in table]

    def padded(name: str, width: int) -> np.ndarray | None:
        if name not in names:
            return None
        values = read_column(table, "paths", name, ()).take(pa.array(row))
        if not pa.types.is_list(values.type) and not pa.types.is_large_list(values.type):
            raise InputError(f"table paths, column {name}: holds {values.type}; it needs lists of numbers")
        return padded_lists(values, width)

    def one(name: str, width: int) -> np.ndarray:
        values = padded(name, width)
        return np.full((len(row), width), np.nan) if values is None or not values.shape[1] else values[:, 0]

    kind, vertex = padded("interactions", 1), padded("vertices", 3)
    if kind is None or vertex is None:
        kind, vertex = np.where(order > 0, -1.0, 0.0)[:, None, None], np.full((len(row), 1, 3), np.nan)
    first = np.full(len(row), np.nan)
    if "first_segment_m" in names:
        first = read_numbers("first_segment_m", read_column(table, "paths", "first_segment_m", ()))[row]
    return {
        "interaction": np.nan_to_num(kind[..., 0], nan=0.0).astype(np.int8),
        "vertex": vertex,
        "first_segment_m": first,
        "edge": one("edge", 3),
        "curvature": one("curvature", 6),
    }


def padded_lists(values: pa.Array, width: int) -> np.ndarray:
    """Return the elements of a list column in groups of `width`, NaN behind the last, shape [rows, most, width].

    Raises:
        InputError: If the elements of a row are no whole groups.
    """
    ends = values.offsets.to_numpy().astype(np.int64)
    flat = values.values.to_numpy(zero_copy_only=False).astype(np.float64)[ends[0] : ends[-1]] if len(values) else []
    count, rest = np.divmod(np.diff(ends), width)
    if rest.any():
        raise InputError(f"table paths: a list of {np.diff(ends)[np.argmax(rest)]} numbers; they come in {width}")
    out = np.full((len(values), int(count.max(initial=0)), width), np.nan)
    out[np.arange(out.shape[1]) < count[:, None]] = np.reshape(flat, (-1, width))
    return out


def read_column(table: Any, kind: str, name: str, needed: tuple[str, ...]) -> pa.Array:
    """Return one column as an Arrow array; names are plain strings.

    Raises:
        InputError: If one of the needed columns is missing, or the column has nulls.
    """
    columns = table.column_names if isinstance(table, pa.Table) else [str(column) for column in table]
    missing = [column for column in needed if column not in columns]
    if missing:
        raise InputError(f"table {kind}: columns {missing} are missing; it needs {', '.join(needed)}; read them too")
    values = table[name]
    if not isinstance(values, pa.Array | pa.ChunkedArray):
        values = pa.array(values)
    if isinstance(values, pa.ChunkedArray):  # pandas gives them too
        values = values.combine_chunks()
    if pa.types.is_dictionary(values.type):
        values = values.cast(values.type.value_type)
    if values.null_count:
        row = int(np.argmax(values.is_null().to_numpy(zero_copy_only=False)))
        raise InputError(f"table {kind}, column {name}: row {row} is null; every row needs a value")
    return values


def read_numbers(name: str, values: pa.Array) -> np.ndarray:
    """Return a column as float64.

    Raises:
        InputError: If it holds something else than numbers.
    """
    if not len(values):
        return np.zeros(0)
    array = values.to_numpy(zero_copy_only=False)
    if array.dtype.kind not in "fiu":
        raise InputError(f"column {name}: holds {values.type}; it needs numbers")
    return array.astype(np.float64, copy=False)


def encode_key(name: str, parts: list[pa.Array]) -> tuple[np.ndarray, np.ndarray]:
    """Return a number for each value of a key column, shape [n], and the values by number."""
    type_ = pa.int64() if name == "frame" else pa.string()
    encoded = pc.dictionary_encode(pa.concat_arrays([part.cast(type_) for part in parts]))
    values = np.array(encoded.dictionary.to_pylist(), dtype=KEY_TYPE[name])
    return encoded.indices.to_numpy(zero_copy_only=False).astype(np.int64), values


def _one_carrier(present: np.ndarray, wanted: float | None) -> float:
    """Return the selected carrier [Hz]."""
    known = np.unique(present)
    listed = ", ".join(f"{carrier:g}" for carrier in known)
    if wanted is None:
        if len(known) != 1:
            raise InputError(
                f"table paths: carriers {listed or 'none'} Hz; CarrierPaths holds one; name it by carrier_hz"
            )
        return float(known[0])
    if len(known) and wanted not in known:
        raise InputError(f"carrier_hz = {wanted:g}: the tables hold {listed} Hz; name one of those")
    return float(wanted)
