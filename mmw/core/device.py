"""Choosing the device that traces."""

import math
import os
from collections.abc import Sequence

import warp as wp

from mmw.core.cpu_cores import cores
from mmw.core.cpu_kind import cpu_kind
from mmw.core.errors import InputError

wp.config.log_level = wp.LOG_ERROR
"""Warp's own start-up lines and its note that there is no GPU say nothing that `choose_device` does not say better."""


def choose_device(name: str) -> str:
    """Return the Warp device for a configured name: `auto`, `cpu` or `cuda:N`.

    Raises:
        InputError: If the machine has no such device; the message lists those that it has.
    """
    wp.init()
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


CORES_A_WORKER = 2
"""Processor cores for each worker on a GPU: it traces with one and encodes with another. Measured on an H100 with 16
cores, which eight workers keep busier than six, and twelve no better (`bench/README.md`)."""

GPU_BYTES_A_WORKER = 8 << 30
"""Device memory for each worker on a GPU [bytes]; the paper's sensors take 6.7 GB on an H100."""

HOST_BYTES_A_WORKER = 6 << 30
"""Memory of the machine for each worker on a GPU [bytes]; the paper's sensors take up to 5.7 GB."""


def worker_devices(name: str, workers: int | str) -> list[str]:
    """Return the Warp device of each worker process, the devices in turn.

    Args:
        name: Configured device: `auto`, `cpu` or `cuda:N`.
        workers: How many, or `auto`: on the CPU, where a kernel takes one core, one a core; on each of the CUDA
            devices, or on the one that is named, as many as the machine's cores and both memories allow.

    Raises:
        InputError: If the machine has no such device.
    """
    first = choose_device(name)
    if first == "cpu":
        return ["cpu"] * (cores() if workers == "auto" else int(workers))
    found = wp.get_cuda_devices() if name == "auto" else [wp.get_device(first)]
    count = workers_a_gpu(found) * len(found) if workers == "auto" else int(workers)
    return [found[i % len(found)].alias for i in range(count)]


def workers_a_gpu(found: Sequence[wp.Device]) -> int:
    """Return how many workers each of the machine's GPUs can have, at least one."""
    return workers_that_fit(len(found), cores(), host_bytes(), min(device.total_memory for device in found))


def workers_that_fit(gpu_count: int, core_count: float, host_bytes: float, gpu_bytes: float) -> int:
    """Return how many workers each GPU of a machine can have, at least one.

    Args:
        gpu_count: GPUs of the machine.
        core_count: Its processor cores.
        host_bytes: Its memory [bytes].
        gpu_bytes: Memory of each GPU [bytes].
    """
    most = min(
        math.ceil(core_count / (CORES_A_WORKER * gpu_count)),
        host_bytes / (HOST_BYTES_A_WORKER * gpu_count),
        gpu_bytes / GPU_BYTES_A_WORKER,
    )
    return max(int(most), 1)


def gpu_bytes(device: str) -> float:
    """Return the memory of a GPU [bytes]; infinite for the CPU, which has none of its own."""
    found = wp.get_device(device)
    return float(found.total_memory) if found.is_cuda else math.inf


def host_bytes() -> float:
    """Return the memory of the machine [bytes]; infinite where the system does not say, as on Windows."""
    if not hasattr(os, "sysconf"):
        return math.inf
    return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))


def writer_threads(configured: int | str, workers: int) -> int:
    """Return the threads of each of some workers of this machine that encode and write.

    `auto` is three for each core, so that some work while others wait for Python's lock or the disk. Design value.
    """
    return int(configured) if configured != "auto" else min(max(3 * cores() // workers, 4), 16)


def device_name(device: str) -> str:
    """Return the device's name for people: the GPU's, or how many processors there are."""
    found = wp.get_device(device)
    return found.name if found.is_cuda else f"CPU ({os.cpu_count()} threads)"


def machine_kind(device: str) -> str:
    """Return what the bits of a dataset depend on: the processor, which makes poses and traffic, and the GPU if any."""
    found = wp.get_device(device)
    return f"{found.name} and {cpu_kind()}" if found.is_cuda else cpu_kind()
