"""Runs whose processes are killed, again and again, until the dataset is complete."""

import contextlib
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from mmw.storage.file_checks import verify
from tests.fixtures.own_world import assert_same_files, command

KILL_ROUNDS = int(os.environ.get("MMW_KILL_ROUNDS", "1"))
"""Datasets that are generated while processes are killed."""


def children(process: int) -> list[int]:
    """Return the worker processes of a run and their fork server, without the resource tracker."""
    found = []
    with contextlib.suppress(OSError):
        for child in map(int, Path(f"/proc/{process}/task/{process}/children").read_text().split()):
            if b"forkserver" in Path(f"/proc/{child}/cmdline").read_bytes():
                found += [child, *children(child)]
    return found


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="finds processes in /proc")
@pytest.mark.parametrize("seed", range(KILL_ROUNDS))
def test_killed_workers_and_runs_leave_nothing_wrong(world: Path, seed: int) -> None:
    """Workers and the run itself are killed, after some more shards each time, until the dataset is complete."""
    random_s, out, kills, longest_s = random.Random(seed), world / f"killed-{seed}", 0, 1.0
    for _ in range(30):
        run = subprocess.Popen(
            [sys.executable, "-m", "mmw.run", *command(world, out.name, "--workers", "2")],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        victim = 0
        while run.poll() is None and victim != run.pid:
            wanted = len(list(out.rglob("_shards/*.json"))) + random_s.randint(0, 3)
            while run.poll() is None and len(list(out.rglob("_shards/*.json"))) < wanted:
                time.sleep(0.05)
            time.sleep(random_s.uniform(0.0, longest_s))
            if run.poll() is None:
                workers = children(run.pid)
                victim = random_s.choice([run.pid, *workers, *workers])
                with contextlib.suppress(ProcessLookupError):
                    os.kill(victim, signal.SIGKILL)
                    kills += 1
        errors = run.communicate()[1]
        for path in out.rglob("part-*.parquet"):
            pq.ParquetFile(path)  # every file under its final name is complete
        if run.returncode == 0 and kills:
            break
        if run.returncode == 0:  # a fast machine finished before the first kill
            shutil.rmtree(out)
            longest_s /= 2
        else:
            assert run.returncode in (1, -signal.SIGKILL), errors
    assert run.returncode == 0 and kills > 0
    print(f"{kills} kills")
    assert_same_files(world / "single", out)
    assert [finding for finding in verify(out) if finding.is_error] == []
