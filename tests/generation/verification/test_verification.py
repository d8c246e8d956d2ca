"""`mmw verify`: whatever is damaged, missing, foreign or wrong is found and named, in lines, never as a traceback."""

import shutil
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from mmw.__main__ import main as mmw
from mmw.cli.verify import check
from mmw.generation.provenance import stored_config
from mmw.generation.verification.physics import _in_depth, check_physics
from mmw.generation.verification.reproducibility import choose_rows, rerender
from mmw.storage.file_checks import verify
from mmw.storage.manifest import finalize
from mmw.storage.schema_checks import version_number
from tests.fixtures.edit_files import agree, edit_bytes, edit_json
from tests.fixtures.small_dataset import SCENARIO, copy_of, one_scene, part, replace_column, rewrite, small_dataset

__all__ = ["one_scene"]


@pytest.fixture(scope="module")
def whole() -> Path:
    return small_dataset()


@pytest.fixture
def root(whole: Path, tmp_path: Path) -> Path:
    return copy_of(whole, tmp_path / "d")


def kinds(root: Path) -> set[str]:
    return {finding.kind for finding in check(root, 5)}


def test_a_whole_dataset_has_nothing_wrong(whole: Path, capsys: pytest.CaptureFixture) -> None:
    assert check(whole, 5) == []
    assert mmw(["verify", str(whole)]) == 0
    assert "every file is there and unchanged" in capsys.readouterr().out


def change(root: Path, table: str, column: str, of: Callable[[Any], Any], *place: Any) -> None:
    """Change each value of a column of a file that is not null; `place` is its weather and first frame."""

    def changed(values: list) -> list:
        return [None if value is None else of(value) for value in values]

    rewrite(root, part(table, *place), lambda rows: replace_column(rows, column, changed))


SUNNY, LAST = f"_shards/{SCENARIO}.sunny.000000.json", f"_shards/{SCENARIO}.sunny.000002.json"
"""Markers of the first and the last shard in the sun."""
STATIC = f"_shards/{SCENARIO}.json"
RAINY, FOREIGN = f"_shards/{SCENARIO}.rainy.000002.json", f"_shards/{SCENARIO}.sunny.000099.json"
MINE = part("poses").replace("part-000000", "mine")


def flip_byte(data: bytes) -> bytes:
    third = len(data) // 3
    return data[:third] + bytes([data[third] ^ 4]) + data[third + 1 :]


def drop_files(root: Path, *patterns: str) -> None:
    for pattern in patterns:
        for path in [*root.glob(pattern)]:
            path.unlink()
    finalize(root)


def add_shard(root: Path) -> None:
    """Add a shard that the configuration does not have."""
    shutil.copy(root / SUNNY, root / FOREIGN)
    edit_json(root / FOREIGN, lambda content: content.update(frame_begin=99, frame_end=101, files=[]))


def truncate(root: Path, is_agreed: bool) -> None:
    edit_bytes(root / part("depth"), lambda data: data[:1000])
    if is_agreed:
        agree(root)


def rewritten(table: str, of: Callable[[pa.Table], pa.Table], meta: dict | None = None) -> Callable[[Path], None]:
    return lambda root: rewrite(root, part(table), of, meta)


def edited(path: str, of: Callable[[bytes], bytes] | None = None, **values: Any) -> Callable[[Path], None]:
    """Change the bytes of a file, or values of JSON."""
    return lambda root: edit_bytes(root / path, of) if of else edit_json(root / path, lambda old: old.update(values))


def drop_column(root: Path) -> None:
    """Write a file without a column that names its rows, whose marker agrees."""
    pq.write_table(pq.ParquetFile(root / part("imu")).read().drop_columns(["sensor"]), root / part("imu"))
    agree(root)


def drop_counted_column(root: Path) -> None:
    """Write a file of an older schema version without a column from which rows of other tables follow."""
    rows = pq.ParquetFile(root / part("poses")).read().drop_columns(["role"])
    pq.write_table(
        rows.replace_schema_metadata(rows.schema.metadata | {b"mmw.schema_version": b"2.0"}), root / part("poses")
    )
    agree(root)


GEOMETRY = part("path_geometry")


def forget_geometry(root: Path) -> None:
    """Remove a file of the geometry from the disk and the marker that lists it."""
    (root / GEOMETRY).unlink()
    edit_json(root / SUNNY, lambda content: content["files"].pop([f["path"] for f in content["files"]].index(GEOMETRY)))
    finalize(root)


def take_a_path(root: Path, weather: str, carriers: Sequence[int] = (0, 1)) -> None:
    """Take the last path of the first link, so that the tables of one weather agree, but not with the geometry."""
    gains, links = part("path_gains", weather), part("links", weather)
    first = pq.ParquetFile(root / links).read().select(["frame", "agent", "peer", "path_count"]).slice(0, 1).to_pylist()
    last = first[0].pop("path_count") - 1

    def is_of_link(row: dict) -> bool:
        return row["carrier"] in carriers and all(row[name] == value for name, value in first[0].items())

    def counts(rows: pa.Table) -> pa.Table:
        less = [row["path_count"] - is_of_link(row) for row in rows.to_pylist()]
        return replace_column(rows, "path_count", lambda _: less)

    def without(rows: pa.Table) -> pa.Table:
        return rows.filter(pa.array([not (is_of_link(row) and row["path"] == last) for row in rows.to_pylist()]))

    rewrite(root, links, counts)
    rewrite(root, gains, without)


def name_two_paths_alike(root: Path) -> None:
    """Give the second path of a link the identifier of its first."""

    def alike(rows: pa.Table) -> pa.Table:
        second = rows.column("path").to_pylist().index(1)
        return replace_column(rows, "path_id", lambda ids: [*ids[:second], ids[second - 1], *ids[second + 1 :]])

    rewrite(root, GEOMETRY, alike)


def retype_manifest(root: Path) -> None:
    """Write a manifest whose paths are lists."""
    rows = pq.read_table(root / "_manifest.parquet")
    paths = pa.array([[path] for path in rows["path"].to_pylist()])
    pq.write_table(rows.set_column(rows.column_names.index("path"), "path", paths), root / "_manifest.parquet")


@pytest.mark.parametrize(
    ("damage", "kind", "named"),
    [
        (edited(part("lidar", "rainy"), flip_byte), "sha256", part("lidar", "rainy")),
        (lambda root: drop_files(root, "*/*/weather=rainy/part-000002.parquet", RAINY), "missing", RAINY),
        (lambda root: drop_files(root, STATIC), "missing", STATIC),
        (rewritten("poses", lambda rows: pa.concat_tables([rows, rows.slice(3, 1)])), "duplicate", part("poses")),
        (edited(SUNNY, frame_end=3), "duplicate", LAST),
        (lambda root: shutil.copy(root / part("poses"), root / MINE), "foreign", MINE),
        (lambda root: (root / "lidar" / "notes.txt").write_text("mine"), "foreign", "lidar/notes.txt"),
        (add_shard, "foreign", FOREIGN),
        (edited("dataset.json", schema_version="9.0"), "schema", "dataset.json"),
        (rewritten("imu", lambda rows: rows, {"mmw.schema_version": "9.0"}), "schema", part("imu")),
        (rewritten("imu", lambda rows: rows.append_column("new", rows.column("ax"))), "schema", part("imu")),
        (edited("config.yaml", lambda data: data.replace(b"seed: 42", b"seed: 43")), "config", "config.yaml"),
        (edited("dataset.json", lambda data: data.replace(b'"seed": 42', b'"seed": 43')), "config", "dataset.json"),
        (lambda root: (root / "config.yaml").unlink(), "config", "config.yaml"),
        (edited("config.yaml", lambda data: data.replace(b"type: imu", b"type: sonar")), "config", "config.yaml"),
        (lambda root: truncate(root, is_agreed=False), "size", part("depth")),
        (lambda root: truncate(root, is_agreed=True), "parquet", part("depth")),
        (edited(LAST, lambda data: data[:300]), "marker", LAST),
        (edited(LAST, lambda data: b'{"files": [{"name": "a"}]}'), "marker", LAST),
        (edited("_manifest.parquet", lambda data: data[:500]), "manifest", "_manifest.parquet"),
        (lambda root: change(root, "frames", "frame", lambda frame: frame + 2), "key", part("frames")),
        (rewritten("lidar", lambda rows: rows.slice(1)), "count", part("lidar")),
        (drop_column, "schema", part("imu")),
        (drop_counted_column, "schema", part("poses")),
        (retype_manifest, "manifest", "_manifest.parquet"),
        (rewritten("segmentation", lambda rows: rows.slice(0, 1)), "count", part("segmentation")),
        (rewritten("path_gains", lambda rows: rows.slice(1)), "count", part("path_gains")),
        (rewritten("path_geometry", lambda rows: rows.slice(1)), "count", GEOMETRY),
        (
            rewritten("path_geometry", lambda rows: replace_column(rows, "path", lambda path: [9, *path[1:]])),
            "count",
            GEOMETRY,
        ),
        (name_two_paths_alike, "duplicate", GEOMETRY),
        (lambda root: (root / GEOMETRY).unlink(), "missing", GEOMETRY),
        (forget_geometry, "count", GEOMETRY),
        (lambda root: take_a_path(root, "rainy"), "count", part("links", "rainy")),
        (lambda root: take_a_path(root, "sunny"), "count", GEOMETRY),
        (lambda root: take_a_path(root, "sunny", [1]), "count", part("links")),
    ],
)
def test_damage_is_found_and_named(
    root: Path, damage: Callable[[Path], None], kind: str, named: str, capsys: pytest.CaptureFixture
) -> None:
    damage(root)
    assert mmw(["verify", str(root)]) == 1
    told = capsys.readouterr()
    assert f"{kind}: {named}: " in told.out and " error" in told.err and "Traceback" not in told.out + told.err


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"{}", b"\xff\xfe", b'{"schema_version": "2.1"}'])
def test_a_damaged_or_foreign_head_is_one_line(root: Path, content: bytes, capsys: pytest.CaptureFixture) -> None:
    (root / "dataset.json").write_bytes(content)
    assert mmw(["verify", str(root)]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "dataset.json" in told


def test_what_is_no_dataset_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    for path in (tmp_path, tmp_path / "nothing", tmp_path / "thesis.tex"):
        assert mmw(["verify", str(path)]) == 2
        told = capsys.readouterr().err
        assert told.count("\n") == 1 and "no dataset.json" in told


def test_a_leftover_is_told_and_is_no_error(root: Path, capsys: pytest.CaptureFixture) -> None:
    (root / "poses" / ".part-000005.parquet.tmp").write_bytes(b"")
    assert mmw(["verify", str(root)]) == 0
    assert "temporary: poses/.part-000005.parquet.tmp" in capsys.readouterr().out


def block_lasers(root: Path) -> None:
    """Sweeps of a town at a third of its distance."""
    for weather, frame in product(("sunny", "rainy"), (0, 2)):
        for axis in "xyz":
            change(root, "lidar", axis, lambda sweep: [value / 3.0 for value in sweep], weather, frame)
        change(root, "lidar", "object_id", lambda sweep: [0] * len(sweep), weather, frame)


def test_what_a_depth_image_says_of_a_line() -> None:
    depth = np.full((120, 160), 50.0)
    mount = {"fx": 56.0, "fy": 56.0, "cx": 80.0, "cy": 60.0, "width": 160, "height": 120}
    mount |= {"lens": "pinhole", "coefficients": None}
    assert _in_depth(depth, mount, np.array([20.0, 5.0, 1.0])) is True
    assert _in_depth(depth, mount, np.array([80.0, 5.0, 1.0])) is False
    for untold in ([50.4, 0.0, 0.0], [20.0, 40.0, 0.0], [-20.0, 0.0, 0.0]):  # at the wall, beside, behind
        assert _in_depth(depth, mount, np.array(untold)) is None
    depth[60, 80] = 3.0  # an edge runs through
    assert _in_depth(depth, mount, np.array([20.0, 0.0, 0.0])) is None


@pytest.mark.parametrize(
    ("damage", "kind"),
    [
        (lambda root: change(root, "path_gains", "t_tt_re", lambda value: 1.001 * value), "friis"),
        (lambda root: change(root, "path_geometry", "tau_s", lambda value: 1.0001 * value), "friis"),
        (lambda root: change(root, "links", "gain_db", lambda value: value + 0.01), "friis"),
        (lambda root: change(root, "links", "is_los", lambda value: not value), "sight"),
        (lambda root: change(root, "links", "los_state", lambda _: "foliage"), "sight"),
        (lambda root: change(root, "boxes", "x", lambda value: value + 1.0), "box"),
        (block_lasers, "sight"),
    ],
)
def test_physics_that_does_not_hold_is_found(root: Path, damage: Callable[[Path], None], kind: str) -> None:
    damage(root)
    assert verify(root) == []
    assert {finding.kind for finding in check_physics(root, stored_config(root), 5)} == {kind}


def test_random_rows_made_again_are_equal(whole: Path, capsys: pytest.CaptureFixture) -> None:
    names = choose_rows(whole, 30, seed=3)
    assert len(names) > 20 and len({name.table for name in names}) > 9
    assert choose_rows(whole, 30, seed=3) == names != choose_rows(whole, 30, seed=4)
    assert mmw(["verify", str(whole), "--rerender", "30", "--seed", "3", "--device", "cpu"]) == 0
    told = capsys.readouterr().out
    assert told.count(": equal\n") == len(names) and "differs" not in told


def test_a_row_that_is_made_otherwise_is_found(root: Path, capsys: pytest.CaptureFixture) -> None:
    """One value off by its last bit, with hashes that agree."""
    for weather, frame in product(("sunny", "rainy"), (0, 2)):
        change(root, "imu", "gx", lambda value: float(np.nextafter(np.float32(value), np.inf)), weather, frame)
    findings = rerender(root, 40, seed=1, device="cpu")
    assert findings and {finding.kind for finding in findings} == {"regenerated"}
    assert all(finding.path.startswith("imu/") and finding.text.endswith("differs in gx") for finding in findings)


def test_schema_versions() -> None:
    assert version_number("2.10") == (2, 10)
    for text in ("2", "two.1", ""):
        with pytest.raises(ValueError, match=r"MAJOR\.MINOR"):
            version_number(text)
