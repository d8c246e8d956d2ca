"""Kernels that a configuration surely needs, compiled by threads while its first scene is made and read.

Warp compiles a module at the first launch of one of its kernels, which takes a CPU 1 to 10 s each. Its compiler runs
outside Python's lock and makes the same object whichever thread calls it.
"""

import os
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from importlib import import_module

import warp as wp

from mmw.config import Config, DepthConfig, LidarConfig, RadarConfig, RgbConfig

MOST_THREADS = 4
"""Threads that compile at most; each takes about 0.5 GB. Design value."""


def needed_modules(config: Config) -> list[str]:
    """Return the modules of `mmw.kernels` that every run of a configuration launches, the slowest to compile first.

    What only some weathers, materials or options need is left out; Warp compiles it when it is launched.
    """
    sensors, modules = config.sensors, {"trace": 5, "sight": 2, "bounds": 0}
    has_rgb = any(isinstance(sensor, RgbConfig) for sensor in sensors)
    if has_rgb or any(isinstance(sensor, DepthConfig) for sensor in sensors):
        modules |= {"visibility": 7, "candidates": 1, "depth": 1, "boxes_2d": 0}
    if has_rgb:
        modules |= {"mirror": 10, "shade": 7, "lighting": 5, "surfaces": 4, "light_filter": 2, "develop": 1,
                    "clouds": 1, "picture": 1}  # fmt: skip
    if any(isinstance(sensor, LidarConfig) for sensor in sensors):
        modules |= {"lidar": 4, "lidar_returns": 2}
    if any(isinstance(sensor, RadarConfig) for sensor in sensors):
        modules |= {"radar": 3}
    if any(isinstance(sensor, RadarConfig) and _needs_cells(sensor) for sensor in sensors):
        modules |= {"radar_cells": 1, "radar_detection": 1}
    if config.channel.enabled:
        modules |= {"channel_refine": 7, "channel_chains": 2}
    return sorted(modules, key=lambda name: -modules[name])  # seconds that the CPU compiler takes


def _needs_cells(sensor: RadarConfig) -> bool:
    return sensor.mode == "physical" and sensor.output == "detections"


@contextmanager
def compiled_ahead(config: Config, device: str) -> Iterator[list[Future[None]]]:
    """Compile and load the kernels of a configuration in threads; who is about to launch them waits for the futures.

    Only for a CPU: on a GPU a module is compiled once for each block size, which its launches say.

    Args:
        config: The configuration.
        device: Warp device name.

    Yields:
        One future a module; none on a GPU.
    """
    if not wp.get_device(device).is_cpu:
        yield []
        return
    threads = min(os.cpu_count() or 1, MOST_THREADS)
    modules = [import_module(f"mmw.kernels.{name}") for name in needed_modules(config)]
    pool = ThreadPoolExecutor(threads, thread_name_prefix="mmw-compiler")
    try:
        yield [pool.submit(wp.load_module, module, device=device, max_workers=0) for module in modules]
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
