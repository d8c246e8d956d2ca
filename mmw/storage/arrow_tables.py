"""Convert columns to checked and sorted Arrow tables, for all files of a dataset."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from mmw.storage.list_column import ListColumn
from mmw.storage.name_column import NameColumn
from mmw.storage.parquet_schema import arrow_schema
from mmw.storage.schemas import table_spec
from mmw.storage.table_spec import IMAGE, NAME, TableSpec


def table_from_columns(name: str, columns: Mapping[str, Any]) -> pa.Table:
    """Return a table of the given columns: cast to the schema, checked, and sorted by its key; see `unsorted_table`.

    Raises:
        ValueError: If a column does not fit, or two rows have the same key.
    """
    return sort_rows(table_spec(name), unsorted_table(name, columns))


def unsorted_table(name: str, columns: Mapping[str, Any]) -> pa.Table:
    """Return a table of the given columns, cast to the schema and checked, in the given order of rows.

    Args:
        name: Table name.
        columns: Every column of the table by name. A column is a NumPy array, an Arrow array, a `NameColumn`, a
            sequence, or one scalar (text, number or truth value) for all rows. A list column is a sequence of arrays,
            one per row, a `ListColumn` or an Arrow list array. An image column is a sequence of `(bytes, path)` pairs,
            None for no image.

    Raises:
        ValueError: If a column is missing or unknown, lengths differ, a value does not fit its type, a value that must
            be there is null, or a number is not finite.
    """
    spec = table_spec(name)
    names = [field.name for field in spec.columns]
    missing = [column for column in names if column not in columns]
    unknown = [column for column in columns if column not in names]
    if missing or unknown:
        raise ValueError(
            f"table {name!r}: missing columns {missing}, unknown columns {unknown}; give exactly {', '.join(names)}"
        )
    lengths = {column: len(values) for column, values in columns.items() if not _is_scalar(values)}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"table {name!r}: columns have lengths {lengths}; every column needs one value a row")
    rows = next(iter(lengths.values()), 1)
    arrays = [cast_column(name, field, columns[field.name], rows) for field in spec.columns]
    return pa.Table.from_arrays(arrays, schema=arrow_schema(name))


def check_columns(name: str, columns: Mapping[str, Any]) -> None:
    """Check the columns of a table, of which `scenario` and `weather` may be left out, as `unsorted_table` does.

    Raises:
        ValueError: As `unsorted_table`.
    """
    fixed = {field.name: "" for field in table_spec(name).columns if field.name in ("scenario", "weather")}
    unsorted_table(name, {**fixed, **columns})


def check_table(name: str, table: pa.Table) -> pa.Table:
    """Return an Arrow table after the checks of `table_from_columns`."""
    return table_from_columns(name, {column: table.column(column) for column in table.column_names})


def sort_rows(spec: TableSpec, table: pa.Table) -> pa.Table:
    """Return the rows sorted by the table's key, with the dictionaries of `normalize_names`.

    Raises:
        ValueError: If two rows have the same key.
    """
    if table.num_rows < 2:
        return normalize_names(table)
    keys = [_order_of(table.column(column)) for column in spec.key]
    if not _is_sorted(keys):
        order = np.lexsort(keys[::-1])
        table, keys = table.take(order), [values[order] for values in keys]
    table = normalize_names(table)
    same = np.logical_and.reduce([values[1:] == values[:-1] for values in keys])
    if same.any():
        row = table.select(spec.key).slice(int(np.argmax(same)), 1).to_pylist()[0]
        raise ValueError(
            f"table {spec.name!r}: {int(same.sum())} rows repeat a key, the first {row}; a key names one row"
        )
    return table


def _order_of(values: pa.ChunkedArray) -> np.ndarray:
    """Return numbers with the order of the values; of names, their ranks in the sorted dictionary."""
    if not (pa.types.is_dictionary(values.type) or pa.types.is_string(values.type)):
        return values.to_numpy()
    array = values.combine_chunks()
    if not isinstance(array, pa.DictionaryArray):
        array = array.dictionary_encode()
    rank = np.empty(len(array.dictionary), dtype=np.int32)
    rank[pc.array_sort_indices(array.dictionary).to_numpy()] = np.arange(len(rank))
    return rank[array.indices.to_numpy()]


def _is_sorted(keys: Sequence[np.ndarray]) -> bool:
    """Return whether rows are sorted by their keys, the first being the most significant."""
    is_equal = np.ones(len(keys[0]) - 1, dtype=bool)
    for values in keys:
        if (is_equal & (values[:-1] > values[1:])).any():
            return False
        is_equal &= values[:-1] == values[1:]
    return True


def normalize_names(table: pa.Table) -> pa.Table:
    """Return the table with dictionaries of its own names only, in order of first appearance."""
    columns = [
        _to_names(column.combine_chunks()) if pa.types.is_dictionary(column.type) else column
        for column in table.columns
    ]
    return pa.Table.from_arrays(columns, schema=table.schema)


def frame_rows(table: pa.Table) -> int:
    """Return the largest number of rows of one frame; 0 for an empty table."""
    if not table.num_rows:
        return 0
    return int(np.unique(table.column("frame").to_numpy(), return_counts=True)[1].max())


def _is_scalar(values: Any) -> bool:
    return isinstance(values, (str, bytes, bool, int, float, np.generic))


def cast_column(table: str, field: pa.Field, values: Any, rows: int) -> pa.Array:
    """Return a column of some rows, cast to its type and checked; see `unsorted_table`.

    Raises:
        ValueError: If a value does not fit, is null where it must be there, or is not finite.
    """
    where = f"table {table!r}, column {field.name!r}"
    try:
        array = _to_arrow(field.type, values, rows)
    except (pa.ArrowInvalid, pa.ArrowTypeError, pa.ArrowNotImplementedError, TypeError, OverflowError) as error:
        raise ValueError(f"{where}: {error}; the column holds {field.type}") from error
    if array.null_count and not field.nullable:
        row = int(np.argmax(array.is_null().to_numpy(zero_copy_only=False)))
        raise ValueError(f"{where}: row {row} is null; every row needs a value")
    leaf = array.flatten() if pa.types.is_list(array.type) else array
    if leaf.null_count and leaf is not array:
        raise ValueError(f"{where}: a list contains a null; every element needs a value")
    if pa.types.is_floating(leaf.type):
        finite = np.isfinite((leaf.drop_null() if leaf.null_count else leaf).to_numpy(zero_copy_only=False))
        if not finite.all():
            raise ValueError(f"{where}: {int((~finite).sum())} values are not finite; leave the row out or give null")
    return array


def _to_arrow(type_: pa.DataType, values: Any, rows: int) -> pa.Array:
    if _is_scalar(values):
        value = values.item() if isinstance(values, np.generic) else values
        if pa.types.is_dictionary(type_):
            return pa.DictionaryArray.from_arrays(np.zeros(rows, np.int32), pa.array([value][:rows], pa.string()))
        values = pa.repeat(value, rows)
    if isinstance(values, ListColumn | NameColumn):
        values = values.to_arrow()
    if isinstance(values, pa.ChunkedArray):
        values = values.combine_chunks()
    if isinstance(values, pa.ChunkedArray):  # without any chunk
        values = pa.array([], type_)
    if pa.types.is_dictionary(type_):
        return values if _are_names(values) else _to_names(values)
    if type_.equals(IMAGE):
        if isinstance(values, pa.Array):
            return values.cast(type_)
        return pa.array([None if pair is None else {"bytes": pair[0], "path": pair[1]} for pair in values], type_)
    if pa.types.is_list(type_) and not isinstance(values, pa.Array):
        return _to_lists(type_, values)
    if isinstance(values, np.ndarray) and values.dtype != object:
        values = pa.array(values)
    if isinstance(values, pa.Array):
        return values if values.type.equals(type_) else values.cast(type_)
    return pa.array(values, type=type_)


def _to_names(values: Any) -> pa.Array:
    """Return names with a dictionary in order of first appearance, so that equal rows give equal bytes."""
    if _are_names(values):
        return _in_order(values)
    if isinstance(values, pa.Array):
        return values.cast(pa.string()).dictionary_encode()
    if isinstance(values, np.ndarray):
        values = values.tolist()
    return pa.array(values, type=pa.string()).dictionary_encode()


def _are_names(values: Any) -> bool:
    """Return whether values are dictionary-encoded names without repeated entries."""
    if not (isinstance(values, pa.DictionaryArray) and values.type.equals(NAME)):
        return False
    texts = values.dictionary
    return not texts.null_count and (len(texts) == 1 or len(texts.unique()) == len(texts))


def _in_order(values: pa.DictionaryArray) -> pa.DictionaryArray:
    """Return names with a dictionary of the used ones, in order of first appearance, without repetition."""
    names = len(values.dictionary)
    if names == 1 and values.null_count == 0 and len(values):
        return values
    order = pc.unique(values.indices).drop_null().to_numpy()
    if np.array_equal(order, np.arange(names)):
        return values
    place = np.full(names + 1, -1, dtype=np.int32)
    place[order] = np.arange(len(order))
    code = (values.indices.fill_null(names) if values.null_count else values.indices).to_numpy()
    indices = pa.array(place[code], mask=code == names if values.null_count else None)
    return pa.DictionaryArray.from_arrays(indices, values.dictionary.take(pa.array(order)))


def _to_lists(type_: pa.DataType, values: Sequence[Any]) -> pa.Array:
    element = type_.value_type
    if pa.types.is_string(element):
        return pa.array([list(row) for row in values], type=type_)
    arrays = [np.asarray(row).reshape(-1) for row in values]
    offsets = np.zeros(len(arrays) + 1, dtype=np.int32)
    np.cumsum([len(row) for row in arrays], out=offsets[1:])
    filled = [row for row in arrays if len(row)]
    flat = np.concatenate(filled) if filled else np.zeros(0, dtype=element.to_pandas_dtype())
    return pa.ListArray.from_arrays(pa.array(offsets), pa.array(flat).cast(element), type=type_)
