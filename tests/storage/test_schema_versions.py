"""Datasets of another schema version, as `docs/reference/schema-versions.md` describes them."""

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import mmw
from mmw.storage.file_checks import verify
from mmw.storage.manifest import prepare_root
from mmw.storage.schema_checks import version_number
from mmw.storage.schemas import SCHEMA_VERSION
from mmw.storage.shard_writer import ShardKey
from tests.fixtures.edit_files import agree, edit_json
from tests.fixtures.shards import IDENTITY, META, write_made_up

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "schema-versions.md").read_text()
MAJOR, MINOR = version_number(SCHEMA_VERSION)
KEY = ShardKey("town", "sunny", 0, 2)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return write_made_up(tmp_path / "data", [KEY])


def make_other(root: Path, version: str, change: Callable[[pa.Table], pa.Table]) -> None:
    """Turn a dataset into one of another schema version, whose `poses` are changed."""
    for path in [root / "dataset.json", *(root / "_shards").glob("*.json")]:
        edit_json(path, lambda content: content.update(schema_version=version))
    for path in root.glob("*/**/part-*.parquet"):
        table = pq.ParquetFile(path).read()
        table = change(table) if path.is_relative_to(root / "poses") else table
        table = table.replace_schema_metadata({**table.schema.metadata, b"mmw.schema_version": version.encode()})
        pq.write_table(table, path)
    agree(root)


def assert_no_run(root: Path, version: str, own: str = SCHEMA_VERSION) -> None:
    """Check that a run of this mmw into the folder is refused, with both versions and what to do."""
    with pytest.raises(ValueError, match=f"has schema {re.escape(version)}.*writes {own}.*--overwrite"):
        prepare_root(root, IDENTITY, META["config_sha256"], {}, overwrite=False)


def test_the_page_names_the_version() -> None:
    assert f"This mmw writes schema {SCHEMA_VERSION}." in PAGE


def test_every_file_says_its_version(root: Path) -> None:
    assert mmw.open(root).info["schema_version"] == SCHEMA_VERSION
    for name in (root / "_shards").glob("*.json"):
        assert json.loads(name.read_text())["schema_version"] == SCHEMA_VERSION
    files = list(root.glob("*/**/part-*.parquet"))
    assert len(files) > 10
    assert {(pq.read_schema(file).metadata or {})[b"mmw.schema_version"].decode() for file in files} == {SCHEMA_VERSION}
    prepare_root(root, IDENTITY, META["config_sha256"], {}, overwrite=False)  # the same version resumes


def test_an_older_minor_version_is_read_and_checked(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The dataset is of this version; the mmw that reads it is of the next."""
    version, newer = SCHEMA_VERSION, f"{MAJOR}.{MINOR + 1}"
    make_other(root, version, lambda poses: poses.drop_columns(["vz"]))
    for name, module in list(sys.modules.items()):
        if name.startswith("mmw.") and hasattr(module, "SCHEMA_VERSION"):
            monkeypatch.setattr(module, "SCHEMA_VERSION", newer)
    data = mmw.open(root)
    poses = data.read("poses")
    assert poses.num_rows == 8 and "vz" not in poses.column_names
    with pytest.raises(ValueError, match="'poses': has no column vz; it has "):
        data.read("poses", columns=["vz"])
    assert verify(root) == []
    assert_no_run(root, version, newer)


def test_paths_of_an_older_minor_version_have_fewer_columns(root: Path) -> None:
    """Datasets of 3.0 have no losses in foliage: the view has its other columns, in Arrow and in SQL."""
    whole = mmw.open(root).read("paths")
    make_other(root, "3.0", lambda poses: poses)
    for path in root.glob("path_gains/**/part-*.parquet"):
        pq.write_table(pq.ParquetFile(path).read().drop_columns(["foliage_db"]), path)
    agree(root)
    data = mmw.open(root)
    rows = data.read("paths")
    assert rows.column_names == [name for name in whole.column_names if name != "foliage_db"]
    assert rows.equals(whole.drop_columns(["foliage_db"]))
    assert data.connect().sql("SELECT * FROM paths").columns == rows.column_names
    with pytest.raises(ValueError, match="no column foliage_db"):
        data.read("paths", columns=["tau_s", "foliage_db"])
    assert verify(root) == []


def test_arrays_of_an_older_minor_version(root: Path) -> None:
    """Datasets of 3.1 do not tell the waves behind rough surfaces; lines of sight and mirrors need nothing new."""
    lacking = ["first_segment_m", "edge", "curvature"]
    pytest.importorskip("duckdb")
    beams = mmw.connect(root).sql("SELECT * FROM beams ORDER BY ALL").fetchall()
    make_other(root, "3.1", lambda poses: poses)
    for path in root.glob("path_geometry/**/part-*.parquet"):
        pq.write_table(pq.ParquetFile(path).read().drop_columns(lacking), path)
    agree(root)
    data = mmw.open(root)
    assert np.isnan(data.paths(28e9).first_segment_m).all()
    assert data.connect().sql("SELECT * FROM beams ORDER BY ALL").fetchall() == beams
    with pytest.raises(ValueError, match="no column first_segment_m"):
        data.read("paths", columns=lacking)


def test_a_newer_minor_version_is_read(root: Path) -> None:
    version = f"{MAJOR}.{MINOR + 1}"
    make_other(root, version, lambda poses: poses.append_column("scent", pa.array([1.0] * poses.num_rows)))
    (root / "smells" / "scenario=town").mkdir(parents=True)
    pq.write_table(pa.table({"a": [1]}), root / "smells" / "scenario=town" / "part-000000.parquet")
    data = mmw.open(root)
    assert data.read("poses", columns=["scent"]).column("scent").to_pylist() == [1.0] * 8
    assert "smells" not in data.tables and "poses" in data.tables
    assert any("newer than" in finding.text and "update mmw" in finding.text for finding in verify(root))
    assert_no_run(root, version)


@pytest.mark.parametrize("major", [MAJOR - 1, MAJOR + 1])
def test_another_major_version_is_refused(root: Path, major: int) -> None:
    version = f"{major}.0"
    make_other(root, version, lambda poses: poses)
    with pytest.raises(ValueError, match=f"schema {version}; this mmw reads {SCHEMA_VERSION}; use the mmw that made"):
        mmw.open(root)
    assert any(finding.kind == "schema" and finding.is_error for finding in verify(root))
    assert_no_run(root, version)
