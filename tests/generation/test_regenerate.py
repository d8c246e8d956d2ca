"""`mmw regenerate`: any row of a dataset is made alone, and equals the stored one bit for bit."""

import io
import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image

from mmw.__main__ import main as mmw
from mmw.dataset import open_dataset
from mmw.generation.regenerate import RowRegenerator, differing_columns, select_rows
from mmw.storage.schemas import TABLES
from tests.fixtures.small_dataset import SCENARIO, copy_of, one_scene, part, replace_column, rewrite, small_dataset

__all__ = ["one_scene"]


@pytest.fixture(scope="module")
def root() -> Path:
    return small_dataset()


@pytest.fixture(scope="module")
def regenerator(root: Path):
    with RowRegenerator(root, "cpu") as regenerator:
        yield regenerator


@pytest.mark.parametrize(
    ("table", "key", "rows"),
    [
        ("frames", {"frame": 1}, 1),
        ("poses", {"frame": 1, "agent": "rsu_1"}, 1),
        ("boxes", {"frame": 3}, 20),
        ("lidar", {"frame": 3, "agent": "cav_2", "sensor": "lidar"}, 1),
        ("imu", {"frame": 2}, 3),
        ("gnss", {"frame": 2, "agent": "cav_3"}, 1),
        ("gnss", {"frame": 3}, 0),
        ("depth", {"frame": 2}, 1),
        ("segmentation", {"frame": 0, "agent": "rsu_1"}, 1),
        ("rgb", {"frame": 2, "agent": "cav_1", "sensor": "front"}, 1),
        ("rgb", {"frame": 1}, 0),
        ("box_visibility", {"frame": 1, "agent": "cav_1", "sensor": "antenna"}, 19),
        ("links", {"frame": 1, "agent": "cav_1"}, 2),
        ("path_gains", {"frame": 1, "carrier": 0, "path": 0}, 3),
        ("path_geometry", {"frame": 1, "path": 0}, 3),
        ("boxes_2d", {"frame": 0, "agent": "rsu_1", "sensor": "depth"}, None),
    ],
)
@pytest.mark.parametrize("weather", ["sunny", "rainy"])
def test_rows_made_alone_equal_the_stored_ones(root, regenerator, table, key, rows, weather) -> None:
    of_weather = {"weather": weather} if TABLES[table].by_weather else {}
    made = regenerator.rows(table, SCENARIO, **of_weather, **key)
    stored = open_dataset(root).read(table, scenario=SCENARIO, frames=range(key["frame"], 4), **of_weather)
    stored = select_rows(stored.select(made.column_names), key)
    assert made.num_rows == (stored.num_rows if rows is None else rows)
    assert differing_columns(made, stored) == []


@pytest.mark.parametrize("table", ["objects", "sensors", "materials"])
def test_static_tables_are_made_too(root, regenerator, table) -> None:
    made = regenerator.rows(table, SCENARIO)
    assert differing_columns(made, open_dataset(root).read(table, columns=made.column_names)) == []
    assert made.num_rows > 10


def test_one_agent_traces_its_own_sensors_alone(regenerator) -> None:
    batch = regenerator._restricted("rgb", regenerator.config.scenarios[0], "cav_1", None)
    assert [sensor.name for sensor in batch.config.sensors] == ["front"] and batch.arrays.sensing == {"cav_1"}
    assert batch.surfaces is None


def test_differences_are_seen_to_the_last_bit() -> None:
    table = pa.table({"a": [0.0, 1.0], "b": pa.array(["x", "y"]).dictionary_encode(), "c": [[1.0], [2.0, 3.0]]})
    assert differing_columns(table, table.set_column(1, "b", pa.array(["x", "y"]))) == []
    assert differing_columns(table, table.set_column(0, "a", pa.array([-0.0, 1.0]))) == ["a"]
    assert differing_columns(table, table.set_column(0, "a", pa.array([0.0, np.nextafter(1.0, 2.0)]))) == ["a"]
    assert differing_columns(table, table.set_column(2, "c", pa.array([[1.0, 2.0], [3.0]]))) == ["c"]
    assert differing_columns(table, table.slice(1)) == ["a", "b", "c"]


def test_the_command_prints_writes_and_compares(root, tmp_path, capsys) -> None:
    base = ["regenerate", "depth", str(root), "weather=sunny", "frame=2", "--device", "cpu"]
    assert mmw(base) == 0
    told = capsys.readouterr().out
    assert f"scenario: {SCENARIO}" in told and "agent: rsu_1" in told and told.endswith("1 rows of depth\n")
    assert mmw([*base, "--out", str(tmp_path / "new" / "d.png")]) == 0
    assert np.asarray(Image.open(tmp_path / "new" / "d.png")).shape == (120, 160)
    assert mmw([*base, "--out", str(tmp_path / "d.parquet")]) == 0
    (row,) = pq.read_table(tmp_path / "d.parquet").to_pylist()
    assert Image.open(io.BytesIO(row["image"]["bytes"])).size == (160, 120)
    assert mmw([*base, "--out", str(tmp_path / "d.jsonl")]) == 0
    assert json.loads((tmp_path / "d.jsonl").read_text())["frame"] == 2
    capsys.readouterr()
    assert mmw([*base, "--compare"]) == 0
    assert capsys.readouterr().out == "1 rows are equal\n"


def test_the_command_tells_a_difference(root, tmp_path, capsys) -> None:
    other = copy_of(root, tmp_path / "d")
    rewrite(other, part("imu"), lambda rows: replace_column(rows, "ax", lambda found: [x + 1.0 for x in found]))
    assert mmw(["regenerate", "imu", str(other), "weather=sunny", "frame=1", "--compare", "--device", "cpu"]) == 1
    assert capsys.readouterr().out == "3 rows differ in ax\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["lidarr", "ROOT"], "'lidarr' is not known"),
        (["lidar", "ROOT", "frame=1"], "weather is missing: the dataset has sunny, rainy"),
        (["lidar", "ROOT", "weather=foggy", "frame=1"], "weather = foggy: the dataset has sunny, rainy"),
        (["lidar", "ROOT", "weather=sunny", "frame=9"], "frame = 9: town03_roundabout has 0 to 3"),
        (["lidar", "ROOT", "weather=sunny"], "frame = None"),
        (["lidar", "ROOT", "weather=sunny", "frame=one"], "frame holds int32"),
        (["lidar", "ROOT", "weather=sunny", "speed=1"], "the key of table lidar is"),
        (["lidar", "ROOT", "weather=sunny", "frame=1", "agent=cav_9"], "agent = cav_9"),
        (["lidar", "ROOT", "weather=sunny", "frame=1", "sensor=front"], "sensor = front: table lidar has lidar"),
        (["radar", "ROOT", "weather=sunny", "frame=1"], "makes no row of it"),
        (["imu", "ROOT", "weather=sunny", "frame=1", "--out", "a.png"], "the rows hold 0 images"),
        (["imu", "ROOT", "weather=sunny", "frame=1", "--out", "a.txt"], "must end in"),
        (["paths", "ROOT", "weather=sunny", "frame=1"], "view of path_gains and path_geometry"),
        (["path_geometry", "ROOT", "weather=sunny", "frame=1"], "the key of table path_geometry is scenario, frame"),
        (["lidar", "ROOT", "scenario=x", "weather=sunny", "frame=1"], "scenario = x"),
        (["lidar", "EMPTY", "frame=1"], "no dataset.json"),
    ],
)
def test_bad_input_is_one_line(root, tmp_path, arguments, words, capsys) -> None:
    places = {"ROOT": str(root), "EMPTY": str(tmp_path)}
    assert mmw(["regenerate", *[places.get(word, word) for word in arguments], "--device", "cpu"]) == 2
    told = capsys.readouterr().err
    assert words in told and told.count("\n") == 1, told
