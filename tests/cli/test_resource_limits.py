"""Commands that meet a limit of the system: one line that names file and cure, exit code 1, and a rerun completes."""

import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from filelock import FileLock

from mmw.__main__ import main as mmw_main
from mmw.cli.run import main
from mmw.storage import shard_writer
from tests.fixtures.own_world import command, table_files
from tests.fixtures.privileges import change_modes, permissions_hold

resource = pytest.importorskip("resource", reason="Windows has no such limits")

FINISHED = "every finished shard is kept and the same command resumes"
WRITE, ALL = 0o222, 0o777


@contextmanager
def limited(kind: int, limit: int) -> Iterator[None]:
    """Limit a resource of this process in the block."""
    soft, hard = resource.getrlimit(kind)
    resource.setrlimit(kind, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(kind, (soft, hard))


def only_line(capsys: pytest.CaptureFixture) -> str:
    """Return the only message of a command; there is no stack trace."""
    error = capsys.readouterr().err
    assert "Traceback" not in error and "Logging error" not in error and "internal error" not in error
    (line,) = [line for line in error.splitlines() if line.startswith("mmw: ") and "the log ends here" not in line]
    return line


def assert_completed(world: Path, out: str) -> None:
    """Check that the same command completes a dataset to what an undisturbed run makes."""
    assert main(command(world, out, "--workers", "1")) == 0
    assert table_files(world / out) == table_files(world / "single")
    assert mmw_main(["verify", str(world / out)]) == 0


def after_shards(number: int, action: Callable[[], None]) -> Callable[..., None]:
    """Return a function that writes a file and calls an action once, when some markers of shards are written."""
    left, write = [number], shard_writer.write_bytes_atomically

    def written(path: Path, data: bytes) -> None:
        write(path, data)
        left[0] -= "_shards" in path.parts
        if left[0] == 0:
            left[0] = -1
            action()

    return written


@pytest.mark.parametrize("limit", [500, 4_000, 8_000])
def test_a_limit_of_file_size_names_the_file(world: Path, capsys: pytest.CaptureFixture, limit: int) -> None:
    out = f"size-{limit}"
    with limited(resource.RLIMIT_FSIZE, limit):
        assert main(command(world, out, "--workers", "1")) == 1
    line = only_line(capsys)
    named = Path(line.removeprefix("mmw: ").partition(": ")[0])
    assert named.is_relative_to(world / out) and named.suffix in (".json", ".yaml", ".parquet")
    assert "File too large; raise the limit of file sizes (ulimit -f)" in line and line.endswith(FINISHED)
    assert_completed(world, out)


def test_too_few_open_files(world: Path, capsys: pytest.CaptureFixture) -> None:
    ended = []
    for more in range(6):
        used = {int(path.name) for path in Path("/proc/self/fd").iterdir()}
        free = [number for number in range(1000) if number not in used]
        with limited(resource.RLIMIT_NOFILE, free[more]):
            ended.append(main(command(world, "files", "--workers", "1")))
        if ended[-1]:
            line = only_line(capsys)
            assert "Too many open files; raise the limit of open files (ulimit -n)" in line and line.endswith(FINISHED)
    assert ended[:2] == [1, 1]
    assert_completed(world, "files")


def test_permission_that_is_lost_in_a_run(world: Path, capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    out = world / "lost"
    lose = after_shards(3, lambda: change_modes(out, remove=WRITE))
    with monkeypatch.context() as patch, permissions_hold():
        patch.setattr(shard_writer, "write_bytes_atomically", lose)
        assert main(command(world, "lost", "--workers", "1")) == 1
    line = only_line(capsys)
    assert f"{out}/" in line and "_locks" not in line and ".tmp" not in line
    assert "Permission denied; change its permissions" in line and line.endswith(FINISHED)
    change_modes(out, add=WRITE)
    assert_completed(world, "lost")


def test_a_folder_that_is_removed_in_a_run(world: Path, capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    out = world / "removed"
    with monkeypatch.context() as patch:
        patch.setattr(shard_writer, "write_bytes_atomically", after_shards(3, lambda: out.rename(world / "gone")))
        assert main(command(world, "removed", "--workers", "1")) == 1
    line = only_line(capsys)
    assert f"{out}: was removed or moved while it was written" in line
    assert_completed(world, "removed")


@pytest.fixture
def complete(world: Path, tmp_path: Path) -> Path:
    """Return a copy of a complete dataset."""
    return Path(shutil.copytree(world / "single", tmp_path / "complete"))


def test_the_status_of_a_dataset_that_may_only_be_read(complete: Path, capsys: pytest.CaptureFixture) -> None:
    change_modes(complete, remove=WRITE)
    with permissions_hold():
        with pytest.raises(PermissionError):
            (complete / "new").touch()
        assert mmw_main(["status", str(complete)]) == 0
    found = capsys.readouterr()
    assert "20/20" in found.out and found.err == ""
    (lock,) = (complete / "_locks").glob("part-*.lock")
    lock.chmod(0o644)
    with FileLock(lock):
        lock.chmod(0o444)
        with permissions_hold():
            mmw_main(["status", str(complete)])
    assert "being written: part 0 of 1" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["_shards", "_shards/mine.sunny.000002.json", "_locks/part-0-of-1.lock"])
def test_the_status_of_what_may_not_be_read_is_unknown(
    complete: Path, capsys: pytest.CaptureFixture, name: str
) -> None:
    (complete / name).chmod(0)
    with permissions_hold():
        assert mmw_main(["status", str(complete)]) == 1
    found = capsys.readouterr()
    assert " 0/20" not in found.out
    assert found.err.startswith(f"mmw: {complete}/_") and "Permission denied; change its permissions" in found.err
    assert name.partition("/")[0] in found.err and found.err.count("\n") == 1
    (complete / name).chmod(0o755)


def test_a_shard_that_may_not_be_read_is_a_finding(complete: Path, capsys: pytest.CaptureFixture) -> None:
    table = next(complete.rglob("lidar/**/part-*.parquet")).relative_to(complete)
    marker = "_shards/mine.sunny.000002.json"
    for name in (table, marker):
        (complete / name).chmod(0)
    with permissions_hold():
        assert mmw_main(["verify", str(complete)]) == 1
    found = capsys.readouterr().out
    assert f"unreadable: {table}: " in found and f"marker: {marker}: cannot be read" in found


def test_no_thread_can_be_started() -> None:
    """A limit of the address space that the process already fills."""
    done = subprocess.run([sys.executable, "-c", NO_THREAD], capture_output=True, text=True, timeout=600)
    error = done.stderr
    assert done.returncode == 1 and error.count("\n") == 1
    assert error.startswith("mmw: no thread can be started (can't start new thread); raise the limit of memory")
    assert error.endswith(f"{FINISHED}\n")


NO_THREAD = f"""
import argparse, resource, sys
from pathlib import Path
from threading import Thread
from mmw.cli.command import run_command

def work(options):
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + 2_000_000, resource.RLIM_INFINITY))
    Thread(target=print).start()

sys.exit(run_command(argparse.ArgumentParser("mmw test"), work, [], finished="{FINISHED}"))
"""
