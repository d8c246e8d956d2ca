"""Choosing the device that traces."""

import os

import warp as wp

wp.config.log_level = wp.LOG_ERROR
"""Warp's own start-up lines and its note that there is no GPU say nothing that `choose_device` does not say better."""


def choose_device(name: str) -> str:
    """Return the Warp device for a configured name: `auto`, `cpu` or `cuda:N`.

    Raises:
        ValueError: If the machine has no such device; the message lists those that it has.
    """
    wp.init()
    known = [device.alias for device in wp.get_devices()]
    if name == "auto":
        return "cuda:0" if "cuda:0" in known else "cpu"
    if name == "cuda":
        name = "cuda:0"
    if name not in known:
        raise ValueError(
            f"compute.device = {name!r}: this machine has {', '.join(known)}; choose one of these, or `auto`"
        )
    return name


def worker_devices(name: str, workers: int | str) -> list[str]:
    """Return the Warp device of each worker process.

    Args:
        name: Configured device: `auto`, `cpu` or `cuda:N`.
        workers: How many, or `auto`: one a CUDA device where `name` is `auto` and there are any, one on a device that
            is named, and on the CPU, where a kernel takes one core, one a core.

    Raises:
        ValueError: If the machine has no such device.
    """
    first = choose_device(name)
    if first == "cpu":
        return ["cpu"] * (cores() if workers == "auto" else int(workers))
    devices = [device.alias for device in wp.get_cuda_devices()] if name == "auto" else [first]
    count = len(devices) if workers == "auto" else int(workers)
    return [devices[i % len(devices)] for i in range(count)]


def cores() -> int:
    """Return the processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def device_name(device: str) -> str:
    """Return the device's name for people: the GPU's, or how many processors there are."""
    found = wp.get_device(device)
    return found.name if found.is_cuda else f"CPU ({os.cpu_count()} threads)"
