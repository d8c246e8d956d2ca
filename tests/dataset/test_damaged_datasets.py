"""Truncated, half-written and foreign folders: every reader names the file in one line."""

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import mmw
from mmw.__main__ import main
from mmw.dataset.export.exporter import export
from tests.fixtures.edit_files import agree, edit_json
from tests.fixtures.small_dataset import copy_of, part, small_dataset

POSES, LIDAR = part("poses", "sunny", 2), part("lidar", "sunny", 2)


@pytest.fixture
def root() -> Iterator[Path]:
    """Return a copy that any user of the machine may read."""
    folder = Path(tempfile.mkdtemp(prefix="mmw-damaged-"))
    folder.chmod(0o755)
    yield copy_of(small_dataset(), folder / "d")
    shutil.rmtree(folder)


def message_of(work: Callable[[], object]) -> str:
    """Return the one line of the ValueError that some work ends with."""
    with pytest.raises(ValueError) as error:
        work()
    assert "\n" not in str(error.value)
    return str(error.value)


def read_all(root: Path, table: str) -> None:
    mmw.open(root).read(table)


def foreign_rows(root: Path) -> None:
    (root / POSES).unlink()
    pq.write_table(pa.table({"a": [1, 2]}), root / POSES)


def link(root: Path, name: str, to: str) -> None:
    (root / name).unlink(missing_ok=True)
    (root / name).symlink_to(root / to)


NO_PLACE = f"{POSES}: cannot be read (it is a link that leads nowhere)"
FOREIGN = "no file of a dataset has this name"
LINKED = (lambda root: link(root, "poses/again", "poses"), f"poses/again: {FOREIGN}")
NOTES = (lambda root: (root / "poses" / "notes.txt").write_text("mine"), f"poses/notes.txt: {FOREIGN}")


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (foreign_rows, f"{POSES}: has no column frame, agent"),
        (lambda root: link(root, POSES, "gone.parquet"), NO_PLACE),
        (lambda root: link(root, POSES, POSES), NO_PLACE),
        LINKED,
        NOTES,
        (lambda root: shutil.copy(root / POSES, (root / POSES).with_name("mine.parquet")), f"mine.parquet: {FOREIGN}"),
    ],
)
def test_readers_and_exporters_name_the_file(root: Path, tmp_path: Path, damage: Callable, words: str) -> None:
    damage(root)
    assert words in message_of(lambda: read_all(root, "poses"))
    assert words in message_of(lambda: export(root, "opv2v", tmp_path / "out"))
    if damage is not foreign_rows:  # DuckDB looks at the first file alone, and names the other when it gets there
        assert words in message_of(lambda: mmw.connect(root))


def test_foreign_rows_in_the_first_file(root: Path) -> None:
    pq.write_table(pa.table({"a": [1, 2]}), root / part("poses"))
    for file in (part("poses", "rainy"), part("poses", "rainy", 2)):
        (root / file).unlink()
    for work in (lambda: mmw.connect(root), lambda: read_all(root, "poses")):
        assert f"{part('poses')}: has no column frame, agent" in message_of(work)


@pytest.mark.parametrize(("damage", "words"), [LINKED, NOTES])
def test_verify_calls_it_foreign(root: Path, damage: Callable, words: str, capsys: pytest.CaptureFixture) -> None:
    damage(root)
    assert main(["verify", str(root)]) == 1
    assert f"foreign: {words}" in capsys.readouterr().out


@pytest.mark.parametrize(
    "change",
    [{"schema_version": 3}, {"config": []}, {"config_sha256": None}, {"schema_version": "two"}, {"versions": "1"}],
    ids=str,
)
def test_a_head_of_other_types_is_named(root: Path, change: dict, capsys: pytest.CaptureFixture) -> None:
    edit_json(root / "dataset.json", lambda content: content.update(change))
    for work in (lambda: mmw.open(root), lambda: mmw.connect(root)):
        assert message_of(work).startswith(f"{root}/dataset.json: ")
    for arguments in (["export", "kitti", str(root), str(root / "out")], ["verify", str(root)]):
        assert main(arguments) in (1, 2)
        output = capsys.readouterr()
        assert "dataset.json: " in output.out + output.err


def test_a_configuration_without_channel(root: Path, tmp_path: Path) -> None:
    edit_json(root / "dataset.json", lambda content: content["config"].pop("channel"))
    assert "dataset.json: its configuration has no channel" in message_of(
        lambda: export(root, "deepmimo", tmp_path / "out")
    )


@pytest.mark.parametrize("change", [{"frame_begin": "x"}, {"weather": 4}, {"files": [{"table": "poses"}]}], ids=str)
def test_a_marker_of_other_types_is_a_finding(root: Path, change: dict, capsys: pytest.CaptureFixture) -> None:
    marker = sorted((root / "_shards").glob("*.sunny.*"))[0]
    edit_json(marker, lambda content: content.update(change))
    assert main(["verify", str(root)]) == 1
    assert f"marker: _shards/{marker.name}: cannot be read" in capsys.readouterr().out


@pytest.mark.parametrize("size", [0, 900])
def test_a_copied_file_that_is_truncated_is_named(root: Path, tmp_path: Path, size: int) -> None:
    (root / LIDAR).write_bytes((root / LIDAR).read_bytes()[:size])
    assert f"{root / LIDAR}: cannot be read" in message_of(lambda: export(root, "huggingface", tmp_path / "out"))


def test_a_missing_file_of_a_finished_shard_is_not_left_out(root: Path, tmp_path: Path) -> None:
    (root / LIDAR).unlink()
    assert f"{root / LIDAR}: is missing" in message_of(lambda: export(root, "huggingface", tmp_path / "out"))


def test_a_folder_that_links_to_itself(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    for work in (lambda: mmw.open(tmp_path / "loop"), lambda: mmw.connect(tmp_path / "loop")):
        assert str(tmp_path / "loop") in message_of(work)


def test_a_column_that_is_not_there_reads_no_file(root: Path) -> None:
    data = mmw.open(root)
    data.arrow("lidar")
    for path in (root / "lidar").rglob("*.parquet"):
        path.write_bytes(b"")
    assert "table 'lidar': has no column scent; it has" in message_of(lambda: data.read("lidar", columns=["scent"]))
    assert "table 'frames': has no column agent" in message_of(lambda: data.read("frames", agent="cav_1"))


@contextmanager
def ordinary_user() -> Iterator[None]:
    """Drop the rights of the superuser, who may read every file, in this context."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(0)


@pytest.mark.parametrize(
    ("path", "named"),
    [("dataset.json", "dataset.json"), (".", "dataset.json"), ("poses", "poses"), (POSES, POSES)],
)
def test_unreadable_files_are_named(root: Path, path: str, named: str) -> None:
    read_all(root, "poses")  # imports what it needs, which an ordinary user may not
    mmw.connect(root).close()
    (root / path).chmod(0)
    with ordinary_user():
        text = message_of(lambda: read_all(root, "poses"))
        other = message_of(lambda: mmw.connect(root)) if path != POSES else text
    (root / path).chmod(0o755)
    for words in (text, other):
        assert f"{root / named}: cannot be read (Permission denied)" in words


def change_column(root: Path, path: str, change: Callable[[pa.Table, int], pa.Table], column: str) -> None:
    rows = pq.ParquetFile(root / path).read()
    pq.write_table(change(rows, rows.column_names.index(column)), root / path)


def with_values(values: Callable[[int], pa.Array]) -> Callable[[pa.Table, int], pa.Table]:
    return lambda rows, index: rows.set_column(index, rows.column_names[index], values(rows.num_rows))


COLUMN_DAMAGES = {
    "dropped": (lambda rows, index: rows.remove_column(index), "has no column "),
    "twice": (lambda rows, index: rows.append_column(rows.column_names[index], rows.column(index)), "has the column "),
    "struct": (with_values(lambda count: pa.array([{"a": 1}] * count)), "column "),
    "time": (with_values(lambda count: pa.array([0] * count, pa.timestamp("us"))), "column "),
}


@pytest.mark.parametrize("frame", [0, 2], ids=["first file", "later file"])
@pytest.mark.parametrize("column", ["z", "frame"])
@pytest.mark.parametrize("damage", COLUMN_DAMAGES)
def test_a_damaged_column_is_named(
    root: Path, tmp_path: Path, damage: str, column: str, frame: int, capsys: pytest.CaptureFixture
) -> None:
    change, words = COLUMN_DAMAGES[damage]
    file = part("poses", "rainy" if frame == 0 else "sunny", frame)
    change_column(root, file, change, column)
    agree(root)
    words = f"{root / file}: {words}{column}"
    assert words in message_of(lambda: read_all(root, "poses"))
    if frame == 0:  # DuckDB's view has the columns of the first file
        assert words in message_of(lambda: mmw.connect(root))
    for form in ("deepmimo", "v1"):
        assert main(["export", form, str(root), str(tmp_path / form), "scenario=town03_roundabout"]) == 2
        assert words in capsys.readouterr().err
    assert main(["verify", str(root), "--frames", "1"]) == 1
    captured = capsys.readouterr()
    assert f"schema: {file}" in captured.out and "internal error" not in captured.err


def test_an_image_that_is_null_is_named(root: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    file = part("rgb")
    type_ = pq.read_schema(root / file).field("image").type
    change_column(root, file, with_values(lambda count: pa.nulls(count, type_)), "image")
    assert main(["export", "kitti", str(root), str(tmp_path / "out"), "rate=50"]) == 2
    assert "table 'rgb': image is null in " in capsys.readouterr().err
