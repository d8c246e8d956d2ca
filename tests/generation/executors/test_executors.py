"""Executors of a run: parts, work queues, worker processes that die, locks, and full memory."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import mmw.generation.pipeline
import mmw.storage.lock
from mmw.__main__ import main as mmw_main
from mmw.cli.run import main
from mmw.config import load_config
from mmw.core.temp_files import Owner, is_temporary
from mmw.generation.executors.work_queue import MAX_TRIES, WorkerLostError, WorkQueue
from mmw.generation.progress import Console
from mmw.generation.shards import Partition, Work, all_work, part_of
from mmw.generation.worker import GenerationContext, Worker
from mmw.scene.prepare import read_scenario
from mmw.scene.scene_data import SceneData
from mmw.storage.file_checks import verify
from mmw.storage.lock import exclusive_lock, writers, writing
from mmw.storage.manifest import prepare_root
from mmw.storage.store import Store
from tests.fixtures.own_world import SMALL, assert_same_files, command


@pytest.mark.parametrize("count", [1, 2, 3, 5, 40])
def test_parts_hold_everything_once(world: Path, count: int) -> None:
    work = all_work(load_config(world / "mine.yaml", SMALL))
    parts = [part_of(work, Partition(index, count)) for index in range(count)]
    assert [item for part in parts for item in part] == work
    sizes = [sum(item.frames for item in part) for part in parts]
    assert max(sizes) - min(sizes) <= max(item.frames for item in work)


@pytest.mark.parametrize("text", ["", "1", "1/1", "4/4", "-1/4", "a/b", "0/0", "1/2/3"])
def test_a_part_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="i/N"):
        Partition.parse(text)


def test_a_worker_keeps_its_scenario_and_others_help() -> None:
    queue = WorkQueue([Work(name, i, i + 1, ("sunny",)) for name, n in (("a", 4), ("b", 2)) for i in range(n)])
    assert queue.next(0).scenario == "a"  # most frames are left there
    assert queue.next(1).scenario == "b"
    assert [queue.next(0).frame_begin for _ in range(2)] == [1, 2]
    assert queue.next(1).scenario == "b"
    assert queue.next(1).scenario == "a"  # nothing of its own is left
    assert queue.next(0) is None and len(queue) == 0


def test_the_last_weathers_go_to_workers_of_their_own() -> None:
    weathers, now = ("sunny", "rainy", "foggy"), [0.0]
    work = [Work("a", i, i + 10, weathers) for i in range(0, 70, 10)]
    queue = WorkQueue(work, workers=4, clock=lambda: now[0])
    given = []
    for worker in (0, 1, 2, 3):
        given.append(queue.next(worker))  # no duration is known yet
        now[0] += 1.0
    assert [len(item.weathers) for item in given] == [3, 3, 3, 3]
    now[0] = 30.0
    given.append(queue.next(0))  # three are left, and the others are about to be idle: one each
    now[0] = 31.0
    given.append(queue.next(1))  # two are left for three
    now[0] = 32.0
    given += [queue.next(2), queue.next(3)]  # one is left; worker 3 is late, so the other two share it
    assert [len(item.weathers) for item in given[4:]] == [3, 3, 2, 1]
    assert queue.next(0) is None
    keys = [key for item in given for key in item.keys]
    assert sorted(map(str, keys)) == sorted(str(key) for item in work for key in item.keys)


def test_a_piece_is_not_divided_for_workers_that_stay_busy() -> None:
    """Two workers that started together: the first idle one runs the last piece whole."""
    now = [0.0]
    queue = WorkQueue([Work("a", i, i + 10, ("sunny", "rainy")) for i in (0, 10, 20)], 2, clock=lambda: now[0])
    first, second = queue.next(0), queue.next(1)
    now[0] = 10.0
    assert queue.next(0).weathers == ("sunny",)  # the other is about to be idle
    assert queue.next(1).weathers == ("rainy",)
    queue = WorkQueue([Work("a", i, i + 10, ("sunny", "rainy")) for i in (0, 10, 20)], 2, clock=lambda: now[0])
    assert (queue.next(0), queue.next(1)) == (first, second)
    now[0] = 20.0
    queue.requeue(1, [second], "by signal 9")
    assert queue.next(2).weathers == ("sunny", "rainy")
    assert queue.next(0).weathers == ("sunny", "rainy")  # worker 2 has just started
    assert queue.next(0) is None


def test_lost_work_comes_first_and_not_for_ever() -> None:
    queue = WorkQueue([Work("a", i, i + 1, ("sunny",)) for i in range(3)])
    for worker in range(MAX_TRIES):
        first = queue.next(worker)
        assert first.frame_begin == 0
        queue.requeue(worker, [first], "by signal 9")
    with pytest.raises(WorkerLostError, match=r"4 workers died at a, frames 0 to 0, the last by signal 9"):
        queue.requeue(9, [queue.next(9)], "by signal 9")


def test_losing_a_machine_with_all_its_workers_does_not_end_the_run() -> None:
    queue = WorkQueue([Work("a", 0, 1, ("sunny",))], workers=8)
    for worker in range(MAX_TRIES * 8):
        queue.requeue(worker, [], "on a node that is gone")
    with pytest.raises(WorkerLostError, match="25 workers died before they started, the last on a node that is gone"):
        queue.requeue(24, [], "on a node that is gone")


def test_an_executor_that_is_not_installed(
    world: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("mmw.generation.executors.ray_executor", "mmw.generation.executors.ray_cluster"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, "ray", None)
    assert main(command(world, "none", "--engine", "ray")) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and "the package ray is missing; pip install 'multimodal-wireless[ray]'" in lines[0]
    assert main(command(world, "none", "--engine", "ray", "--dry-run", "--quick")) == 0
    assert "20 frames in all on a Ray cluster" in capsys.readouterr().out
    assert main(command(world, "none", "--engine", "slurm")) == 2
    assert "must be 'local' or 'ray'" in capsys.readouterr().err


def test_workers_generate_the_same_dataset(world: Path) -> None:
    assert main(command(world, "two", "--workers", "2")) == 0
    assert_same_files(world / "single", world / "two")
    assert verify(world / "two") == []


def test_workers_read_a_scenario_once(world: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config, root = load_config(world / "mine.yaml", SMALL), world / "shared"
    meta = {"config_sha256": config.sha256(), "mmw_version": "0", "git_sha": ""}
    context = GenerationContext(config, world, Store(root), meta, threads=1)
    prepare_root(Store(root), config.identity(), config.sha256(), {}, overwrite=False)
    read: list[SceneData] = []
    monkeypatch.setattr(
        "mmw.generation.worker.read_scenario", lambda *some: read.append(read_scenario(*some)) or read[-1]
    )
    console, items = Console(), all_work(config)
    console.begin(20, 0)
    with Worker(context, "cpu", console) as one, Worker(context, "cpu", console) as other:
        one.trace(items[0])
        other.trace(items[1])
        (file,) = root.glob(".*.scene")
        assert is_temporary(file)
        one.finish()
        other.finish()
    assert len(read) == 1 and not list(root.glob(".*.scene"))
    with Worker(replace(context, owner=Owner()), "cpu", console) as later:
        later.trace(items[2])
        later.finish()
    assert len(read) == 2  # no run uses files of another


def test_parts_generate_the_same_dataset(world: Path, capsys: pytest.CaptureFixture) -> None:
    out = world / "parts"
    for index in (2, 0, 1):
        assert not (out / "_manifest.parquet").exists()
        assert main(command(world, "parts", "--workers", "1", "--shard", f"{index}/3")) == 0
        assert mmw_main(["status", str(out)]) == (0 if index == 1 else 1)
    lines = [line.split()[1] for line in capsys.readouterr().out.splitlines() if line.startswith("all ")]
    assert lines == ["8/20", "16/20", "20/20"]
    assert_same_files(world / "single", out)
    assert verify(out) == []


def test_finalize_refuses_what_is_missing(world: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(command(world, "half", "--workers", "1", "--shard", "0/2")) == 0
    assert mmw_main(["finalize", str(world / "half")]) == 1
    assert "12 frames are missing, the first of mine, frames 4 to 5" in capsys.readouterr().err
    assert mmw_main(["finalize", str(world / "half"), "--partial"]) == 0
    assert (world / "half" / "_manifest.parquet").is_file()


def test_overwriting_a_part_is_refused(world: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(command(world, "single", "--shard", "0/2", "--overwrite")) == 2
    assert "would remove the other parts" in capsys.readouterr().err


def test_two_writers_of_one_folder_are_refused(world: Path, capsys: pytest.CaptureFixture) -> None:
    out = world / "locked"
    out.mkdir()
    with writing(out, 0, 1, pytest.fail):
        code = "import sys; from mmw.run import main; sys.exit(main(sys.argv[1:]))"
        found = subprocess.run([sys.executable, "-c", code, *command(world, "locked")], capture_output=True, text=True)
        assert found.returncode == 2
        assert f"is being written by another run (process {os.getpid()} on" in found.stderr
        with pytest.raises(ValueError, match="is being written"), writing(out, 0, 2, pytest.fail):
            pass
    with writing(out, 0, 2, pytest.fail), writing(out, 1, 2, pytest.fail):
        pass


def test_a_file_system_without_locks_is_reported_and_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_locks(*_: object, **__: object) -> None:
        raise NotImplementedError("FileSystem does not appear to support flock")

    monkeypatch.setattr(mmw.storage.lock, "FileLock", no_locks)
    lines: list[str] = []
    with writing(tmp_path, 0, 1, lines.append), exclusive_lock(tmp_path, "stage-a"):
        assert writers(tmp_path) == []
    assert len(lines) == 1 and "its file system has no locks" in lines[0]


def test_a_full_memory_halves_the_batch(world: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    capture, calls = mmw.generation.pipeline.capture_frames, []

    def full(batch, frames, collected):
        capture(batch, frames, collected)  # discarded rows must leave no trace
        calls.append(len(frames))
        if len(frames) > 1:
            raise RuntimeError("Failed to allocate 123 bytes on device 'cuda:0'")

    monkeypatch.setattr(mmw.generation.pipeline, "capture_frames", full)
    assert main(command(world, "tight", "--workers", "1")) == 0
    assert "memory is full with 2 frames a launch; going on with 1" in capsys.readouterr().err
    assert calls == [2] + [1] * 10
    assert_same_files(world / "single", world / "tight")

    monkeypatch.setattr(
        mmw.generation.pipeline, "capture_frames", lambda *_: (_ for _ in ()).throw(MemoryError("no room"))
    )
    assert main(command(world, "none", "--workers", "1")) == 1
    assert "memory is full (no room)" in capsys.readouterr().err
