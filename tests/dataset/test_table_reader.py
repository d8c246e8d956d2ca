"""Tables in memory are read as those of a dataset."""

from pathlib import Path

import pyarrow as pa
import pytest

from mmw.core.errors import InputError
from mmw.dataset import Dataset, open_dataset
from mmw.dataset.table_reader import MemoryTables


@pytest.fixture(scope="module")
def pair(world: Path) -> tuple[Dataset, MemoryTables]:
    """Return a dataset, and some of its tables in memory."""
    dataset = open_dataset(world / "single")
    return dataset, MemoryTables("memory", {name: dataset.read(name) for name in ("poses", "lidar", "sensors")})


WHERE = [
    {},
    {"weather": "rainy"},
    {"scenario": "mine", "weather": "sunny", "frames": range(3, 5)},
    {"frames": range(0, 10, 4)},
    {"frames": range(9, -1, -3)},
    {"frames": range(0)},
    {"agent": "Ego"},
    {"agent": "Nobody"},
    {"columns": ["x", "agent"], "agent": "Mast"},
]


@pytest.mark.parametrize("where", WHERE, ids=str)
def test_a_filter_gives_the_rows_that_a_dataset_gives(pair: tuple[Dataset, MemoryTables], where: dict) -> None:
    dataset, memory = pair
    one, other = dataset.read("poses", **where), memory.read("poses", **where)
    assert one.column_names == other.column_names and one.to_pylist() == other.to_pylist()
    assert isinstance(other, pa.Table)


def test_a_sensor_is_a_filter_too(pair: tuple[Dataset, MemoryTables]) -> None:
    dataset, memory = pair
    where = {"sensor": "lidar", "frames": range(2)}
    assert dataset.read("lidar", **where).to_pylist() == memory.read("lidar", **where).to_pylist()
    assert memory.tables == ("poses", "lidar", "sensors")


@pytest.mark.parametrize(
    ("table", "where", "message"),
    [
        ("imu", {}, r"^memory: has no table 'imu'; it has poses, lidar, sensors; name one of these$"),
        ("sensors", {"weather": "sunny"}, r"^memory: table 'sensors': has no column weather; it has scenario, agent"),
        ("poses", {"columns": ["x", "w"]}, r"^memory: table 'poses': has no column w; it has .*; name these$"),
    ],
)
def test_what_is_not_there_is_an_error(
    pair: tuple[Dataset, MemoryTables], table: str, where: dict, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        pair[1].read(table, **where)
