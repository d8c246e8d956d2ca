"""Writes that fail, each file of a dataset in turn: the file is named, nothing is torn, a rerun completes it."""

import errno
import os
import stat
import subprocess
from collections.abc import Callable
from itertools import count
from pathlib import Path

import pytest

from mmw.storage import atomic_files
from mmw.storage.atomic_files import OutOfSpaceError
from mmw.storage.file_checks import verify
from mmw.storage.lock import temporaries
from mmw.storage.manifest import finalize
from mmw.storage.store import Store
from tests.fixtures.bucket_data import PUTS, make

WRITES = PUTS + 2
"""Files of the dataset: those of a bucket, manifest and card."""


def write(root: Path) -> None:
    make(Store(root))
    finalize(root)


def tables_of(root: Path) -> dict[str, bytes]:
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("part-*.parquet")}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Return the tables of the dataset."""
    root = tmp_path_factory.mktemp("whole") / "out"
    write(root)
    return tables_of(root)


def assert_completed(root: Path, whole: dict[str, bytes]) -> None:
    write(root)
    assert tables_of(root) == whole and verify(root) == []


def failing(number: int, error: int) -> Callable[[int], None]:
    """Return an `os.fsync` that fails at the n-th file; folders are not counted."""
    left, real = count(1), os.fsync

    def fsync(handle: int) -> None:
        if stat.S_ISREG(os.fstat(handle).st_mode) and next(left) == number:
            raise OSError(error, os.strerror(error))
        real(handle)

    return fsync


@pytest.mark.parametrize("number", range(1, WRITES + 1))
@pytest.mark.parametrize("error", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EACCES])
def test_every_write_may_fail(tmp_path, whole, monkeypatch, number: int, error: int) -> None:
    root = tmp_path / "out"
    with monkeypatch.context() as patch:
        patch.setattr(atomic_files.os, "fsync", failing(number, error))
        with pytest.raises((OutOfSpaceError, OSError)) as found:
            write(root)
    if error in (errno.ENOSPC, errno.EDQUOT):
        assert isinstance(found.value, OutOfSpaceError) and "no space left for " in str(found.value)
        name = str(found.value).partition("no space left for ")[2].partition(":")[0]
    else:
        assert isinstance(found.value, OSError) and found.value.errno == error
        name = Path(found.value.filename).name
        assert found.value.filename.startswith(str(root))
    assert not name.startswith(".") and temporaries(root) == []
    assert {path: whole[path] for path in tables_of(root)} == tables_of(root)
    assert_completed(root, whole)


def test_a_disk_that_fills_at_any_file(tmp_path: Path, whole: dict[str, bytes]) -> None:
    """A real disk one block smaller than needed, two, and so on: `dataset.json` to the card meet its end."""
    disk, met = tmp_path / "disk", set()
    disk.mkdir()
    for blocks in count(1):
        size = f"size={4 * blocks}k"
        mounted = ["mount", "-t", "tmpfs", "-o", size, "tmpfs", str(disk)]
        if os.name == "nt" or subprocess.run(mounted, capture_output=True).returncode:
            pytest.skip("mounting needs a privileged Linux user; test_every_write_may_fail injects the same")
        try:
            (disk / "ballast").write_bytes(bytes(4096))
            try:
                write(disk / "out")
                break
            except OutOfSpaceError as error:
                met.add(str(error).partition("no space left for ")[2].partition(":")[0])
            there = tables_of(disk / "out")
            assert there.items() <= whole.items() and temporaries(disk) == []
            subprocess.run(["mount", "-o", "remount,size=16m", str(disk)], check=True)
            assert_completed(disk / "out", whole)
        finally:
            subprocess.run(["umount", "-l", str(disk)], check=True)
    assert {"dataset.json", "part-000000.parquet", "_manifest.parquet", "README.md"} <= met
