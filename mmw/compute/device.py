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


def device_name(device: str) -> str:
    """Return the device's name for people: the GPU's, or how many processors there are."""
    found = wp.get_device(device)
    return found.name if found.is_cuda else f"CPU ({os.cpu_count()} threads)"
