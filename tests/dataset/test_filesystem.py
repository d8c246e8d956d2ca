"""Datasets that are not a plain local folder, and folders that are damaged or foreign."""

from pathlib import Path

import numpy as np
import pyarrow.fs as pafs
import pytest

import mmw
from mmw.dataset import Dataset
from tests.fixtures.small_dataset import SCENARIO, copy_of, part, small_dataset


@pytest.fixture(scope="module")
def local() -> Dataset:
    return mmw.open(small_dataset())


@pytest.fixture
def root(local: Dataset, tmp_path: Path) -> Path:
    return copy_of(local.root, tmp_path / "d")


def data_files(root: Path) -> list[Path]:
    """Files without stages and assets."""
    return [path for path in root.rglob("*") if path.is_file() and not {"assets", "stages"} & set(path.parts)]


def assert_same(other: Dataset, local: Dataset) -> None:
    assert other.info == local.info and other.tables == local.tables
    for table in ("poses", "objects", "rgb"):
        assert other.read(table).equals(local.read(table))
    one, same = (data.frame(SCENARIO, "sunny", 3).agents["cav_1"].sweeps["lidar"].points for data in (other, local))
    np.testing.assert_array_equal(one, same)
    query = "SELECT * FROM beams WHERE weather = 'sunny' ORDER BY ALL"
    assert other.connect().sql(query).fetchall() == local.connect().sql(query).fetchall()
    query = "SELECT count(*), sum(x) FROM lidar_points WHERE weather = 'rainy' AND frame = 1"
    (count, total), (same_count, same_total) = (data.connect().sql(query).fetchall()[0] for data in (other, local))
    assert count == same_count > 0 and total == pytest.approx(same_total)


def test_a_file_uri(local: Dataset) -> None:
    other = mmw.open(f"file://{local.root}")
    assert other.root == local.root and other.filesystem is None
    assert_same(other, local)


def test_a_pyarrow_filesystem(local: Dataset) -> None:
    tree = pafs.SubTreeFileSystem(str(local.root.parent), pafs.LocalFileSystem())
    other = mmw.open(local.root.name, filesystem=tree)
    assert other.filesystem is tree
    assert_same(other, local)


def test_an_fsspec_filesystem_and_uri(local: Dataset) -> None:
    fsspec = pytest.importorskip("fsspec", reason="fsspec is not installed: pip install 'multimodal-wireless[test]'")
    memory = fsspec.filesystem("memory")
    for path in data_files(local.root):
        memory.pipe_file(f"/mmw-test/{path.relative_to(local.root).as_posix()}", path.read_bytes())
    try:
        assert_same(mmw.open("memory://mmw-test"), local)
        assert_same(mmw.open("mmw-test", filesystem=memory), local)
    finally:
        memory.rm("/mmw-test", recursive=True)


def test_an_unknown_place_is_one_line() -> None:
    with pytest.raises(ValueError, match=r"^nowhere://x: cannot be opened .*; give a local folder or s3://") as error:
        mmw.open("nowhere://x")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("size", [0, 3, 1000])
def test_a_truncated_file_is_named(root: Path, size: int) -> None:
    path = root / part("lidar", "sunny", 2)
    path.write_bytes(path.read_bytes()[:size])
    data = mmw.open(root)
    for read in (
        lambda: data.read("lidar"),
        lambda: data.frame(SCENARIO, "sunny", 3).agents["cav_1"].sweeps,
        lambda: data.pandas("lidar", weather="sunny", frames=range(2, 3)),
    ):
        with pytest.raises(
            ValueError, match=f"{part('lidar', 'sunny', 2)}: cannot be read .*damaged.*mmw verify"
        ) as error:
            read()
        assert "\n" not in str(error.value)
    assert data.read("lidar", weather="sunny", frames=range(2)).num_rows == 8  # what is whole is read


def test_the_only_file_of_a_table_truncated(root: Path) -> None:
    path = root / f"objects/scenario={SCENARIO}/part-000000.parquet"
    path.write_bytes(path.read_bytes()[:700])
    for read in (lambda: mmw.open(root).read("objects"), lambda: mmw.connect(root)):
        with pytest.raises(ValueError, match=r"objects/scenario=.*cannot be read"):
            read()


def test_flipped_bytes_inside_a_file_are_named(root: Path) -> None:
    path = root / part("poses")
    data = bytearray(path.read_bytes())
    data[4:400] = bytes(396)
    path.write_bytes(data)
    with pytest.raises(ValueError, match=f"{part('poses')}: cannot be read"):
        mmw.open(root).read("poses")
