"""Choose the devices and the number of workers."""

import logging
import math
import os
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from functools import cache

import warp as wp

from mmw.core.cpu_cores import cores
from mmw.core.cpu_kind import cpu_kind
from mmw.core.errors import InputError

LOGGER = logging.getLogger(__name__)

WARP_THREADS = 32
"""Threads of a warp of NVIDIA GPUs."""

FEW_PIECES = 4096
"""Most pieces of work that have a warp each: about as many as an H100 runs at once, 132 processors with 32 of these
blocks of 64 threads. Design value."""

wp.config.log_level = wp.LOG_ERROR
"""Warp's start-up lines and its note on a missing GPU are redundant: `choose_device` reports the same."""


@cache
def start_warp() -> None:
    """Initialize Warp; log what its native code prints, such as a line where there is no CUDA driver."""
    with ExitStack() as stack:
        try:
            file, shown = stack.enter_context(tempfile.TemporaryFile()), os.dup(2)
        except OSError:  # there is no room for a file, or no standard error
            wp.init()
            return
        os.dup2(file.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(shown, 2)
            os.close(shown)
            file.seek(0)
            for line in file.readlines():
                if line.startswith(b"Warp "):
                    LOGGER.info("%s", line.decode(errors="replace").strip())
                else:  # of another thread
                    os.write(2, line)


def thread_spread(device: str, count: int) -> int:
    """Return how many threads to launch for each of `count` pieces of work, of which the first does it.

    The threads of a warp wait for each other where their ways part, as those of rays do. A GPU that has room gives each
    piece a warp of its own; with many pieces, and on the CPU, each has one thread.

    Args:
        device: Warp device.
        count: Pieces of work.
    """
    return WARP_THREADS if device.startswith("cuda") and count <= FEW_PIECES else 1


def choose_device(name: str) -> str:
    """Return the Warp device for a configured name: `auto`, `cpu` or `cuda:N`.

    Raises:
        InputError: If the machine has no such device; the message lists the available ones.
    """
    start_warp()
    known = [device.alias for device in wp.get_devices()]
    if name == "auto":
        return "cuda:0" if "cuda:0" in known else "cpu"
    if name == "cuda":
        name = "cuda:0"
    if name not in known:
        raise InputError(
            f"compute.device = {name!r}: this machine has {', '.join(known)}; choose one of these, or `auto`"
        )
    return name


CORES_PER_WORKER = 2
"""Processor cores of each worker on a GPU: one for tracing, one for encoding. Measured on an H100 with 16 cores, where
eight workers are faster than six, and twelve are not faster (`bench/README.md`)."""

GPU_BYTES_PER_WORKER = 8 << 30
"""Device memory of each worker on a GPU [bytes]; the paper's sensors take 6.7 GB on an H100."""

HOST_BYTES_PER_WORKER = 6 << 30
"""Host memory of each worker on a GPU [bytes]; the paper's sensors take up to 5.7 GB."""


def worker_devices(name: str, workers: int | str) -> list[str]:
    """Return the Warp device of each worker process, in round-robin order.

    Args:
        name: Configured device: `auto`, `cpu` or `cuda:N`.
        workers: Number of workers, or `auto`: on the CPU, where a kernel uses one core, one per core; on each CUDA
            device, or on the given one, as many as cores, host memory and device memory allow.

    Raises:
        InputError: If the machine has no such device.
    """
    first = choose_device(name)
    if first == "cpu":
        return ["cpu"] * (cores() if workers == "auto" else int(workers))
    found = wp.get_cuda_devices() if name == "auto" else [wp.get_device(first)]
    count = workers_per_gpu(found) * len(found) if workers == "auto" else int(workers)
    return [found[i % len(found)].alias for i in range(count)]


def workers_per_gpu(found: Sequence[wp.Device]) -> int:
    """Return how many workers can share each GPU of this machine, at least one."""
    return workers_that_fit(len(found), cores(), host_bytes(), min(device.total_memory for device in found))


def workers_that_fit(gpu_count: int, core_count: float, host_bytes: float, gpu_bytes: float) -> int:
    """Return how many workers can share each GPU of a machine, at least one.

    Args:
        gpu_count: Number of GPUs.
        core_count: Number of processor cores.
        host_bytes: Memory of the machine [bytes].
        gpu_bytes: Memory of each GPU [bytes].
    """
    limit = min(
        math.ceil(core_count / (CORES_PER_WORKER * gpu_count)),
        host_bytes / (HOST_BYTES_PER_WORKER * gpu_count),
        gpu_bytes / GPU_BYTES_PER_WORKER,
    )
    return max(int(limit), 1)


def gpu_bytes(device: str) -> float:
    """Return the memory of a GPU [bytes]; infinite for the CPU."""
    found = wp.get_device(device)
    return float(found.total_memory) if found.is_cuda else math.inf


def host_bytes() -> float:
    """Return the memory of the machine [bytes]; infinite if unknown, as on Windows."""
    if not hasattr(os, "sysconf"):
        return math.inf
    return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))


def writer_threads(configured: int | str, workers: int) -> int:
    """Return the number of threads with which each worker of this machine encodes and writes.

    `auto` is three per core, so that some run while others wait for Python's lock or the disk. Design value.
    """
    return int(configured) if configured != "auto" else min(max(3 * cores() // workers, 4), 16)


def device_name(device: str) -> str:
    """Return a device name for people: that of the GPU, or the number of processors."""
    found = wp.get_device(device)
    return found.name if found.is_cuda else f"CPU ({os.cpu_count()} threads)"


def machine_kind(device: str) -> str:
    """Return processor and GPU kind, on which the bits of a dataset depend: poses and traffic come from the CPU."""
    found = wp.get_device(device)
    return f"{found.name} and {cpu_kind()}" if found.is_cuda else cpu_kind()
