"""Which processor cores the workers of each of several GPUs run on, and how many threads their libraries start."""

import os
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import warp as wp

LIBRARY_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""Environment variables by which the libraries below NumPy are told how many threads to start."""


def cores() -> int:
    """Return the processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def cores_of_gpus(devices: Sequence[str]) -> Mapping[str, frozenset[int]]:
    """Return the cores that the workers of each GPU keep to; nothing where one GPU, or the system, leaves no choice.

    Threads that stay on a few cores, near their GPU, find their data in the caches: with four H200 four runs on 16
    cores each took 51 s, one run of the same work on all 64 took 57 s, when libraries still started a thread for every
    core that they saw (`bench/README.md`).

    Args:
        devices: Warp device of each worker; the same may stand there more than once.
    """
    found = [wp.get_device(name) for name in dict.fromkeys(devices)]
    if len(found) < 2 or not all(device.is_cuda for device in found) or not hasattr(os, "sched_setaffinity"):
        return {}
    shares = shared_cores(os.sched_getaffinity(0), [_near(str(device.pci_bus_id)) for device in found])
    return {device.alias: share for device, share in zip(found, shares, strict=True)}


def shared_cores(available: Collection[int], near: Sequence[Collection[int]]) -> list[frozenset[int]]:
    """Return the share of each GPU in some cores: all of them are dealt out, none twice if there are enough.

    Args:
        available: The cores.
        near: Cores near each GPU, those of its socket; empty where the system does not say. Where GPUs of a socket
            share all its cores, and every core is near one, a GPU gets some of its own; else any.
    """
    if len(available) < len(near):
        return [frozenset(available)] * len(near)
    sockets: dict[frozenset[int], list[int]] = defaultdict(list)
    for gpu, own in enumerate(near):
        sockets[frozenset(own) & frozenset(available)].append(gpu)
    is_dealt = sorted(core for own in sockets for core in own) == sorted(available)
    if not is_dealt or any(len(own) < len(gpus) for own, gpus in sockets.items()):
        sockets = defaultdict(list, {frozenset(available): list(range(len(near)))})
    shares = [frozenset[int]()] * len(near)
    for own, gpus in sockets.items():
        ordered = sorted(own)
        ends = [len(ordered) * k // len(gpus) for k in range(len(gpus) + 1)]
        for k, gpu in enumerate(gpus):
            shares[gpu] = frozenset(ordered[ends[k] : ends[k + 1]])
    return shares


def _near(bus_id: str) -> frozenset[int]:
    """Return the cores of a GPU's socket; none where the system does not say.

    Args:
        bus_id: Domain, bus and device, hexadecimal, with colons between.
    """
    domain, bus, slot = (int(part, 16) for part in bus_id.split(":"))
    try:
        # A list like 0-15,32-47: Linux, Documentation/ABI/testing/sysfs-bus-pci.
        text = Path(f"/sys/bus/pci/devices/{domain:04x}:{bus:02x}:{slot:02x}.0/local_cpulist").read_text()
    except OSError:
        return frozenset()
    return core_list(text)


def core_list(text: str) -> frozenset[int]:
    """Return the cores of a list like `0-15,32-47`, as Linux writes it."""
    spans = [[int(end) for end in span.split("-")] for span in text.strip().split(",") if span]
    return frozenset(core for span in spans for core in range(span[0], span[-1] + 1))


@contextmanager
def bound_to(own: Collection[int]) -> Iterator[None]:
    """Keep this thread to some cores within the block, and with it each process that it starts; empty for no change."""
    if not own:
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, own)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


@contextmanager
def one_thread_a_library() -> Iterator[None]:
    """Let processes that start within the block do linear algebra on the thread that asks for it.

    Workers share the cores; each would start a thread for every core, and OpenBLAS's spin for some ms after each call.
    What the user has set stays.
    """
    missing = [name for name in LIBRARY_THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(missing, "1"))
    try:
        yield
    finally:
        for name in missing:
            del os.environ[name]
