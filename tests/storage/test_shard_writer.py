"""Publishing, resuming, refusing, surviving kills and full disks."""

import errno
import json
import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from mmw.storage import atomic_files as publish
from mmw.storage.arrow_tables import sort_rows, table_from_columns
from mmw.storage.atomic_files import OutOfSpaceError
from mmw.storage.file_checks import verify
from mmw.storage.manifest import finalize, pending_scenarios, pending_shards, prepare_root
from mmw.storage.parquet_schema import arrow_schema
from mmw.storage.schemas import TABLES, table_spec
from mmw.storage.shard_writer import ShardKey, marker_path, table_path, write_scenario, write_shard
from tests.fixtures.edit_files import edit_bytes, edit_json
from tests.fixtures.shards import IDENTITY, META, make_shard, make_statics, of_shard

FILES = 6 * sum(table.of_weather for table in TABLES.values()) + 3 * 1 + 3
"""Parquet files of the six shards below, each with every framed table but the one that is the same in both weathers,
which three have, and of the scenario's three static tables."""
KEYS = [ShardKey("town_a", weather, begin, begin + 5) for weather in ("rainy", "sunny") for begin in (0, 5, 10)]


def prepare(root: Path, overwrite: bool = False, sha256: str = META["config_sha256"], **changes) -> None:
    prepare_root(root, IDENTITY | changes, sha256, {"mmw": "0.1.0"}, overwrite)


def write_all(root: Path) -> None:
    """Make what is still missing, as a run does."""
    prepare(root)
    for name in pending_scenarios(root, ["town_a"]):
        write_scenario(root, name, make_statics(), META)
    for key in pending_shards(root, KEYS):
        write_shard(root, key, rows_of(key), META)


def rows_of(key: ShardKey) -> dict:
    """Return the rows of a shard; `rainy` is the first weather."""
    return of_shard(make_shard(key), key, "rainy")


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("undisturbed") / "data"
    write_all(path)
    return path


@pytest.fixture
def root(undisturbed: Path, tmp_path: Path) -> Path:
    return shutil.copytree(undisturbed, tmp_path / "data")


def parquet_bytes(root: Path) -> dict[str, bytes]:
    files = sorted(root.rglob("part-*.parquet"))
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in files}


def test_layout_and_marker(root):
    key = KEYS[4]
    assert table_path("lidar", key) == Path("lidar/scenario=town_a/weather=sunny/part-000005.parquet")
    assert table_path("objects", "town_a") == Path("objects/scenario=town_a/part-000000.parquet")
    marker = json.loads((root / "_shards" / "town_a.sunny.000005.json").read_text())
    assert marker["scenario"] == "town_a" and (marker["frame_begin"], marker["frame_end"]) == (5, 10)
    assert {file["table"] for file in marker["files"]} == set(make_shard(key)) - {"path_geometry"}
    assert table_path("path_geometry", key) == Path("path_geometry/scenario=town_a/part-000005.parquet")
    first = json.loads((root / "_shards" / "town_a.rainy.000005.json").read_text())
    assert {file["table"] for file in first["files"]} == set(make_shard(key))
    for file in marker["files"]:
        metadata = pq.read_metadata(root / file["path"])
        assert metadata.num_rows == file["rows"]
        assert metadata.metadata[b"mmw.config_sha256"].decode() == META["config_sha256"]
    assert not list(root.rglob(".*.tmp"))


def test_lidar_row_group_is_one_frame(root):
    metadata = pq.read_metadata(root / table_path("lidar", KEYS[0]))
    assert metadata.num_row_groups == 5 and metadata.row_group(0).num_rows == 4
    statistics = metadata.row_group(2).column(metadata.schema.names.index("frame")).statistics
    assert statistics.min == statistics.max == 2


def test_threads_write_the_same_as_one(root, tmp_path):
    prepare(tmp_path / "threads")
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda key: write_shard(tmp_path / "threads", key, rows_of(key), META), KEYS))
    framed = {path: data for path, data in parquet_bytes(root).items() if TABLES[path.partition("/")[0]].framed}
    assert parquet_bytes(tmp_path / "threads") == framed
    assert pending_shards(tmp_path / "threads", KEYS) == []


@pytest.mark.parametrize("name", make_shard(KEYS[0]))
def test_batches_of_any_size_give_the_same_bytes(root, tmp_path, name):
    """A shard put together from tables of one frame each, in any order, is the shard made at once."""
    key = KEYS[0]
    weather = {"weather": key.weather} if TABLES[name].by_weather else {}
    columns = {"scenario": key.scenario, **weather, **make_shard(key)[name]}
    whole = table_from_columns(name, columns)
    frame = np.asarray(whole.column("frame"))
    parts = [whole.filter(pa.array(frame == number)) for number in (3, 1, 0, 2, 4)]
    joined = pa.concat_tables(parts).unify_dictionaries().combine_chunks()
    table = sort_rows(table_spec(name), joined)
    assert table.schema.equals(arrow_schema(name), check_metadata=True)
    marker = write_shard(tmp_path, key, {name: table}, META)
    path = marker["files"][0]["path"]
    assert (tmp_path / path).read_bytes() == (root / path).read_bytes()


def test_a_shard_takes_only_its_own_rows(root):
    tables = make_shard(KEYS[1])
    with pytest.raises(ValueError, match="frames 5 to 9; shard town_a/rainy/0-4"):
        write_shard(root, KEYS[0], {"frames": tables["frames"]}, META)
    other = table_from_columns("frames", {"scenario": "town_b", "weather": "rainy", **make_shard(KEYS[0])["frames"]})
    with pytest.raises(ValueError, match="town_b"):
        write_shard(root, KEYS[0], {"frames": other}, META)
    with pytest.raises(ValueError, match="static"):
        write_shard(root, KEYS[0], {"objects": make_statics()["objects"]}, META)
    with pytest.raises(ValueError, match="config_sha256"):
        write_shard(root, KEYS[0], {"frames": make_shard(KEYS[0])["frames"]}, {"device": "cpu"})
    assert verify(root) == []


@pytest.mark.parametrize(
    "damage",
    [
        lambda marker, file: marker.unlink(),
        lambda marker, file: edit_bytes(marker, lambda data: data[:100]),
        lambda marker, file: file.unlink(),
        lambda marker, file: edit_bytes(file, lambda data: data[:-9]),
        lambda marker, file: edit_json(marker, lambda content: content.update(config_sha256="d" * 64)),
        lambda marker, file: edit_json(marker, lambda content: content.update(frame_end=4)),
    ],
)
def test_damaged_shard_is_pending_and_repaired(root, damage):
    key, before = KEYS[3], parquet_bytes(root)
    damage(root / marker_path(key), root / table_path("poses", key))
    assert pending_shards(root, KEYS) == [key]
    write_all(root)
    assert verify(root) == [] and parquet_bytes(root) == before


def test_verify_finds_everything(root):
    finalize(root)
    assert verify(root) == []
    files = [root / table_path(name, KEYS[0]) for name in ("poses", "imu", "path_gains", "links", "frames")]
    files[0].unlink()
    edit_bytes(files[1], lambda data: data[:-1])
    edit_bytes(files[2], lambda data: data[:999] + bytes([data[999] ^ 1]) + data[1000:])
    (root / "poses/scenario=town_a/weather=sunny/part-000099.parquet").write_bytes(files[4].read_bytes())
    (root / "poses/.part-000005.parquet.tmp").write_bytes(b"")
    edit_json(
        root / marker_path(KEYS[0]), lambda marker: [f.update(rows=0) for f in marker["files"] if f["table"] == "links"]
    )
    (root / "_shards/torn.json").write_text("{")
    findings = verify(root)
    kinds = {finding.kind: finding.path for finding in findings}
    assert set(kinds) == {"missing", "size", "sha256", "rows", "marker", "manifest", "orphan", "temporary"}
    assert kinds["missing"].startswith("poses/") and kinds["sha256"].startswith("path_gains/")
    assert {finding.kind for finding in findings if not finding.is_error} == {"temporary"}


def test_a_file_of_all_weathers_is_the_first_weathers(root):
    """It is repaired with the first weather's shard, and a second marker that lists it is wrong."""
    path = root / table_path("path_geometry", KEYS[0])
    path.unlink()
    assert pending_shards(root, KEYS) == [KEYS[0]]
    assert [finding.path for finding in verify(root)] == [path.relative_to(root).as_posix()]
    write_all(root)
    write_shard(root, KEYS[3], make_shard(KEYS[3]), META)  # sunny, with the same frames
    assert [(finding.kind, finding.text) for finding in verify(root)] == [("marker", "two markers list the file")]


def test_finalize_lists_and_counts(root):
    summary = finalize(root)
    manifest = pq.read_table(root / "_manifest.parquet").to_pylist()
    assert len(manifest) == summary["files"] == FILES
    assert {row["path"] for row in manifest} == set(parquet_bytes(root))
    assert summary["tables"]["poses"]["rows"] == 6 * 5 * 4
    assert summary["bytes"] == sum(len(data) for data in parquet_bytes(root).values())
    assert sum(row["rows"] for row in manifest) == summary["rows"]
    card = (root / "README.md").read_text()
    assert card.startswith("---\nconfigs:\n- config_name: frames\n  data_files: frames/**/*.parquet\n")
    sunny = next(row for row in manifest if row["path"].startswith("lidar/") and row["weather"] == "sunny")
    assert (sunny["frame_begin"], sunny["frame_end"], sunny["config_sha256"]) == (0, 5, META["config_sha256"])


def test_same_configuration_is_taken_up(root):
    before = (root / "dataset.json").read_bytes()
    prepare(root)
    assert (root / "dataset.json").read_bytes() == before and pending_shards(root, KEYS) == []


def test_another_configuration_is_refused(root):
    with pytest.raises(ValueError) as error:
        prepare(root, sha256="d" * 64, seed=7, frames={"start": 0, "count": 30})
    text = str(error.value)
    for words in ("cccccccccccc", "dddddddddddd", "seed: 42 -> 7", "frames.count: 20 -> 30", "--overwrite", "--out"):
        assert words in text
    assert "weathers" not in text and pending_shards(root, KEYS) == []


def test_overwrite_removes_the_data_and_nothing_else(root):
    (root / "notes.txt").write_text("mine")
    finalize(root)
    prepare(root, overwrite=True, sha256="d" * 64, seed=7)
    assert sorted(path.name for path in root.iterdir()) == ["dataset.json", "notes.txt"]
    assert json.loads((root / "dataset.json").read_text())["config"]["seed"] == 7


@pytest.mark.parametrize("overwrite", [False, True])
def test_foreign_folder_is_refused(tmp_path, overwrite):
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(ValueError, match=r"thesis\.tex.*empty or new folder"):
        prepare(tmp_path, overwrite=overwrite)
    with pytest.raises(ValueError, match="is a file"):
        prepare(tmp_path / "thesis.tex", overwrite=overwrite)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
def test_full_disk_is_one_clear_error(root, monkeypatch, code):
    """The disk fills in the middle of a shard: no temporary file stays, nothing published changes, a rerun resumes."""
    before = parquet_bytes(root)
    key = ShardKey("town_a", "sunny", 15, 20)
    real, calls = os.fsync, []

    def full(handle: int) -> None:
        calls.append(handle)
        if len(calls) == 5:  # a file and its folder take two
            raise OSError(code, os.strerror(code))
        real(handle)

    with monkeypatch.context() as patch:
        patch.setattr(publish.os, "fsync", full)
        with pytest.raises(OutOfSpaceError, match=r"weather=sunny: no space left.*bytes needed.*free;.*resumes"):
            write_shard(root, key, rows_of(key), META)
    assert not list(root.rglob(".*.tmp"))
    assert {path: data for path, data in parquet_bytes(root).items() if path in before} == before
    assert [finding.kind for finding in verify(root)] == ["orphan"] * 2
    assert pending_shards(root, [*KEYS, key]) == [key]
    write_shard(root, key, rows_of(key), META)
    assert verify(root) == []


def test_other_disk_errors_keep_their_name(tmp_path):
    (tmp_path / "frames").write_text("a file where a folder should be")
    with pytest.raises(OSError, match="frames") as error:
        write_shard(tmp_path, KEYS[0], {"frames": make_shard(KEYS[0])["frames"]}, META)
    assert not isinstance(error.value, OutOfSpaceError)
