"""Rows of columns are those of the table that the columns make."""

from concurrent.futures import Future

import numpy as np
import pyarrow as pa
import pytest

from mmw.dataset.column_arrays import arrays_of
from mmw.dataset.sample_rows import ColumnRows, WaitingImage, rows_of_table, sorted_arrays
from mmw.storage.arrow_tables import table_from_columns, unsorted_table
from mmw.storage.list_column import ListColumn
from mmw.storage.schemas import table_spec

NAMES = pa.array(["cav_2", "cav_1"]).dictionary_encode()


def columns_of(table: str, **own: object) -> dict[str, object]:
    """Return columns of two rows, with numbers of other types than those of the table."""
    columns: dict[str, object] = {}
    for field in table_spec(table).columns:
        if pa.types.is_floating(field.type):
            columns[field.name] = np.array([0.1, -2.5])
        elif pa.types.is_integer(field.type):
            columns[field.name] = np.array([3, 5])
        elif pa.types.is_list(field.type):
            dtype = np.dtype(field.type.value_type.to_pandas_dtype())
            columns[field.name] = pa.nulls(2) if field.nullable else [np.array([1, 2], dtype), np.zeros(0, dtype)]
    return {**columns, "scenario": "s", "weather": "sunny", "agent": NAMES, **own}


@pytest.mark.parametrize(
    ("table", "own"),
    [
        ("poses", {"role": ["cav", "rsu"]}),
        ("imu", {"sensor": "imu", "handedness": "right"}),
        ("lidar", {"sensor": "lidar", "x": pa.array([[1.5], []], pa.list_(pa.float32()))}),
        ("lidar", {"sensor": "lidar", "x": ListColumn(np.array([0, 2, 3], np.int32), np.arange(3, dtype=np.float32))}),
        ("lidar", {"sensor": "lidar", "x": ListColumn(np.array([0, 2, 3], np.int32), np.arange(3))}),
        ("rgb", {"sensor": "front", "format": "png", "image": [(b"a", "a.png"), None]}),
        ("box_visibility", {"sensor": "x", "is_los": [True, None], "blocker_id": pa.array([4, None])}),
    ],
)
def test_rows_of_columns_are_those_of_their_table(table: str, own: dict[str, object]) -> None:
    columns = columns_of(table, **own)
    wanted = rows_of_table(unsorted_table(table, columns))
    for found, row in zip(list(ColumnRows(table_spec(table), columns)), wanted, strict=True):
        assert list(found) == list(row)
        assert repr(found) == repr(row)
        assert [getattr(value, "dtype", None) for value in found.values()] == [
            getattr(value, "dtype", None) for value in row.values()
        ]


def test_number_that_is_not_finite_is_refused_as_in_a_table() -> None:
    columns = columns_of("poses", role="cav", x=np.array([0.0, np.nan]))
    with pytest.raises(ValueError, match="column 'x': 1 values are not finite"):
        ColumnRows(table_spec("poses"), columns)


def test_list_of_a_row_cannot_be_written_to_as_a_table_may_follow() -> None:
    x = ListColumn(np.array([0, 1, 1], np.int32), np.ones(1, np.float32))
    row = ColumnRows(table_spec("lidar"), columns_of("lidar", sensor="lidar", x=x))[0]
    with pytest.raises(ValueError, match="read-only"):
        row["x"][0] = 2.0


@pytest.mark.parametrize("object_id", [[5, 3], [3, 3]])
def test_sorted_arrays_are_those_of_the_table(object_id: list[int]) -> None:
    category, agent = (pa.array(texts).dictionary_encode() for texts in (["Car", "Bus"], [None, "cav_1"]))
    own = {"frame": np.array([4, 4], np.int32), "object_id": np.array(object_id, np.int32)}
    columns = columns_of("boxes", category=category, agent=agent, **own)
    found = sorted_arrays(table_spec("boxes"), columns)
    if object_id[0] == object_id[1]:  # the table refuses it
        assert found is None
        return
    assert found is not None
    wanted = arrays_of(table_from_columns("boxes", columns))
    assert list(found) == list(wanted)
    for name, values in wanted.items():
        assert found[name].dtype == values.dtype
        np.testing.assert_array_equal(found[name], values)


def test_image_is_waited_for_when_its_bytes_are_asked_for() -> None:
    image: Future[bytes] = Future()
    columns = columns_of("rgb", sensor="front", format="png", image=[(image, "a.png"), (b"b", "b.png")])
    cell = ColumnRows(table_spec("rgb"), columns)[0]["image"]
    assert isinstance(cell, WaitingImage) and cell["path"] == "a.png"
    image.set_result(b"a")
    assert dict(cell) == {"bytes": b"a", "path": "a.png"} and "size" not in cell
