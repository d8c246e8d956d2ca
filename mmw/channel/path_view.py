"""Join the tables `path_gains` and `path_geometry` to the view `paths`: in Arrow, and as SQL."""

from collections.abc import Container, Iterable, Sequence

import numpy as np
import pyarrow as pa

from mmw.channel.tables import PATH_GAINS, PATH_GEOMETRY, PATHS
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.storage.parquet_schema import arrow_schema
from mmw.storage.table_spec import F64

PATH_KEY = PATH_GEOMETRY.full_key
"""Columns that name a path, in both tables: names and whole numbers."""
GAIN_COLUMNS = frozenset(field.name for field in PATH_GAINS.columns)
"""Columns of `paths` that `path_gains` has; the others come from `path_geometry`."""
DOPPLER = "doppler_hz"
"""The one column of `paths` that no table has."""
OF_DOPPLER = ("carrier_hz", "range_rate")
"""Columns from which it follows."""


def split_columns(columns: Iterable[str]) -> tuple[list[str], list[str]]:
    """Return the columns of `path_gains` and of `path_geometry` that some columns of `paths` need.

    The second list is empty where the first table is enough.
    """
    wanted = [name for column in columns for name in (OF_DOPPLER if column == DOPPLER else (column,))]
    gains = [name for name in wanted if name in GAIN_COLUMNS]
    geometry = [name for name in wanted if name not in GAIN_COLUMNS]
    if not geometry:
        return list(dict.fromkeys(gains)), []
    return list(dict.fromkeys([*PATH_KEY, *gains])), list(dict.fromkeys([*PATH_KEY, *geometry]))


def join_paths(gains: pa.Table, geometry: pa.Table | None, columns: Sequence[str] | None = None) -> pa.Table:
    """Return rows of the view `paths`, one for each row of `path_gains`, in the order of these.

    Args:
        gains: Rows of `path_gains`, with the columns of `split_columns`.
        geometry: Rows of `path_geometry`; more than those of the gains do no harm. None if no column needs them.
        columns: Columns of the view; None for all that the tables have, of an older schema fewer.

    Raises:
        InputError: If a row of `path_gains` has none in `path_geometry`.
    """
    schema = arrow_schema(PATHS)
    known = {field.name: field.type for field in schema}
    if geometry is None:
        return gains.select(list(columns or gains.column_names))
    names = list(columns or held_columns({*gains.column_names, *geometry.column_names}))
    place = pa.array(_places(gains, geometry))
    held = set(names) - GAIN_COLUMNS - {DOPPLER} | ({OF_DOPPLER[1]} if DOPPLER in names else set())
    taken = {name: _one_chunk(geometry.column(name)).take(place).cast(known.get(name, F64)) for name in held}
    if DOPPLER in names:
        taken[DOPPLER] = pa.array(_doppler(taken.pop(OF_DOPPLER[1]), gains.column(OF_DOPPLER[0])))
    found = [taken[name] if name in taken else gains.column(name) for name in names]
    fields = [(schema if name in taken else gains.schema).field(name) for name in names]
    return pa.Table.from_arrays(found, schema=pa.schema(fields, schema.metadata))


def held_columns(of_tables: Container[str]) -> list[str]:
    """Return the columns of the view that follow from those of its tables, in their order."""
    return [field.name for field in PATHS.columns if field.name == DOPPLER or field.name in of_tables]


def _doppler(range_rate: pa.Array, carrier_hz: pa.ChunkedArray) -> np.ndarray:
    """Return the Doppler shifts of rows [Hz], in the order of operations of `PathSet.doppler_hz`."""
    return -range_rate.to_numpy(zero_copy_only=False) * carrier_hz.to_numpy() / SPEED_OF_LIGHT


def _one_chunk(column: pa.ChunkedArray) -> pa.Array:
    """Return a column as one array; names with one dictionary."""
    if pa.types.is_dictionary(column.type):
        column = column.unify_dictionaries()
    return column.combine_chunks()


def _places(gains: pa.Table, geometry: pa.Table) -> np.ndarray:
    """Return the row of `geometry` that each row of `gains` belongs to, shape [rows], int64."""
    codes = _row_codes(gains, geometry)
    one, other = codes[: gains.num_rows], codes[gains.num_rows :]
    order = None if (np.diff(other) > 0).all() else np.argsort(other, kind="stable")
    other = other if order is None else other[order]
    place = np.minimum(np.searchsorted(other, one), max(len(other) - 1, 0))
    lost = other[place] != one if len(other) else np.ones(len(one), dtype=bool)
    if lost.any():
        first = gains.select(PATH_KEY).slice(int(np.argmax(lost)), 1).to_pylist()[0]
        raise InputError(
            f"table paths: {int(lost.sum())} rows of path_gains have no row in path_geometry, the first {first}; a "
            "file of path_geometry is missing or another run's; `mmw verify` names it"
        )
    return place if order is None else order[place]


def _row_codes(gains: pa.Table, geometry: pa.Table) -> np.ndarray:
    """Return a number for each row of both tables, the same for the same path, shape [rows of both], int64."""
    codes, size = np.zeros(gains.num_rows + geometry.num_rows, dtype=np.int64), 1
    for name in PATH_KEY:
        values = _numbers(gains.column(name), geometry.column(name))
        values = values - values.min(initial=0)
        count = int(values.max(initial=0)) + 1
        if size * count >= 2**62:
            codes = np.unique(codes, return_inverse=True)[1]
            size = int(codes.max(initial=0)) + 1
        codes, size = codes * count + values, size * count
    return codes


def _numbers(one: pa.ChunkedArray, other: pa.ChunkedArray) -> np.ndarray:
    """Return the values of two columns, of names a number for each, shape [rows of both], int64."""
    if pa.types.is_integer(one.type):
        return np.concatenate([column.to_numpy() for column in (one, other)]).astype(np.int64)
    if one.type != other.type or not pa.types.is_dictionary(one.type):
        one, other = (column.cast(pa.string()).dictionary_encode() for column in (one, other))
    whole = pa.chunked_array([*one.chunks, *other.chunks], one.type).unify_dictionaries()
    parts = [chunk.indices.fill_null(-1).to_numpy() for chunk in whole.chunks]
    return np.concatenate([np.zeros(0, dtype=np.int64), *parts]).astype(np.int64)


def join_sql(gains: str, geometry: str, columns: Sequence[str]) -> str:
    """Return SQL that joins two relations as `join_paths` does.

    Args:
        gains: SQL of the rows of `path_gains`.
        geometry: SQL of the rows of `path_geometry`.
        columns: Columns of the view, `held_columns`.
    """
    doppler = f"-s.range_rate * g.carrier_hz / {SPEED_OF_LIGHT}::DOUBLE AS {DOPPLER}"
    chosen = ", ".join(
        doppler if name == DOPPLER else f'{"g" if name in GAIN_COLUMNS else "s"}."{name}"' for name in columns
    )
    return f"SELECT {chosen} FROM {gains} g JOIN {geometry} s USING ({', '.join(PATH_KEY)})"
