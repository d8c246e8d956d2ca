"""Default numbers of workers, threads and cores."""

import logging
import math
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import warp as wp

from mmw.core import device
from mmw.core.cpu_cores import single_threaded_libraries
from mmw.core.cuda import retain_memory, use_blocking_sync
from mmw.core.device import FEW_PIECES, start_warp, thread_spread, workers_per_gpu, writer_threads

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
    assert device.host_bytes() > GB  # of this machine
    monkeypatch.setattr(device, "cores", lambda: cores)
    monkeypatch.setattr(device, "host_bytes", lambda: host_gb * GB)
    assert workers_per_gpu([SimpleNamespace(total_memory=gpu_gb * GB)] * gpus) == expected


@pytest.mark.parametrize(("cores", "workers", "expected"), [(16, 1, 16), (16, 6, 8), (2, 2, 4), (2, 1, 6)])
def test_threads_are_divided_among_the_workers(monkeypatch, cores, workers, expected):
    monkeypatch.setattr(device, "cores", lambda: cores)
    assert writer_threads("auto", workers) == expected
    assert writer_threads(5, workers) == 5


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="the system does not list threads")
def test_libraries_of_a_process_start_no_threads():
    ask = "import os, numpy; numpy.ones((500, 500)) @ numpy.ones((500, 500)); print(len(os.listdir('/proc/self/task')))"
    before = dict(os.environ)
    with single_threaded_libraries():
        told = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True).stdout
    assert told.split() == ["1"] and dict(os.environ) == before


def test_a_number_of_threads_that_the_user_has_set_stays(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    with single_threaded_libraries():
        assert os.environ["OMP_NUM_THREADS"] == "3" and os.environ["OPENBLAS_NUM_THREADS"] == "1"
    assert os.environ["OMP_NUM_THREADS"] == "3"


def test_threads_can_sleep_and_freed_memory_stays_up_to_the_limit(device: str) -> None:
    assert use_blocking_sync(device)
    retain_memory(device, 1 << 30)
    if wp.get_device(device).is_cuda:
        assert wp.get_mempool_release_threshold(device) == 1 << 30
        retain_memory(device, 0)  # as it was


def test_warp_starts_without_a_word() -> None:
    """Its native code prints a line where there is no driver."""
    code = "from mmw.core.device import choose_device; print(choose_device('cpu'))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("cpu\n", "")


def test_lines_of_warp_are_logged_and_those_of_others_printed(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    def init() -> None:
        os.write(2, b"Warp CUDA warning: none\nanother thread\n")
        raise RuntimeError("no Warp")

    monkeypatch.setattr(wp, "init", init)
    with caplog.at_level(logging.INFO, "mmw"), pytest.raises(RuntimeError, match="no Warp"):
        start_warp.__wrapped__()
    os.write(2, b"later\n")
    assert capfd.readouterr().err == "another thread\nlater\n"
    assert [record.getMessage() for record in caplog.records] == ["Warp CUDA warning: none"]


@pytest.mark.parametrize(
    ("name", "count", "threads"),
    [("cpu", 1, 1), ("cuda:0", 1, 32), ("cuda:1", FEW_PIECES, 32), ("cuda:0", FEW_PIECES + 1, 1)],
)
def test_few_pieces_of_work_have_a_warp_each(name: str, count: int, threads: int) -> None:
    assert thread_spread(name, count) == threads
