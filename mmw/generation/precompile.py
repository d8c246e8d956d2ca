"""Begin what a configuration certainly needs while its first scene is prepared and read: kernels, skies.

Warp compiles a module at the first launch of one of its kernels, which takes a CPU 1 to 10 s each. Its compilers run
outside Python's lock and make the same object whichever thread or process calls them, so threads compile different
modules, and processes divide them: the others load a compiled module from Warp's cache.
"""

import os
import threading
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

import warp as wp
from filelock import Timeout

from mmw.config import Config
from mmw.config.sensor_spec import spec_of
from mmw.core.bvh_kind import select_bvh
from mmw.core.registry import load_reference
from mmw.storage.lock import exclusive_lock

MAX_THREADS = 4
"""Threads of a worker that compile at most; each takes about 0.5 GB. Design value."""

BLOCKS = {"lidar.returns": (256, 64)} | dict.fromkeys(
    (
        "camera.depth", "camera.image_samples", "camera.visibility", "channel.image_method", "core.line_of_sight",
        "core.trace", "lidar.trace", "radar.bounce_paths", "radar.trace", "shading.reflections", "shading.shadows",
    ),
    (64,),
)  # fmt: skip
"""Module -> threads of a block in its launches, where it is not 256 alone; on a GPU each is compiled by itself."""

HOST_MODULES = ("core.bodies", "core.body_motion")
"""Modules that every run launches on the host, also with a GPU."""

CHANNEL_ON_HOST = (
    "channel.path_order", "channel.link_order", "core.mounted_antennas", "channel.path_transfer",
    "channel.path_geometry", "channel.antenna_field", "channel.path_names",
)  # fmt: skip
"""Modules that runs with a channel launch on the host, also with a GPU."""

SENSORS_ON_HOST = frozenset(
    ("core.random_series", "navigation.gnss", "navigation.imu", "radar.estimates", "radar.thresholds")
)
"""Modules of sensors that are launched on the host, also with a GPU."""

POLL_S = 0.1
"""Time between two looks at whether another worker has compiled a module [s]."""


def warm_up(config: Config, pool: ThreadPoolExecutor) -> list[Future[None]]:
    """Begin the slow work of sensors that needs no scene, such as skies, in threads."""
    ahead = dict.fromkeys(spec_of(sensor).warm_up for sensor in config.sensors)
    return [pool.submit(load_reference(work), config) for work in ahead if work]


def needed_modules(config: Config, *, on_gpu: bool = True) -> list[str]:
    """Return the modules of `mmw.kernels` that every run of a configuration launches, the slowest to compile first.

    Warp compiles modules that only some weathers, materials or options need when they are launched.
    """
    modules: dict[str, float] = {"core.trace": 5, "core.line_of_sight": 2, "core.instance_bounds": 0}
    for sensor in config.sensors:
        modules.update(spec_of(sensor).kernels(sensor, on_gpu))
    if config.channel.enabled:
        modules |= {"channel.image_method": 7, "channel.reflection_candidates": 2}
    return sorted(modules, key=lambda name: -modules[name])  # seconds that the CPU compiler takes


@contextmanager
def compiled_ahead(config: Config, device: str) -> Iterator[list[Future[None]]]:
    """Compile and load the kernels of a configuration in threads; wait for the futures before a launch.

    Yields:
        One future a thread.

    Raises:
        InputError: If this process has built BVHs of another kind than the configuration's `compute.bvh`.
    """
    select_bvh(config.compute.bvh)  # each kind has its own kernels
    is_cpu = wp.get_device(device).is_cpu
    waiting: deque[tuple[str, int | None, str]] = deque(
        (name, block, device)
        for name in needed_modules(config, on_gpu=not is_cpu)
        if name not in SENSORS_ON_HOST
        for block in ((None,) if is_cpu else BLOCKS.get(name, (256,)))
    )
    on_host = [name for name in needed_modules(config, on_gpu=not is_cpu) if name in SENSORS_ON_HOST]
    on_host += CHANNEL_ON_HOST if config.channel.enabled else ()
    waiting += [(name, None, "cpu") for name in (*HOST_MODULES, *on_host)]
    ended = threading.Event()
    pool = ThreadPoolExecutor(min(os.cpu_count() or 1, MAX_THREADS), thread_name_prefix="mmw-compiler")
    try:
        opened = pool.submit(_open, device)
        yield [pool.submit(_compile, waiting, opened, ended) for _ in range(MAX_THREADS)]
    finally:
        ended.set()
        pool.shutdown(wait=True, cancel_futures=True)


def kernel_cache() -> Path:
    """Return the folder of Warp's compiled modules."""
    wp.init()
    return Path(wp.config.kernel_cache_dir)


def lock_name(module: str, block: int | None) -> str:
    """Return the name of the lock for compiling a module with some block size, None for a CPU."""
    return f"{module}-{block or 'cpu'}"


def _open(device: str) -> None:
    """Create a GPU's context once; Warp would create it twice for two threads.

    A machine creates the contexts of all processes one after the other, 0.12 s each on H200s.
    """
    found = wp.get_device(device)
    if found.is_cuda:
        found.make_current()


_PARSING = threading.Lock()
"""Held while a module of kernels is imported: Warp parses its source, and CPython's `ast.parse` in two threads at once
may end in a SystemError (CPython issue 106905)."""


def _compile(waiting: deque[tuple[str, int | None, str]], opened: Future[None], ended: threading.Event) -> None:
    """Compile and load waiting modules; one that another worker is compiling goes to the end of the queue.

    No module is begun once `ended` is set. Emptying the queue would not do: a module that a thread has just taken goes
    back to it.
    """
    opened.result()
    while not ended.is_set():
        try:
            name, block, device = waiting.popleft()
        except IndexError:
            return
        try:
            with exclusive_lock(kernel_cache(), lock_name(name, block), timeout_s=0.0):
                with _PARSING:
                    module = import_module(f"mmw.kernels.{name}")
                wp.load_module(module, device=device, block_dim=block, max_workers=0)
        except Timeout:
            waiting.append((name, block, device))
            ended.wait(POLL_S)
