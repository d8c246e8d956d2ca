"""How many workers and threads a machine gets, where nobody says so."""

import math
from types import SimpleNamespace

import pytest

from mmw.compute import device
from mmw.compute.device import workers_a_gpu, writer_threads

GB = 1 << 30


@pytest.mark.parametrize(
    ("gpus", "gpu_gb", "cores", "host_gb", "expected"),
    [
        (1, 80, 16, 128, 6),
        (1, 80, 16, math.inf, 6),
        (1, 80, 8, 128, 3),
        (1, 24, 16, 128, 2),
        (1, 8, 16, 128, 1),
        (1, 80, 16, 16, 2),
        (8, 140, 128, 560, 6),
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
