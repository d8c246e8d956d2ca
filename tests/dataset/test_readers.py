"""Readers that know nothing of mmw open a table's folder: pandas, pyarrow, polars, DuckDB, Hugging Face datasets."""

from collections.abc import Callable
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from tests.fixtures.shards import keys_of, make_shard, write_made_up

KEYS = keys_of("town_a")
ROWS = 2 * 8 * 4


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_made_up(tmp_path_factory.mktemp("readers") / "d", KEYS)


@pytest.fixture(scope="module")
def expected() -> np.ndarray:
    """x of the first points of each sweep of cav_1 in the rain."""
    sweeps = [sweep for key in KEYS[:2] for sweep in make_shard(key)["lidar"]["x"][0::4]]
    return np.array([sweep[0] for sweep in sweeps if len(sweep)])


def read_pandas(folder: Path) -> tuple[int, list]:
    rows = pd.read_parquet(folder)
    own = rows[(rows["weather"] == "rainy") & (rows["agent"] == "cav_1")].sort_values("frame")
    return len(rows), [x[0] for x in own["x"] if len(x)]


def read_pyarrow(folder: Path) -> tuple[int, list]:
    rows = pq.read_table(folder).to_pylist()
    own = [row for row in rows if row["weather"] == "rainy" and row["agent"] == "cav_1"]
    return len(rows), [row["x"][0] for row in own if row["x"]]


def read_polars(folder: Path) -> tuple[int, list]:
    polars = pytest.importorskip("polars", reason="polars is not installed: pip install 'multimodal-wireless[test]'")
    own = polars.scan_parquet(folder).filter(weather="rainy", agent="cav_1").sort("frame").collect()
    count = polars.scan_parquet(folder).select(polars.len()).collect().item()
    return count, [x[0] for x in own["x"].to_list() if x]


def read_duckdb(folder: Path) -> tuple[int, np.ndarray]:
    files = f"read_parquet('{folder}/**/*.parquet', hive_partitioning = true)"
    query = f"SELECT x[1] AS x FROM {files} WHERE weather = 'rainy' AND agent = 'cav_1' AND len(x) > 0 ORDER BY frame"
    return duckdb.sql(f"SELECT count(*) FROM {files}").fetchall()[0][0], duckdb.sql(query).fetchnumpy()["x"]


@pytest.mark.parametrize("read", [read_pandas, read_pyarrow, read_polars, read_duckdb])
def test_a_reader_finds_every_row(root: Path, expected: np.ndarray, read: Callable[[Path], tuple]) -> None:
    count, first_points = read(root / "lidar")
    assert count == ROWS
    np.testing.assert_array_equal(first_points, expected)


def test_hugging_face_streams(root: Path, expected: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    datasets = pytest.importorskip(
        "datasets", reason="datasets is not installed: pip install 'multimodal-wireless[test]'"
    )
    rows = list(datasets.load_dataset(str(root), "lidar", split="train", streaming=True))
    assert len(rows) == ROWS
    own = [row for row in rows if row["weather"] == "rainy" and row["agent"] == "cav_1"]
    np.testing.assert_array_equal(np.float32([row["x"][0] for row in own if row["x"]]), expected)
    (image,) = datasets.load_dataset(str(root), "depth", split="train", streaming=True).take(1)
    assert image["image"].size == (8, 6)
