"""Unfinished files: their names tell whose they are, and none stays when nobody alive can be writing it."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

import mmw.generation.executors.local_processes
from mmw.cli.run import main
from mmw.core.temp_files import Owner, is_temporary, owned, owner_of, temporary_path
from mmw.storage.file_checks import verify
from mmw.storage.lock import remove_leftovers, temporaries, writing
from tests.fixtures import dying_workers
from tests.fixtures.dying_workers import note_of
from tests.fixtures.own_world import assert_same_files, command

IN_PROC = pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="finds the names of open files in /proc")


def test_a_name_tells_the_owner(tmp_path: Path) -> None:
    run = Owner(1, 4)
    worker = Owner(1, 4, run.run, 3)
    path = tmp_path / "a" / "part-000000.parquet"
    assert owner_of(temporary_path(path)) is None and is_temporary(temporary_path(path))
    with owned(tmp_path, run):
        assert owner_of(temporary_path(path)) == owner_of(temporary_path(path, ".usda")) == run
        of_usd = temporary_path(path, ".usdc").with_suffix(".NaWUb6")  # USD writes beside a file, and renames
        assert owner_of(of_usd) == run and is_temporary(of_usd)
        with owned(tmp_path, worker):
            assert owner_of(temporary_path(path)) == worker
            assert owner_of(temporary_path(tmp_path.parent / "part-000000.parquet")) is None
        assert owner_of(temporary_path(path)) == run
    assert owner_of(temporary_path(path)) is None
    assert run.has(run) and run.has(worker) and worker.has(worker)
    assert not worker.has(run) and not run.has(Owner(1, 4)) and not worker.has(Owner(1, 4, run.run, 4))


def unfinished(folder: Path, owner: Owner | None) -> Path:
    """Leave a file like one that was being written when its process was killed."""
    if owner is None:
        path = temporary_path(folder / "poses" / "part-000000.parquet")
    else:
        with owned(folder, owner):
            path = temporary_path(folder / "poses" / "part-000000.parquet")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"PAR1")
    return path


def test_a_part_removes_what_nobody_can_be_writing(tmp_path: Path) -> None:
    own, other, unknown = (unfinished(tmp_path, owner) for owner in (Owner(0, 2), Owner(1, 2), None))
    another_count = unfinished(tmp_path, Owner(1, 3))  # parts of another number are refused while this one is written
    with writing(tmp_path, 0, 2, pytest.fail) as run:
        assert (run.index, run.count) == (0, 2)
        assert not own.exists() and not another_count.exists() and other.exists() and unknown.exists()
        mine = unfinished(tmp_path, Owner(0, 2, run.run, 5))  # of a worker that was killed
        with writing(tmp_path, 1, 2, pytest.fail) as second:
            assert not other.exists() and mine.exists()
            theirs = unfinished(tmp_path, second)
            remove_leftovers(tmp_path, 0, 2)
            assert theirs.exists() and unknown.exists()  # they may be in use
        assert not theirs.exists() and mine.exists()
        other = unfinished(tmp_path, Owner(1, 2))
        remove_leftovers(tmp_path, 0, 2)
        assert not other.exists() and not unknown.exists() and mine.exists()
    assert not mine.exists()
    with writing(tmp_path, 0, 1, pytest.fail):
        assert temporaries(tmp_path) == []


def test_a_finished_dataset_keeps_nothing_of_dead_processes(tmp_path: Path) -> None:
    """Of parts of any number, and of nobody; a live part keeps its files, and those of nobody stay with it."""
    locks = tmp_path / "_locks"
    with writing(tmp_path, 0, 2, pytest.fail) as run, writing(tmp_path, 1, 2, pytest.fail) as live:
        dead = [unfinished(tmp_path, owner) for owner in (Owner(0, 1), Owner(2, 3))]
        nobodys, theirs = unfinished(tmp_path, None), unfinished(tmp_path, live)
        for name in ("part-0-of-1", "part-2-of-3"):
            (locks / f"{name}.lock").touch()
            (locks / f"{name}.json").write_text("process 1 on a machine")
        remove_leftovers(tmp_path, run.index, run.count)
        assert not any(path.exists() for path in dead)
        assert nobodys.exists() and theirs.exists()
        assert sorted(path.name for path in locks.glob("*.json")) == ["part-0-of-2.json", "part-1-of-2.json"]
    with writing(tmp_path, 0, 2, pytest.fail):
        remove_leftovers(tmp_path, 0, 2)
        assert not nobodys.exists()
    assert temporaries(tmp_path) == [] and not list(locks.glob("*.json"))


def test_a_run_ends_without_what_a_worker_of_the_killed_one_wrote_late(tmp_path: Path) -> None:
    with writing(tmp_path, 0, 2, pytest.fail):
        late = unfinished(tmp_path, Owner(0, 2))
    assert not late.exists()


def test_a_lock_that_somebody_looks_at_is_free(tmp_path: Path) -> None:
    """`mmw status` locks it for a moment to see whether it is held."""
    path = tmp_path / "_locks" / "part-0-of-1.lock"
    path.parent.mkdir()
    code = (
        "import sys, time; from filelock import FileLock\n"
        "with FileLock(sys.argv[1]): print(flush=True); time.sleep(0.2)"
    )
    with subprocess.Popen([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE) as other:
        assert other.stdout
        other.stdout.readline()
        with writing(tmp_path, 0, 1, pytest.fail):
            pass


def assert_whole(world: Path, out: str) -> None:
    """Kill a process while it writes: nothing of it is left, and the rows are those of an undisturbed run."""
    assert note_of(world / out, 0).read_text().startswith(".part-")
    assert temporaries(world / out) == [] and verify(world / out) == []
    assert_same_files(world / "single", world / out)


@IN_PROC
def test_a_worker_killed_while_it_writes_leaves_nothing(
    world: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr(mmw.generation.executors.local_processes, "_serve", dying_workers.serve)
    assert main(command(world, "worker", "--workers", "2")) == 0
    assert capsys.readouterr().err.count("died by signal 9; its work goes to another one") == 1
    assert_whole(world, "worker")


@IN_PROC
@pytest.mark.parametrize("next_part", [0, 1])
def test_a_part_killed_while_it_writes_leaves_nothing(world: Path, next_part: int) -> None:
    """Resume at once, or after the other part has ended."""
    out = f"part-{next_part}"
    code = (
        "import sys; from pathlib import Path; from mmw.run import main; from tests.fixtures import dying_workers;"
        "dying_workers.die_while_writing(Path(sys.argv[1])); main(sys.argv[2:])"
    )
    arguments = command(world, out, "--workers", "1", "--shard", "0/2")
    done = subprocess.run([sys.executable, "-c", code, str(world / out), *arguments], capture_output=True, text=True)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert any(owner_of(path) for path in temporaries(world / out))
    for part in (next_part, 1 - next_part):
        assert main(command(world, out, "--workers", "1", "--shard", f"{part}/2")) == 0
    assert_whole(world, out)
