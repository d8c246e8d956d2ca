"""Files that were copied into a dataset: named by every command that writes or counts, removed by none."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from mmw.__main__ import main as mmw
from mmw.cli.run import main
from mmw.storage.foreign_files import foreign_files
from mmw.storage.shard_writer import ShardKey, marker_path, table_path
from tests.fixtures.own_world import command, table_files

KEYS: list[ShardKey | str] = ["a", ShardKey("a", "sunny", 0, 5), ShardKey("a", "sunny", 5, 8)]


def touch(root: Path, *paths: str | Path) -> list[str]:
    for path in paths:
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).touch()
    return sorted(str(path) for path in paths)


def test_only_files_of_the_plan_are_own(tmp_path: Path) -> None:
    own = touch(tmp_path, *(table_path("imu" if isinstance(key, ShardKey) else "objects", key) for key in KEYS))
    touch(tmp_path, *map(marker_path, KEYS), "_manifest.parquet", "README.md", "stages/a.usdc", "assets/b.parquet")
    touch(tmp_path, "imu/.part-000000.parquet.0of1-0123456789ab.tmp", "imu/.nfs01", "_shards/.a.tmp", "imu/_SUCCESS")
    assert foreign_files(tmp_path, KEYS) == []
    assert foreign_files(tmp_path, KEYS, own) == []
    assert foreign_files(tmp_path, KEYS, own[1:]) == own[:1]  # no marker lists it
    foreign = touch(
        tmp_path,
        "imu/scenario=a/weather=sunny/part-000001.parquet",
        "imu/scenario=a/weather=rainy/part-000000.parquet",
        "imu/scenario=b/weather=sunny/part-000000.parquet",
        "imu/scenario=a/part-000000.parquet",
        "objects/scenario=a/weather=sunny/part-000000.parquet",
        "imu/scenario=a/weather=sunny/part-000000 (copy).parquet",
        "imu/notes.txt",
        "_shards/b.sunny.000000.json",
        "copy.parquet",
    )
    assert foreign_files(tmp_path, KEYS) == foreign


def copy_part(root: Path) -> str:
    """Copy a part: readers return its rows twice."""
    part = "imu/scenario=mine/weather=sunny/part-000000.parquet"
    shutil.copy(root / part, root / part.replace("000000", "000001"))
    return part.replace("000000", "000001")


def copy_scenario(root: Path) -> str:
    shutil.copytree(root / "lidar/scenario=mine", root / "lidar/scenario=other")
    return "lidar/scenario=other/weather=rainy/part-000000.parquet"


def copy_table(root: Path) -> str:
    """Copy a part to a table that the configuration does not have."""
    name = "radar/scenario=mine/weather=sunny/part-000000.parquet"
    (root / name).parent.mkdir(parents=True)
    shutil.copy(root / "imu/scenario=mine/weather=sunny/part-000000.parquet", root / name)
    return name


@pytest.mark.parametrize("copy", [copy_part, copy_scenario, copy_table])
def test_copies_are_named_and_kept(
    world: Path, tmp_path: Path, copy: Callable[[Path], str], capsys: pytest.CaptureFixture
) -> None:
    out = shutil.copytree(world / "single", tmp_path / "out")
    name = copy(out)
    before = table_files(out)
    for arguments in (["finalize", str(out)], ["finalize", str(out), "--partial"]):
        assert mmw(arguments) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"mmw: {out}: has files that are no part of the dataset") and name in line
        assert "delete them or move them away" in line
    assert mmw(["status", str(out)]) == 1
    assert name in capsys.readouterr().out
    assert main([*command(world, "x", "--workers", "1"), "--out", str(out)]) == 2
    assert name in capsys.readouterr().err.splitlines()[-1]
    assert table_files(out) == before
    shutil.rmtree(out / name.split("/")[0] / "scenario=other", ignore_errors=True)
    (out / name).unlink(missing_ok=True)
    assert mmw(["finalize", str(out)]) == 0
    assert mmw(["status", str(out)]) == 0


def test_parts_of_a_killed_run_are_own(world: Path, tmp_path: Path) -> None:
    """Tables of a shard whose marker was not written yet are no copies: the run writes them again."""
    out = shutil.copytree(world / "single", tmp_path / "out")
    (out / "_shards/mine.sunny.000002.json").unlink()
    (out / "_manifest.parquet").unlink()
    assert mmw(["status", str(out)]) == 1
    assert mmw(["finalize", str(out), "--partial"]) == 0
    assert main([*command(world, "x", "--workers", "1"), "--out", str(out)]) == 0
    assert mmw(["verify", str(out)]) == 0
