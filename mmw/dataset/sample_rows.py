"""Turn rows of tables, or of columns before they are tables, into mappings, and columns of samples into points."""

import math
from collections.abc import Iterator, Mapping
from concurrent.futures import Future
from typing import Any

import numpy as np
import pyarrow as pa

from mmw.core.later import Later
from mmw.core.remember import remembered
from mmw.dataset.column_arrays import values_of
from mmw.storage.arrow_tables import cast_column
from mmw.storage.codecs.images import Stored, lossless_pixels
from mmw.storage.table_spec import IMAGE, TableSpec

Row = dict[str, Any]


def rows_of_table(table: pa.Table) -> list[Row]:
    """Return the rows of a table as mappings; lists of numbers are arrays."""
    columns = {name: values_of(table.column(name)) for name in table.column_names}
    return [{name: values[index] for name, values in columns.items()} for index in range(table.num_rows)]


class WaitingImage(Mapping[str, Any]):
    """Cell of an image that may still be encoded: `bytes`, which are waited for, and `path`."""

    def __init__(self, image: Future[bytes], path: str) -> None:
        """Take the future of the file and its path."""
        self.image, self._path = image, path

    def __getitem__(self, key: str) -> Any:
        if key == "bytes":
            return self.image.result()
        if key == "path":
            return self._path
        raise KeyError(key)

    def __iter__(self) -> Iterator[str]:
        return iter(("bytes", "path"))

    def __len__(self) -> int:
        return 2

    @property
    def stored(self) -> Stored:
        """The file, or the values of its pixels where it loses nothing and is not made yet."""
        if isinstance(self.image, Later) and not self.image.done():
            pixels = lossless_pixels(self.image.call, *self.image.args)
            if pixels is not None:
                return pixels
        return self["bytes"]


def stored_image(cell: Mapping[str, Any]) -> Stored:
    """Return what the decoders of images take of the cell of an image."""
    return cell.stored if isinstance(cell, WaitingImage) else cell["bytes"]


def row_of_columns(spec: TableSpec, columns: Mapping[str, Any], index: int) -> Row:
    """Return a row of columns as `rows_of_table` returns it of their table, without making the table.

    Args:
        spec: The table.
        columns: All its columns, see `mmw.storage.arrow_tables.unsorted_table`.
        index: The row.

    Raises:
        ValueError: If a value does not fit its column.
    """
    return {name: _cell(spec, field, kind, columns[name], index) for name, field, kind in _kinds(spec)}


@remembered()
def _kinds(spec: TableSpec) -> list[tuple[str, pa.Field, np.dtype | None]]:
    """Return name, field and NumPy type of the numbers of each column, of those in its lists; None for no numbers."""
    return [(field.name, field, _number_type(field.type)) for field in spec.columns]


def _number_type(type_: pa.DataType) -> np.dtype | None:
    element = type_.value_type if pa.types.is_list(type_) else type_
    is_number = pa.types.is_integer(element) or pa.types.is_floating(element) or pa.types.is_boolean(element)
    return np.dtype(element.to_pandas_dtype()) if is_number else None


def _cell(spec: TableSpec, field: pa.Field, number: np.dtype | None, values: Any, index: int) -> Any:
    if isinstance(values, str):
        return values
    if isinstance(values, np.ndarray):
        if number is not None and values.dtype == number and (number.kind != "f" or math.isfinite(values[index])):
            return values[index].item()
    elif isinstance(values, pa.Array):
        one = values[index]
        if field.nullable and not one.is_valid:
            return None
        if number is None and isinstance(values, pa.DictionaryArray) and one.is_valid:
            return one.as_py()
        if number is not None and isinstance(values, pa.ListArray) and one.is_valid:
            found = one.values.to_numpy(zero_copy_only=False)
            if found.dtype == number and (number.kind != "f" or np.isfinite(found).all()):
                return found
    elif isinstance(values, list) and isinstance(values[index], tuple) and field.type == IMAGE:
        image, path = values[index]
        return WaitingImage(image, path) if isinstance(image, Future) else {"bytes": image, "path": path}
    part = values if np.isscalar(values) else values[index : index + 1]
    return values_of(pa.chunked_array([cast_column(spec.name, field, part, 1)]))[0]


def points_of(columns: dict[str, np.ndarray]) -> np.ndarray | None:
    """Return points of x, y and z, which leave the columns, or of range, azimuth (to the left) and elevation."""
    if columns.keys() >= set("xyz"):
        return np.stack([columns.pop(axis) for axis in "xyz"], axis=1)
    if not columns.keys() >= {"range", "azimuth", "elevation"}:
        return None
    distance, azimuth, elevation = (columns[name] for name in ("range", "azimuth", "elevation"))
    across = distance * np.cos(elevation)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), distance * np.sin(elevation)], axis=1)
