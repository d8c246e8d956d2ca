"""Rows of a frame, or of several worlds taken apart: those of each in their order, with the number of its frame."""

from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
import pyarrow as pa
import pytest

from mmw.dataset.camera_geometry import poses_from_rows
from mmw.generation.live.row_parts import RowPart
from mmw.storage.list_column import ListColumn
from mmw.storage.name_column import name_column
from mmw.storage.schemas import table_spec


def _columns() -> dict[str, object]:
    lists = pa.array([[0.0], [1.0, 2.0], [], [3.0], [4.0, 5.0]])
    return {
        "frame": np.array([5, 3, 5, 3, 6], dtype=np.int32),
        "agent": pa.array(["b", "a", "a", "c", "a"]).dictionary_encode(),
        "peer": name_column(["b", "a", None, "c", "a"]),
        "sensor": "lidar",
        "image": [(b"0", "0"), (b"1", "1"), (b"2", "2"), (b"3", "3"), (b"4", "4")],
        "values": lists,
        "lists": ListColumn(lists.offsets.to_numpy(), lists.values.to_numpy()),
        "number": np.arange(5),
    }


@pytest.mark.parametrize("waits", [False, True])
def test_world_has_its_rows_in_their_order(waits: bool) -> None:
    columns, part = _columns(), Future[object]()
    part.set_result(columns)
    with ThreadPoolExecutor(1) as pool:
        rows = RowPart(table_spec("imu"), {}, part if waits else columns, range(3, 7), pool)
        for world, expected in ((3, [1, 3]), (4, []), (5, [0, 2]), (6, [4])):
            own = rows.source_of(world, 70 + world)
            own = own.result() if waits else own
            assert own["frame"].tolist() == [70 + world] * len(expected) and own["frame"].dtype == np.int32
            assert own["sensor"] == "lidar" and own["number"].tolist() == expected
            assert own["image"] == [columns["image"][index] for index in expected]
            for name in ("agent", "values"):
                assert own[name].to_pylist() == columns[name].take(pa.array(expected, pa.int64())).to_pylist()
            assert own["peer"].to_list() == [columns["peer"].to_list()[index] for index in expected]
            assert own["lists"].to_arrow().to_pylist() == own["values"].to_pylist()


def _poses(frame: list[int]) -> dict[str, object]:
    numbers = {field.name: np.arange(4) + 0.5 for field in table_spec("poses").columns}
    ids = np.arange(4, dtype=np.int32)
    own = {"agent": name_column(["b", "a", "a", "b"]), "role": name_column(["cav"] * 4), "object_id": ids}
    return {**numbers, **own, "scenario": "s", "weather": "w", "frame": np.array(frame, np.int32)}


def test_world_finds_its_rows_and_their_poses() -> None:
    part = RowPart(table_spec("poses"), {"scenario": "s", "weather": "w"}, _poses([1, 0, 1, 0]), range(2))
    assert [(row["agent"], row["frame"], row["x"]) for row in part.rows(1, 40)] == [("b", 40, 0.5), ("a", 40, 2.5)]
    agents = part.agents(1, 40)
    assert [(name, role) for name, role, *_ in agents] == [("a", "cav"), ("b", "cav")]  # by their names
    rows = [row() for *_, row in agents]
    assert rows == part.rows(1, 40)[::-1]
    for (_, _, pose, _), expected in zip(agents, poses_from_rows(rows), strict=True):
        np.testing.assert_array_equal(pose, expected)
    assert part.rows(2, 40) == part.agents(2, 40) == []


def test_frame_finds_its_rows_by_its_number_in_whatever_world() -> None:
    part = RowPart(table_spec("poses"), {"scenario": "s", "weather": "w"}, _poses([7] * 4))
    assert [row["agent"] for row in part.rows(3, 7)] == ["b", "a", "a", "b"] and part.source_of(3, 7) is part.source


def test_sensor_finds_the_first_of_its_rows() -> None:
    numbers = {field.name: np.arange(3) + 0.5 for field in table_spec("imu").columns}
    own = {
        "scenario": "s",
        "weather": "w",
        "agent": name_column(["b", "a", "b"]),
        "sensor": "imu",
        "handedness": "right",
    }
    columns = {**numbers, **own, "frame": np.array([0, 1, 0], np.int32)}
    part = RowPart(table_spec("imu"), {"scenario": "s", "weather": "w"}, columns, range(2))
    found = part.row(0, 9, "b", "imu")
    assert found is not None and (found["ax"], found["frame"], list(found)) == (0.5, 9, list(numbers))
    assert part.row(1, 9, "b", "imu") is None and part.row(0, 9, "b", "other") is None
