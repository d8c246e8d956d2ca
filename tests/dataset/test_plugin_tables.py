"""Tables of a sensor package that is not installed: read as their files describe them, with a warning."""

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import mmw
from mmw.dataset.export.exporter import export
from tests.fixtures.edit_files import edit_json
from tests.fixtures.own_world import run_own, write_own_world
from tests.fixtures.plugin_sensor import NAME, thermometer
from tests.fixtures.scratch import scratch

WARNED = "table 'thermometer' is read as its files describe it; install the package of mmw-warmth "


@pytest.fixture(scope="module")
def root() -> Path:
    """Return a dataset of a sensor that is not registered any more, as if its distribution were mmw-warmth."""
    folder = write_own_world(scratch("plugin"))
    changes = (
        f"sensors=[{{type: {NAME}}}, {{type: imu}}]",
        "channel.enabled=false",
        "frames.count=2",
        "--workers",
        "1",
    )
    with thermometer():
        assert run_own(folder, "d", *changes) == 0
    sensors: dict[str, str] = {}
    edit_json(folder / "d" / "dataset.json", lambda head: sensors.update(head["versions"]["sensors"]))
    assert sensors == {NAME: "register()"}
    edit_json(folder / "d" / "dataset.json", lambda head: head["versions"].update(sensors={NAME: "mmw-warmth"}))
    return folder / "d"


def test_the_table_is_read(root: Path) -> None:
    data = mmw.open(root)
    assert data.tables[-1] == NAME and "imu" in data.tables
    with pytest.warns(UserWarning, match=WARNED):
        rows = data.read(NAME, weather="sunny", frames=range(1, 2))
    assert rows["celsius"].to_pylist() == [20.0] * len(rows) and len(rows)
    spec = data.spec(NAME)
    (column,) = (field for field in spec.columns if field.name == "celsius")
    assert column.metadata == {b"unit": b"degC", b"doc": b"temperature"} and spec.key == ("frame", "agent", "sensor")
    (agent,) = (one for one in data.frame("mine", "sunny", 0).agents.values() if one.role == "cav")
    assert agent.sensor(NAME).celsius == 20.0


def test_sql_and_exports_have_it(root: Path, tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match=WARNED), mmw.connect(root) as connection:
        assert connection.sql(f"SELECT DISTINCT celsius FROM {NAME}").fetchall() == [(20.0,)]
        assert connection.sql(f"SELECT celsius FROM {NAME}_at('mine', 'sunny', 1)").fetchall() == [(20.0,)]
    export(root, "huggingface", tmp_path / "out")
    assert pq.read_table(tmp_path / "out" / NAME)["celsius"].to_pylist() == [20.0] * 2
    assert "| celsius | degC | temperature |" in (tmp_path / "out" / "README.md").read_text()


def test_other_folders_are_no_tables(root: Path, tmp_path: Path) -> None:
    for name, meta in (("smells", {}), ("a; DROP", {"mmw.table": "a; DROP"}), ("liar", {"mmw.table": "imu"})):
        (tmp_path / name / "scenario=mine").mkdir(parents=True)
        rows = pa.table({"a": [1]}).replace_schema_metadata(meta)
        pq.write_table(rows, tmp_path / name / "scenario=mine" / "part-000000.parquet")
    for path in root.iterdir():
        (tmp_path / path.name).symlink_to(path)
    assert mmw.open(tmp_path).tables == mmw.open(root).tables


@pytest.mark.parametrize("columns", ["{", "[]", '{"a": 3}', '{"a": {"unit": 3}}'])
def test_a_table_that_is_damaged_is_left_out_aloud(root: Path, tmp_path: Path, columns: str) -> None:
    for path in root.iterdir():
        if path.name != NAME:
            (tmp_path / path.name).symlink_to(path)
    for path in sorted((root / NAME).rglob("*.parquet")):
        rows = pq.ParquetFile(path).read()
        copy = tmp_path / path.relative_to(root)
        copy.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(rows.replace_schema_metadata(rows.schema.metadata | {b"mmw.columns": columns.encode()}), copy)
    with pytest.warns(UserWarning, match=f"part-000000.parquet: cannot be read .*; table '{NAME}' is left out"):
        assert NAME not in mmw.open(tmp_path).tables
