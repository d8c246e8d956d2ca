"""Readers that know nothing of mmw open a table's folder: pandas, pyarrow, polars, DuckDB, Hugging Face datasets."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
import pandas as pd
import polars
import pyarrow as pa
import pyarrow.dataset as ds
import pyarrow.parquet as pq
import pytest

import mmw
from mmw.dataset.export.exporter import export
from mmw.storage.schemas import TABLES
from mmw.storage.shard_writer import ShardKey, marker_path, table_path
from tests.fixtures.shards import keys_of, make_shard, write_made_up

KEYS = keys_of("town_a")
ROWS = 2 * 8 * 4


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a dataset with every table."""
    return write_made_up(tmp_path_factory.mktemp("readers") / "d", KEYS)


@pytest.fixture(scope="module")
def littered(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy with what killed writers leave: unfinished files, a lock, a marker that was not published."""
    copy = shutil.copytree(root, tmp_path_factory.mktemp("littered") / "d")
    for file in sorted(copy.glob("*/**/part-000000.parquet")):
        file.with_name(f".{file.name}.0of1-0123456789ab-w1-0123456789ab.tmp").write_bytes(file.read_bytes()[:1000])
    (copy / "_locks").mkdir(exist_ok=True)
    (copy / "_locks" / "part-0-of-1.lock").write_text("process 1 on here")
    (copy / "_shards" / ".town_a.sunny.000099.json.0of1-0123456789ab.tmp").write_text("{")
    return copy


def by_mmw(root: Path, table: str) -> pa.Table:
    return mmw.open(root).read(table)


def by_connect(root: Path, table: str) -> pa.Table:
    with mmw.connect(root) as connection:
        return connection.sql(f"SELECT * FROM {table}").to_arrow_table()


def by_pandas(root: Path, table: str) -> pa.Table:
    frame = pd.read_parquet(root / table, dtype_backend="pyarrow")
    return pa.Table.from_pandas(frame, preserve_index=False)


def by_duckdb(root: Path, table: str) -> pa.Table:
    return duckdb.sql(
        f"SELECT * FROM read_parquet('{root / table}/**/*.parquet', hive_partitioning=1)"
    ).to_arrow_table()


def by_polars(root: Path, table: str) -> pa.Table:
    return polars.read_parquet(root / table / "**/*.parquet").to_arrow()


def by_pyarrow(root: Path, table: str) -> pa.Table:
    return pq.read_table(root / table)


def by_dataset(root: Path, table: str) -> pa.Table:
    return ds.dataset(root / table, partitioning=ds.HivePartitioning.discover(infer_dictionary=True)).to_table()


def by_files(root: Path, table: str) -> pa.Table:
    return ds.dataset(root / table).to_table()


READERS = (by_mmw, by_connect, by_pandas, by_duckdb, by_polars, by_pyarrow, by_dataset, by_files)


def rows_of(table: pa.Table) -> list[str]:
    """Return the rows as text, sorted: columns by name, lists of arrays as lists, NaN as null."""

    def plain(value: Any) -> Any:
        if isinstance(value, list | np.ndarray):
            return [plain(item) for item in value]
        return None if isinstance(value, float) and np.isnan(value) else value

    return sorted(repr([(name, plain(row[name])) for name in sorted(row)]) for row in table.to_pylist())


@pytest.mark.parametrize("table", TABLES)
def test_readers_agree_on_every_table(root: Path, littered: Path, table: str) -> None:
    expected = rows_of(by_mmw(root, table))
    assert expected
    for reader in READERS:
        assert rows_of(reader(littered, table)) == expected, reader.__name__


def test_arrow_cannot_read_one_type_in_both_ways(root: Path, tmp_path: Path) -> None:
    """Document why names are dictionaries: with strings in the files pandas fails, and `pyarrow.dataset` does not.

    If Arrow unifies the two some day, this fails, and `docs/guides/query.md` can be shorter.
    """
    with pytest.raises(pa.ArrowTypeError, match="Field scenario has incompatible types"):
        ds.dataset(root / "links", partitioning="hive")
    for file in (root / "links").rglob("*.parquet"):
        rows = pq.ParquetFile(file).read()
        names = [field.with_type(pa.string()) if pa.types.is_dictionary(field.type) else field for field in rows.schema]
        (tmp_path / file.relative_to(root)).parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(rows.cast(pa.schema(names)), tmp_path / file.relative_to(root))
    assert ds.dataset(tmp_path / "links", partitioning="hive").count_rows() > 0
    with pytest.raises(pa.ArrowTypeError, match="Field scenario has incompatible types"):
        pd.read_parquet(tmp_path / "links")


def copied_part(root: Path) -> None:
    file = root / table_path("lidar", KEYS[0])
    shutil.copy(file, file.with_name("part-000099.parquet"))


def longer_number(root: Path) -> None:
    file = root / table_path("lidar", KEYS[0])
    shutil.copy(file, file.with_name("part-0000000.parquet"))


def copied_scenario(root: Path) -> None:
    for table in ("lidar", "frames", "poses", "sensors", "objects"):
        shutil.copytree(root / table / "scenario=town_a", root / table / "scenario=town_b")


def copied_weather(root: Path) -> None:
    shutil.copytree(root / "lidar/scenario=town_a/weather=rainy", root / "lidar/scenario=town_a/weather=foggy")


@pytest.mark.parametrize("copy", [copied_part, longer_number, copied_scenario, copied_weather])
def test_copies_add_no_rows(root: Path, tmp_path: Path, copy: Callable[[Path], None]) -> None:
    place = shutil.copytree(root, tmp_path / "d")
    copy(place)
    for table in ("lidar", "frames", "sensors"):
        expected = rows_of(by_mmw(root, table))
        assert rows_of(by_mmw(place, table)) == expected and rows_of(by_connect(place, table)) == expected
    assert len(by_pandas(place, "lidar")) > ROWS  # it takes every file, as `docs/guides/query.md` says
    with mmw.connect(place) as connection:
        for scenario, weather in (("town_b", "rainy"), ("town_a", "foggy")):
            with pytest.raises(duckdb.IOException, match="No files found"):
                connection.sql(f"SELECT * FROM lidar_at('{scenario}', '{weather}', 0)").fetchall()
    export(place, "huggingface", tmp_path / "out")
    rows = [pq.read_metadata(file).num_rows for file in (tmp_path / "out" / "lidar").glob("*.parquet")]
    assert sum(rows) == ROWS


def test_a_shard_counts_from_its_marker_on(root: Path, tmp_path: Path) -> None:
    place = shutil.copytree(root, tmp_path / "d")
    marker = (place / marker_path(KEYS[1])).rename(tmp_path / "marker.json")
    left = mmw.open(place).read("lidar")
    assert len(left) == ROWS - 4 * 4 == len(by_connect(place, "lidar"))
    assert not mmw.open(place).read("lidar", weather="rainy", frames=range(4, 8)).num_rows
    marker.rename(place / marker_path(KEYS[1]))
    assert len(mmw.open(place).read("lidar")) == ROWS


def test_one_frame_is_read_from_published_files_alone(tmp_path: Path) -> None:
    keys = [ShardKey("town_a", "sunny", begin, begin + 2) for begin in (0, 2, 4, 6)]
    place = write_made_up(tmp_path / "d", keys)
    (place / marker_path(keys[2])).unlink()
    with mmw.connect(place) as connection:
        found = [
            connection.sql(f"SELECT * FROM frames_at('town_a', 'sunny', {frame})").fetchall() for frame in range(8)
        ]
    assert [len(rows) for rows in found] == [1, 1, 1, 1, 0, 0, 1, 1]


def test_a_folder_without_markers_says_so(root: Path, tmp_path: Path) -> None:
    place = shutil.copytree(root, tmp_path / "d", ignore=shutil.ignore_patterns("_shards"))
    assert mmw.open(place).tables == ()
    for work in (lambda: mmw.open(place).read("lidar"), lambda: mmw.connect(place)):
        with pytest.raises(ValueError, match="holds no table: _shards marks no shard as complete; run"):
            work()


@pytest.fixture
def offline(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    return pytest.importorskip("datasets", reason="datasets is not installed: pip install 'multimodal-wireless[test]'")


def test_hugging_face_streams(root: Path, offline: Any) -> None:
    sweeps = [sweep for key in KEYS[:2] for sweep in make_shard(key)["lidar"]["x"][0::4]]
    expected = np.array([sweep[0] for sweep in sweeps if len(sweep)])
    rows = list(offline.load_dataset(str(root), "lidar", split="train", streaming=True))
    assert len(rows) == ROWS
    own = [row for row in rows if row["weather"] == "rainy" and row["agent"] == "cav_1"]
    np.testing.assert_array_equal(np.float32([row["x"][0] for row in own if row["x"]]), expected)
    (image,) = offline.load_dataset(str(root), "depth", split="train", streaming=True).take(1)
    assert image["image"].size == (8, 6)
