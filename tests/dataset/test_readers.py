"""Readers that know nothing of mmw open a table's folder: pandas, pyarrow, polars, DuckDB, Hugging Face datasets."""

from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from mmw.storage.shard_writer import ShardKey
from tests.fixtures.shards import make_shard, write_made_up

KEYS = [ShardKey("town_a", weather, begin, begin + 4) for weather in ("rainy", "sunny") for begin in (0, 4)]
ROWS = 2 * 8 * 4


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_made_up(tmp_path_factory.mktemp("readers") / "d", KEYS)


@pytest.fixture(scope="module")
def expected() -> np.ndarray:
    """x of the first points of each sweep of cav_1 in the rain."""
    sweeps = [sweep for key in KEYS[:2] for sweep in make_shard(key)["lidar"]["x"][0::4]]
    return np.array([sweep[0] for sweep in sweeps if len(sweep)])


def test_pandas(root: Path, expected: np.ndarray) -> None:
    rows = pd.read_parquet(root / "lidar")
    assert len(rows) == ROWS and set(rows["weather"]) == {"rainy", "sunny"}
    own = rows[(rows["weather"] == "rainy") & (rows["agent"] == "cav_1")].sort_values("frame")
    np.testing.assert_array_equal([x[0] for x in own["x"] if len(x)], expected)


def test_pyarrow(root: Path, expected: np.ndarray) -> None:
    rows = pq.read_table(root / "lidar")
    assert rows.num_rows == ROWS
    own = [row for row in rows.to_pylist() if row["weather"] == "rainy" and row["agent"] == "cav_1"]
    np.testing.assert_array_equal([row["x"][0] for row in own if row["x"]], expected)


def test_polars(root: Path, expected: np.ndarray) -> None:
    polars = pytest.importorskip("polars", reason="polars is not installed: pip install 'multimodal-wireless[test]'")
    rows = polars.scan_parquet(root / "lidar").filter(weather="rainy", agent="cav_1").sort("frame").collect()
    assert polars.scan_parquet(root / "lidar").select(polars.len()).collect().item() == ROWS
    np.testing.assert_array_equal([x[0] for x in rows["x"].to_list() if x], expected)


def test_duckdb(root: Path, expected: np.ndarray) -> None:
    files = f"read_parquet('{root}/lidar/**/*.parquet', hive_partitioning = true)"
    query = f"SELECT x[1] AS x FROM {files} WHERE weather = 'rainy' AND agent = 'cav_1' AND len(x) > 0 ORDER BY frame"
    np.testing.assert_array_equal(duckdb.sql(query).fetchnumpy()["x"], expected)
    assert duckdb.sql(f"SELECT count(*) FROM {files}").fetchall()[0] == (ROWS,)


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
