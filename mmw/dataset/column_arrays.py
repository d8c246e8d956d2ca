"""Convert the columns of tables to NumPy arrays."""

from typing import Any

import numpy as np
import pyarrow as pa


def arrays_of(table: pa.Table) -> dict[str, np.ndarray]:
    """Return one array a column, shape [rows]: names are text, nulls of number columns NaN.

    Lists and images are object arrays of arrays and mappings, None where they are null.
    """
    return {name: column_array(table.column(name)) for name in table.column_names}


def values_of(column: pa.ChunkedArray) -> list[Any]:
    """Return the values of a column; lists of numbers as arrays, nulls as None."""
    if pa.types.is_list(column.type) and not pa.types.is_string(column.type.value_type):
        return [row.values.to_numpy(zero_copy_only=False) if row.is_valid else None for row in column]
    return column.to_pylist()


def column_array(column: pa.ChunkedArray) -> np.ndarray:
    """Return a column as `arrays_of` does."""
    if pa.types.is_dictionary(column.type):
        column = column.cast(pa.string())
    if not pa.types.is_nested(column.type):
        return column.to_numpy()
    rows = np.empty(len(column), dtype=object)
    for index, value in enumerate(values_of(column)):
        rows[index] = value
    return rows
