"""Turn rows of tables, or of columns before they are tables, into mappings, and columns of samples into points."""

import math
from collections.abc import Iterator, Mapping
from concurrent.futures import Future
from typing import Any

import numpy as np
import pyarrow as pa

from mmw.core.later import Later
from mmw.core.remember import remembered
from mmw.dataset.column_arrays import column_array, values_of
from mmw.storage.arrow_tables import cast_column
from mmw.storage.codecs.images import Stored, lossless_pixels
from mmw.storage.list_column import ListColumn
from mmw.storage.table_spec import IMAGE, TableSpec

Row = dict[str, Any]


def rows_of_table(table: pa.Table) -> list[Row]:
    """Return the rows of a table as mappings; lists of numbers are arrays."""
    columns = {name: values_of(table.column(name)) for name in table.column_names}
    return [{name: values[index] for name, values in columns.items()} for index in range(table.num_rows)]


def sorted_arrays(spec: TableSpec, columns: Mapping[str, Any]) -> dict[str, np.ndarray] | None:
    """Return the columns as `arrays_of` returns those of their table, without making the table.

    Args:
        spec: The table.
        columns: All its columns, see `mmw.storage.arrow_tables.unsorted_table`.

    Returns:
        Arrays in the order of the key; None where only the table tells it: rows repeat a key, or differ in a text of
        it.

    Raises:
        ValueError: If a value does not fit its column.
    """
    keys = [columns[name] for name in spec.key if not isinstance(columns[name], str)]
    if not keys or not all(isinstance(key, np.ndarray) for key in keys):
        return None
    order = np.lexsort(keys[::-1])
    if np.logical_and.reduce([key[order[1:]] == key[order[:-1]] for key in keys]).any():
        return None
    return {field.name: _array(spec, field, number, columns[field.name], order) for field, number in _kinds(spec)}


def _array(spec: TableSpec, field: pa.Field, number: np.dtype | None, values: Any, order: np.ndarray) -> np.ndarray:
    if isinstance(values, np.ndarray) and number is not None and values.dtype == number:
        if number.kind != "f" or np.isfinite(values).all():
            return values[order]
    elif number is None and isinstance(values, str | pa.DictionaryArray):
        return np.array(_cells(spec, field, number, values, len(order)), dtype=object)[order]
    return column_array(pa.chunked_array([cast_column(spec.name, field, values, len(order))]))[order]


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


def rows_of_columns(spec: TableSpec, columns: Mapping[str, Any]) -> list[Row]:
    """Return the rows of columns as `rows_of_table` returns those of their table, without making the table.

    Args:
        spec: The table.
        columns: All its columns, see `mmw.storage.arrow_tables.unsorted_table`.

    Raises:
        ValueError: If a value does not fit its column.
    """
    kinds, count = _kinds(spec), len(columns["frame"])
    cells = [_cells(spec, field, number, columns[field.name], count) for field, number in kinds]
    names = [field.name for field, _ in kinds]
    return [dict(zip(names, row, strict=True)) for row in zip(*cells, strict=True)]


@remembered()
def _kinds(spec: TableSpec) -> list[tuple[pa.Field, np.dtype | None]]:
    """Return field and NumPy type of the numbers of each column, of those in its lists; None for no numbers."""
    return [(field, _number_type(field.type)) for field in spec.columns]


def _number_type(type_: pa.DataType) -> np.dtype | None:
    element = type_.value_type if pa.types.is_list(type_) else type_
    is_number = pa.types.is_integer(element) or pa.types.is_floating(element) or pa.types.is_boolean(element)
    return np.dtype(element.to_pandas_dtype()) if is_number else None


def _cells(spec: TableSpec, field: pa.Field, number: np.dtype | None, values: Any, count: int) -> list[Any]:
    if isinstance(values, str):
        return [values] * count
    if isinstance(values, np.ndarray):
        if number is not None and values.dtype == number:
            found = values.tolist()
            if number.kind != "f" or all(map(math.isfinite, found)):
                return found
    elif isinstance(values, ListColumn):
        held = values.values
        if number is not None and held.dtype == number and (number.kind != "f" or np.isfinite(held).all()):
            return values.rows()
    elif isinstance(values, pa.Array):
        if field.nullable and values.null_count == count:
            return [None] * count
        if number is None and isinstance(values, pa.DictionaryArray) and (field.nullable or not values.null_count):
            return values.to_pylist()
    elif isinstance(values, list) and field.type == IMAGE and all(isinstance(cell, tuple) for cell in values):
        return [_image(*cell) for cell in values]
    return values_of(pa.chunked_array([cast_column(spec.name, field, values, count)]))


def _image(image: Any, path: str) -> Mapping[str, Any]:
    return WaitingImage(image, path) if isinstance(image, Future) else {"bytes": image, "path": path}


def points_of(columns: dict[str, np.ndarray]) -> np.ndarray | None:
    """Return points of x, y and z, which leave the columns, or of range, azimuth (to the left) and elevation."""
    if columns.keys() >= set("xyz"):
        return np.stack([columns.pop(axis) for axis in "xyz"], axis=1)
    if not columns.keys() >= {"range", "azimuth", "elevation"}:
        return None
    distance, azimuth, elevation = (columns[name] for name in ("range", "azimuth", "elevation"))
    across = distance * np.cos(elevation)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), distance * np.sin(elevation)], axis=1)
