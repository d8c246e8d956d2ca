"""Rows of several worlds taken apart: those of each in their order, with the number of its own frame."""

from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
import pyarrow as pa
import pytest

from mmw.generation.live.world_rows import WorldRows
from mmw.storage.list_column import ListColumn


def _columns() -> dict[str, object]:
    lists = pa.array([[0.0], [1.0, 2.0], [], [3.0], [4.0, 5.0]])
    return {
        "frame": np.array([5, 3, 5, 3, 6], dtype=np.int32),
        "agent": pa.array(["b", "a", "a", "c", "a"]).dictionary_encode(),
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
    rows = WorldRows(part if waits else columns, range(3, 7))
    with ThreadPoolExecutor(1) as pool:
        for world, expected in ((3, [1, 3]), (4, []), (5, [0, 2]), (6, [4])):
            own = rows.part_of(world, 70 + world, pool)
            own = own.result() if waits else own
            assert own["frame"].tolist() == [70 + world] * len(expected) and own["frame"].dtype == np.int32
            assert own["sensor"] == "lidar" and own["number"].tolist() == expected
            assert own["image"] == [columns["image"][index] for index in expected]
            for name in ("agent", "values"):
                assert own[name].to_pylist() == columns[name].take(pa.array(expected, pa.int64())).to_pylist()
            assert own["lists"].to_arrow().to_pylist() == own["values"].to_pylist()
