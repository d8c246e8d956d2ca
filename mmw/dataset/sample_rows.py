"""Turn rows of tables into mappings, and columns of samples into points."""

from typing import Any

import numpy as np
import pyarrow as pa

from mmw.dataset.column_arrays import values_of

Row = dict[str, Any]


def rows_of_table(table: pa.Table) -> list[Row]:
    """Return the rows of a table as mappings; lists of numbers are arrays."""
    columns = {name: values_of(table.column(name)) for name in table.column_names}
    return [{name: values[index] for name, values in columns.items()} for index in range(table.num_rows)]


def points_of(columns: dict[str, np.ndarray]) -> np.ndarray | None:
    """Return points of x, y and z, which leave the columns, or of range, azimuth (to the left) and elevation."""
    if columns.keys() >= set("xyz"):
        return np.stack([columns.pop(axis) for axis in "xyz"], axis=1)
    if not columns.keys() >= {"range", "azimuth", "elevation"}:
        return None
    distance, azimuth, elevation = (columns[name] for name in ("range", "azimuth", "elevation"))
    across = distance * np.cos(elevation)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), distance * np.sin(elevation)], axis=1)
