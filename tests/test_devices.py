"""How many workers, threads and cores who gets, where nobody says so."""

import math
import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import warp as wp

from mmw.compute import device
from mmw.compute.cores import bound_to, core_list, cores_of_gpus, one_thread_a_library, shared_cores
from mmw.compute.cuda import keep_memory, wait_asleep
from mmw.compute.device import workers_a_gpu, writer_threads
from mmw.engines.processes import _Process

GB = 1 << 30


@pytest.mark.parametrize(
    ("gpus", "gpu_gb", "cores", "host_gb", "expected"),
    [
        (1, 80, 16, 128, 8),
        (1, 80, 16, math.inf, 8),
        (1, 80, 8, 128, 4),
        (1, 80, 7, 128, 4),
        (1, 24, 16, 128, 3),
        (1, 7, 16, 128, 1),
        (1, 80, 16, 16, 2),
        (8, 140, 128, 560, 8),
        (8, 140, 16, 560, 1),
        (4, 140, 64, 8, 1),
    ],
)
def test_a_gpu_gets_workers_as_cores_and_memories_allow(monkeypatch, gpus, gpu_gb, cores, host_gb, expected):
    monkeypatch.setattr(device, "cores", lambda: cores)
    monkeypatch.setattr(device, "host_bytes", lambda: host_gb * GB)
    assert workers_a_gpu([SimpleNamespace(total_memory=gpu_gb * GB)] * gpus) == expected


@pytest.mark.parametrize(("cores", "workers", "expected"), [(16, 1, 16), (16, 6, 8), (2, 2, 4), (2, 1, 6)])
def test_threads_are_divided_among_the_workers(monkeypatch, cores, workers, expected):
    monkeypatch.setattr(device, "cores", lambda: cores)
    assert writer_threads("auto", workers) == expected
    assert writer_threads(5, workers) == 5


def test_the_memory_of_this_machine_is_known():
    assert device.host_bytes() > GB


SOCKETS = [{*range(8), *range(16, 24)}, {*range(8, 16), *range(24, 32)}]
"""Cores of the two sockets of a machine as Linux numbers them: second threads of all cores come last."""


@pytest.mark.parametrize(
    ("available", "near", "expected"),
    [
        (range(8), [(), ()], [range(4), range(4, 8)]),
        (range(8), [range(8), range(8), range(8)], [range(2), range(2, 5), range(5, 8)]),
        (range(32), [SOCKETS[1], SOCKETS[0]], [SOCKETS[1], SOCKETS[0]]),
        (range(32), [SOCKETS[0], SOCKETS[1]] * 2, [range(8), range(8, 16), range(16, 24), range(24, 32)]),
        # Both GPUs on one socket: the cores of the other are not left idle.
        (range(32), [SOCKETS[0], SOCKETS[0]], [range(16), range(16, 32)]),
        # A batch system left cores of one socket alone.
        (range(8), [SOCKETS[0], SOCKETS[1]], [range(4), range(4, 8)]),
        ([3, 5, 9, 10], [SOCKETS[0], SOCKETS[1]], [[3, 5], [9, 10]]),
        # Fewer cores than GPUs.
        ([4, 7], [(), (), ()], [[4, 7]] * 3),
    ],
)
def test_gpus_share_the_cores(available, near, expected):
    assert shared_cores(available, near) == [frozenset(own) for own in expected]


@pytest.mark.parametrize(("text", "expected"), [("0-3,8-9,12\n", {0, 1, 2, 3, 8, 9, 12}), ("7", {7}), ("\n", set())])
def test_a_list_of_cores_is_read(text, expected):
    assert core_list(text) == expected


def test_workers_on_processors_keep_to_no_cores():
    assert cores_of_gpus(["cpu", "cpu"]) == {}


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the system does not bind threads to cores")
def test_a_process_starts_on_the_cores_of_its_gpu():
    before = os.sched_getaffinity(0)
    ask = [sys.executable, "-c", "import os; print(*os.sched_getaffinity(0))"]
    with bound_to({max(before)}):
        told = subprocess.run(ask, capture_output=True, text=True, check=True).stdout
    assert told.split() == [str(max(before))]
    assert os.sched_getaffinity(0) == before
    with bound_to(()):
        assert os.sched_getaffinity(0) == before


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the system does not bind threads to cores")
def test_a_worker_keeps_to_its_cores():
    own = {max(os.sched_getaffinity(0))}
    worker = _Process(SimpleNamespace(), "cpu", own)
    try:
        assert os.sched_getaffinity(worker._process.pid) == own
    finally:
        worker.kill()


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="the system does not list threads")
def test_libraries_of_a_process_start_no_threads():
    ask = "import os, numpy; numpy.ones((500, 500)) @ numpy.ones((500, 500)); print(len(os.listdir('/proc/self/task')))"
    before = dict(os.environ)
    with one_thread_a_library():
        told = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True).stdout
    assert told.split() == ["1"] and dict(os.environ) == before


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="the system does not show environments")
def test_libraries_of_a_worker_start_no_threads(monkeypatch):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    worker = _Process(SimpleNamespace(), "cpu", ())
    try:
        given, deadline = b"", time.monotonic() + 10.0
        while not given and time.monotonic() < deadline:  # empty until the system has set the process up
            given = Path(f"/proc/{worker._process.pid}/environ").read_bytes()
        assert b"OPENBLAS_NUM_THREADS=1" in given.split(b"\0")
    finally:
        worker.kill()


def test_a_number_of_threads_that_the_user_has_set_stays(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    with one_thread_a_library():
        assert os.environ["OMP_NUM_THREADS"] == "3" and os.environ["OPENBLAS_NUM_THREADS"] == "1"
    assert os.environ["OMP_NUM_THREADS"] == "3"


def test_threads_can_sleep_while_they_wait(device):
    assert wait_asleep(device)


def test_freed_memory_stays_up_to_the_limit(device: str) -> None:
    keep_memory(device, 1 << 30)
    if wp.get_device(device).is_cuda:
        assert wp.get_mempool_release_threshold(device) == 1 << 30
        keep_memory(device, 0)  # as it was
