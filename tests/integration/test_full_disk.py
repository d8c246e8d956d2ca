"""Runs into a file system of their own that fills up, or that nobody may write: one message, nothing torn, resumed."""

import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import mmw
from mmw.cli.run import main
from mmw.storage.file_checks import verify
from tests.fixtures.own_world import SMALL, command, table_files


def mount(*arguments: str) -> bool:
    """Return whether this process may mount, and did."""
    try:
        return subprocess.run(["mount", *arguments], capture_output=True).returncode == 0
    except OSError:
        return False


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """Mount a disk of 400 kB in memory."""
    folder = tmp_path / "disk"
    folder.mkdir()
    if not mount("-t", "tmpfs", "-o", "size=400k", "tmpfs", str(folder)):
        pytest.skip("mounting needs a privileged Linux user")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


def run(folder: Path, out: Path) -> int:
    return main(command(folder, out, "--workers", "1"))


def test_a_full_disk_ends_a_run_that_goes_on_with_more_room(disk, own_world, capsys):
    out = disk / "out"
    assert run(own_world, out) == 1
    said = capsys.readouterr().err
    assert said.count("no space left") == 1 and "run the same command again: it resumes" in said
    there = table_files(out)
    assert there and all(pq.ParquetFile(out / name).metadata for name in there)  # what has its name is whole
    assert not list(out.rglob(".*.tmp"))
    assert mount("-o", "remount,size=64m", str(disk))
    assert run(own_world, out) == 0
    assert run(own_world, own_world / "roomy") == 0
    assert table_files(out) == table_files(own_world / "roomy")
    assert there.items() <= table_files(out).items()
    assert [finding for finding in verify(out) if finding.is_error] == []


def test_a_full_disk_ends_a_call_from_python_that_goes_on_with_more_room(disk, own_world):
    path, how = own_world / "mine.yaml", {"overrides": SMALL, "device": "cpu", "workers": 1, "progress": False}
    with pytest.raises(mmw.Error, match=r"no space left for .* free some space") as caught:
        mmw.generate(path, disk / "out", **how)
    assert not isinstance(caught.value, mmw.InputError)
    assert mount("-o", "remount,size=64m", str(disk))
    assert len(mmw.generate(path, disk / "out", **how).read("frames")) == 2 * 10


def test_a_simulation_without_room_for_temporary_files_is_one_error(disk, monkeypatch):
    (disk / "filler").write_bytes(bytes(380_000))
    monkeypatch.setattr(tempfile, "tempdir", str(disk))
    small = mmw.load_config("quickstart", ["frames.count=1", "sensors=[{type: imu}]"])
    with pytest.raises(mmw.Error, match="no space left"):
        mmw.Simulation(small, device="cpu")
    assert [path.name for path in disk.iterdir()] == ["filler"]


def test_a_disk_that_nobody_may_write_is_named(disk, own_world, capsys):
    assert mount("-o", "remount,ro", str(disk))
    out = disk / "out"
    assert run(own_world, out) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1 and str(out) in said[0] and "--out" in said[0]
