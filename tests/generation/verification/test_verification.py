"""`mmw verify`: whatever is damaged, missing, foreign or wrong is found and named, in lines, never as a traceback."""

import hashlib
import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from mmw.__main__ import main as mmw
from mmw.cli.verify import check
from mmw.generation.verification.physics import _in_depth
from mmw.generation.verification.reproducibility import choose_rows, rerender
from mmw.storage.file_checks import verify, version_number
from mmw.storage.manifest import finalize
from tests.fixtures.small_dataset import SCENARIO, copy_of, part, read_once, replace_column, rewrite, small_dataset


@pytest.fixture(scope="module", autouse=True)
def one_scene() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mmw.generation.regenerate.read_scenario", read_once)
        yield


@pytest.fixture(scope="module")
def whole() -> Path:
    return small_dataset()


@pytest.fixture
def root(whole: Path, tmp_path: Path) -> Path:
    return copy_of(whole, tmp_path / "d")


def kinds(root: Path) -> set[str]:
    return {finding.kind for finding in check(root, 5)}


def edit_json(path: Path, change: Callable[[dict], None]) -> None:
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def test_a_whole_dataset_has_nothing_wrong(whole: Path, capsys: pytest.CaptureFixture) -> None:
    assert check(whole, 5) == []
    assert mmw(["verify", str(whole)]) == 0
    assert "every file is there and unchanged" in capsys.readouterr().out


def flip_byte(root: Path) -> None:
    path = root / part("lidar", "rainy")
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 4
    path.write_bytes(data)


def drop_shard(root: Path) -> None:
    for path in [*root.rglob("weather=rainy/part-000002.parquet"), root / f"_shards/{SCENARIO}.rainy.000002.json"]:
        path.unlink()
    finalize(root)


def drop_static(root: Path) -> None:
    (root / f"_shards/{SCENARIO}.json").unlink()
    finalize(root)


def repeat_row(root: Path) -> None:
    rewrite(root, part("poses"), lambda rows: pa.concat_tables([rows, rows.slice(3, 1)]))


def repeat_shard(root: Path) -> None:
    """Two shards hold the same frames."""
    marker = root / f"_shards/{SCENARIO}.sunny.000000.json"
    edit_json(marker, lambda content: content.update(frame_end=3))


def add_file(root: Path) -> None:
    shutil.copy(root / part("poses"), root / part("poses").replace("part-000000", "mine"))


def add_text(root: Path) -> None:
    (root / "lidar" / "notes.txt").write_text("mine")


def add_shard(root: Path) -> None:
    """A shard that the configuration does not have."""
    text = (root / f"_shards/{SCENARIO}.sunny.000000.json").read_text()
    marker = root / f"_shards/{SCENARIO}.sunny.000099.json"
    marker.write_text(text)
    edit_json(marker, lambda content: content.update(frame_begin=99, frame_end=101, files=[]))


def future_head(root: Path) -> None:
    edit_json(root / "dataset.json", lambda content: content.update(schema_version="9.0"))


def future_file(root: Path) -> None:
    rewrite(root, part("imu"), lambda rows: rows, {"mmw.schema_version": "9.0"})


def future_columns(root: Path) -> None:
    rewrite(root, part("imu"), lambda rows: rows.append_column("scent", pa.array([1.0] * rows.num_rows)))


def other_seed(root: Path) -> None:
    text = (root / "config.yaml").read_text()
    (root / "config.yaml").write_text(text.replace("seed: 42", "seed: 43"))


def other_head(root: Path) -> None:
    edit_json(root / "dataset.json", lambda content: content["config"].update(seed=43))


def no_config(root: Path) -> None:
    (root / "config.yaml").unlink()


def truncate_file(root: Path) -> None:
    path = root / part("depth")
    path.write_bytes(path.read_bytes()[:1000])


def half_written(root: Path) -> None:
    """A file without its end whose marker was made to agree."""
    path = root / part("depth")
    data = path.read_bytes()[:1000]
    path.write_bytes(data)

    def agree(content: dict) -> None:
        for file in content["files"]:
            if file["path"] == part("depth"):
                file.update(bytes=1000, sha256=hashlib.sha256(data).hexdigest())

    edit_json(root / f"_shards/{SCENARIO}.sunny.000000.json", agree)
    finalize(root)


def torn_marker(root: Path) -> None:
    marker = root / f"_shards/{SCENARIO}.sunny.000002.json"
    marker.write_text(marker.read_text()[:300])


def foreign_marker(root: Path) -> None:
    (root / f"_shards/{SCENARIO}.sunny.000002.json").write_text('{"files": [{"name": "a"}]}')


def torn_manifest(root: Path) -> None:
    path = root / "_manifest.parquet"
    path.write_bytes(path.read_bytes()[:500])


def wrong_shard(root: Path) -> None:
    """Rows of another frame range, of which there is a row each."""
    rewrite(root, part("frames"), lambda rows: replace_column(rows, "frame", lambda found: [f + 2 for f in found]))


def drop_row(root: Path) -> None:
    rewrite(root, part("lidar"), lambda rows: rows.slice(1))


def drop_column(root: Path) -> None:
    """A file without a column that names its rows, and whose marker was made to agree."""
    path = root / part("imu")
    table = pq.ParquetFile(path).read()
    pq.write_table(table.drop_columns(["sensor"]), path)
    data = path.read_bytes()

    def agree(content: dict) -> None:
        for file in content["files"]:
            if file["path"] == part("imu"):
                file.update(bytes=len(data), sha256=hashlib.sha256(data).hexdigest())

    edit_json(root / f"_shards/{SCENARIO}.sunny.000000.json", agree)
    finalize(root)


def drop_image(root: Path) -> None:
    rewrite(root, part("segmentation"), lambda rows: rows.slice(0, 1))


def drop_path(root: Path) -> None:
    rewrite(root, part("paths"), lambda rows: rows.slice(1))


@pytest.mark.parametrize(
    ("damage", "kind", "named"),
    [
        (flip_byte, "sha256", part("lidar", "rainy")),
        (drop_shard, "missing", f"_shards/{SCENARIO}.rainy.000002.json"),
        (drop_static, "missing", f"_shards/{SCENARIO}.json"),
        (repeat_row, "duplicate", part("poses")),
        (repeat_shard, "duplicate", f"_shards/{SCENARIO}.sunny.000002.json"),
        (add_file, "foreign", part("poses").replace("part-000000", "mine")),
        (add_text, "foreign", "lidar/notes.txt"),
        (add_shard, "foreign", f"_shards/{SCENARIO}.sunny.000099.json"),
        (future_head, "schema", "dataset.json"),
        (future_file, "schema", part("imu")),
        (future_columns, "schema", part("imu")),
        (other_seed, "config", "config.yaml"),
        (other_head, "config", "dataset.json"),
        (no_config, "config", "config.yaml"),
        (truncate_file, "size", part("depth")),
        (half_written, "parquet", part("depth")),
        (torn_marker, "marker", f"_shards/{SCENARIO}.sunny.000002.json"),
        (foreign_marker, "marker", f"_shards/{SCENARIO}.sunny.000002.json"),
        (torn_manifest, "manifest", "_manifest.parquet"),
        (wrong_shard, "key", part("frames")),
        (drop_row, "count", part("lidar")),
        (drop_column, "count", part("imu")),
        (half_written, "count", part("depth")),
        (drop_image, "count", part("segmentation")),
        (drop_path, "count", part("paths")),
    ],
)
def test_damage_is_found_and_named(
    root: Path, damage: Callable[[Path], None], kind: str, named: str, capsys: pytest.CaptureFixture
) -> None:
    damage(root)
    assert mmw(["verify", str(root)]) == 1
    told = capsys.readouterr()
    assert f"{kind}: {named}: " in told.out and "wrong" in told.err and "Traceback" not in told.out + told.err


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


def scale(factor: float) -> Callable[[list], list]:
    return lambda values: [value * factor for value in values]


def stretch_transfer(root: Path) -> None:
    for name in ("t_tt_re", "t_pp_re"):
        rewrite(root, part("paths"), lambda rows, name=name: replace_column(rows, name, scale(1.001)))


def delay_paths(root: Path) -> None:
    rewrite(root, part("paths"), lambda rows: replace_column(rows, "tau_s", scale(1.0001)))


def change_gain(root: Path) -> None:
    def louder(values: list) -> list:
        return [None if value is None else value + 0.01 for value in values]

    rewrite(root, part("links"), lambda rows: replace_column(rows, "gain_db", louder))


def turn_sight(root: Path) -> None:
    rewrite(root, part("links"), lambda rows: replace_column(rows, "is_los", lambda found: [not is_ for is_ in found]))


def move_boxes(root: Path) -> None:
    rewrite(root, part("boxes"), lambda rows: replace_column(rows, "x", lambda found: [x + 1.0 for x in found]))


def block_lasers(root: Path) -> None:
    """Sweeps of a town at a third of its distance."""
    for weather in ("sunny", "rainy"):
        for frame in (0, 2):
            for axis in "xyz":
                rewrite(root, part("lidar", weather, frame), lambda rows, axis=axis: replace_column(rows, axis, nearer))
            rewrite(root, part("lidar", weather, frame), lambda rows: replace_column(rows, "object_id", unknown))


def nearer(sweeps: list) -> list:
    return [[value / 3.0 for value in sweep] for sweep in sweeps]


def unknown(sweeps: list) -> list:
    return [[0] * len(sweep) for sweep in sweeps]


def test_what_a_depth_image_says_of_a_line() -> None:
    depth, mount = (
        np.full((120, 160), 50.0),
        {"fx": 56.0, "fy": 56.0, "cx": 80.0, "cy": 60.0, "width": 160, "height": 120},
    )
    assert _in_depth(depth, mount, np.array([20.0, 5.0, 1.0])) is True
    assert _in_depth(depth, mount, np.array([80.0, 5.0, 1.0])) is False
    for untold in ([50.4, 0.0, 0.0], [20.0, 40.0, 0.0], [-20.0, 0.0, 0.0]):  # at the wall, beside, behind
        assert _in_depth(depth, mount, np.array(untold)) is None
    depth[60, 80] = 3.0  # an edge runs through
    assert _in_depth(depth, mount, np.array([20.0, 0.0, 0.0])) is None


@pytest.mark.parametrize(
    ("change", "kind"),
    [
        (stretch_transfer, "friis"),
        (delay_paths, "friis"),
        (change_gain, "friis"),
        (turn_sight, "sight"),
        (move_boxes, "box"),
        (block_lasers, "sight"),
    ],
)
def test_physics_that_does_not_hold_is_found(root: Path, change: Callable[[Path], None], kind: str) -> None:
    change(root)
    assert verify(root) == []
    assert kinds(root) == {kind}


def test_random_rows_made_again_are_equal(whole: Path, capsys: pytest.CaptureFixture) -> None:
    names = choose_rows(whole, 30, seed=3)
    assert len(names) > 20 and len({name.table for name in names}) > 9
    assert choose_rows(whole, 30, seed=3) == names != choose_rows(whole, 30, seed=4)
    assert mmw(["verify", str(whole), "--rerender", "30", "--seed", "3", "--device", "cpu"]) == 0
    told = capsys.readouterr().out
    assert told.count(": equal\n") == len(names) and "differs" not in told


def test_a_row_that_is_made_otherwise_is_found(root: Path, capsys: pytest.CaptureFixture) -> None:
    """One value off by its last bit, with hashes that agree."""

    def nudge(values: list) -> list:
        return [float(np.nextafter(np.float32(value), np.float32(np.inf))) for value in values]

    for weather in ("sunny", "rainy"):
        for frame in (0, 2):
            rewrite(root, part("imu", weather, frame), lambda rows: replace_column(rows, "gx", nudge))
    findings = rerender(root, 40, seed=1, device="cpu")
    assert findings and {finding.kind for finding in findings} == {"remade"}
    assert all(finding.path.startswith("imu/") and finding.text.endswith("differs in gx") for finding in findings)


def test_schema_versions() -> None:
    assert version_number("2.10") == (2, 10)
    for text in ("2", "two.1", ""):
        with pytest.raises(ValueError, match=r"MAJOR\.MINOR"):
            version_number(text)
