"""Turn rows of tables, or of columns before they are tables, into mappings."""

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa

from mmw.core.later import Later, Waiting
from mmw.core.remember import remembered
from mmw.dataset.column_arrays import column_array, values_of
from mmw.storage.arrow_tables import cast_column
from mmw.storage.codecs.images import Stored, lossless_pixels
from mmw.storage.list_column import ListColumn
from mmw.storage.name_column import NameColumn
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
    found = {
        name: row for own, matrix in _floats(spec, columns) for name, row in zip(own, matrix[:, order], strict=True)
    }
    return {
        field.name: found[field.name] if field.name in found else _array(spec, field, number, columns, order)
        for field, number in _kinds(spec)
    }


def _array(
    spec: TableSpec, field: pa.Field, number: np.dtype | None, columns: Mapping[str, Any], order: np.ndarray
) -> np.ndarray:
    values = columns[field.name]
    if isinstance(values, np.ndarray) and number is not None and values.dtype == number and number.kind != "f":
        return values[order]
    if number is None and isinstance(values, str):
        return np.full(len(order), values, dtype=object)
    if number is None and isinstance(values, NameColumn) and (field.nullable or not values.has_null):
        return values[order].to_array()
    return column_array(pa.chunked_array([cast_column(spec.name, field, values, len(order))]))[order]


def _floats(spec: TableSpec, columns: Mapping[str, Any]) -> Iterator[tuple[list[str], np.ndarray]]:
    """Return names and values [K, rows] of the columns of each type of floating point, cast and checked at once.

    Those of a type of which a value is not finite are left out.
    """
    for number, names in _float_names(spec):
        own = [name for name in names if isinstance(columns[name], np.ndarray) and columns[name].dtype.kind == "f"]
        if own:
            matrix = np.array([columns[name] for name in own], dtype=number)
            if np.isfinite(matrix).all():
                yield own, matrix


@remembered()
def _float_names(spec: TableSpec) -> list[tuple[np.dtype, list[str]]]:
    """Return the columns of each type of floating point."""
    found: dict[np.dtype, list[str]] = {}
    for field in spec.columns:
        if pa.types.is_floating(field.type):
            found.setdefault(np.dtype(field.type.to_pandas_dtype()), []).append(field.name)
    return list(found.items())


class WaitingImage(Mapping[str, Any]):
    """Cell of an image that may still be encoded: `bytes`, which are waited for, and `path`."""

    def __init__(self, image: Waiting, path: str) -> None:
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


class ColumnRows:
    """Rows of columns, which become mappings as `rows_of_table` returns those of their table, without the table."""

    def __init__(self, spec: TableSpec, columns: Mapping[str, Any]) -> None:
        """Make the cells of all rows.

        Args:
            spec: The table.
            columns: All its columns, see `mmw.storage.arrow_tables.unsorted_table`.

        Raises:
            ValueError: If a value does not fit its column.
        """
        count = len(columns["frame"])
        found = {
            name: row for own, matrix in _floats(spec, columns) for name, row in zip(own, matrix.tolist(), strict=True)
        }
        cells = [
            found[field.name] if field.name in found else _cells(spec, field, number, columns[field.name], count)
            for field, number in _kinds(spec)
        ]
        self._names = _column_names(spec)
        self._rows = list(zip(*cells, strict=True))

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, index: int) -> Row:
        """Return a row, a new mapping each time."""
        return dict(zip(self._names, self._rows[index], strict=True))

    def column(self, name: str) -> list[Any]:
        """Return the cells of a column."""
        place = self._names.index(name)
        return [row[place] for row in self._rows]

    @cached_property
    def by_sensor(self) -> dict[tuple[int, str, str], int]:
        """Index of the first row of each frame, agent and sensor."""
        keys = list(zip(*map(self.column, ("frame", "agent", "sensor")), strict=True))
        return dict(zip(reversed(keys), range(len(keys) - 1, -1, -1), strict=True))

    @cached_property
    def by_frame(self) -> dict[int, list[int]]:
        """Indices of the rows of each frame."""
        found: dict[int, list[int]] = {}
        for index, frame in enumerate(self.column("frame")):
            found.setdefault(frame, []).append(index)
        return found


@remembered()
def _column_names(spec: TableSpec) -> tuple[str, ...]:
    return tuple(field.name for field in spec.columns)


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
        if number is not None and values.dtype == number and number.kind != "f":
            return values.tolist()
    elif isinstance(values, ListColumn):
        held = values.values
        if number is not None and held.dtype == number and (number.kind != "f" or np.isfinite(held).all()):
            return values.rows()
    elif isinstance(values, NameColumn):
        if number is None and (field.nullable or not values.has_null):
            return values.to_list()
    elif isinstance(values, pa.Array):
        if field.nullable and values.null_count == count:
            return [None] * count
    elif isinstance(values, list) and field.type == IMAGE and all(isinstance(cell, tuple) for cell in values):
        return [_image(*cell) for cell in values]
    return values_of(pa.chunked_array([cast_column(spec.name, field, values, count)]))


def _image(image: Any, path: str) -> Mapping[str, Any]:
    return WaitingImage(image, path) if isinstance(image, Waiting) else {"bytes": image, "path": path}
