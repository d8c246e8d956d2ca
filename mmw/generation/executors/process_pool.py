"""Start worker processes; on Linux by forking a server that has already imported Warp."""

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from typing import Any

from mmw.config.compute import ComputeConfig
from mmw.core.cpu_cores import one_thread_a_library

CAN_FORK = sys.platform == "linux"
"""Elsewhere libraries of the system do not survive it: each worker starts as a new interpreter, which imports for some
seconds."""

PAUSES_S = 0.1, 0.2, 0.4, 0.8
"""Waits before the start of a worker is tried again [s]."""

FRAMES_A_WORKER = {"cpu": 16, "cuda": 300}
"""Scenario-weather-frames from which on another process is worth it, where nobody says how many: reading a town takes
as long as some ten frames on a core, and as 200 on an H100. Design values."""


def may_be_several(compute: ComputeConfig, frames: int) -> bool:
    """Return whether a run may need worker processes of this machine, before its devices are known.

    Args:
        compute: How it is to be made.
        frames: Scenario-weather-frames of the dataset.
    """
    if compute.workers == "auto":
        return compute.engine == "local" and frames >= 2 * min(FRAMES_A_WORKER.values())
    return compute.engine == "local" and int(compute.workers) > 1


def import_ahead() -> None:
    """Start the server unless it runs; it imports while this process goes on."""
    if CAN_FORK:
        from multiprocessing import forkserver

        _context()
        with one_thread_a_library(), _not_interrupted():
            forkserver.ensure_running()


def start(target: Callable[..., None], *arguments: Any) -> BaseProcess:
    """Start a worker process, by another server if the one that runs is dying; it ends with this process at the latest.

    Args:
        target: What it does. It finds this process's environment, and one thread a library.
        arguments: For `target`.

    Raises:
        OSError, EOFError: If servers die again and again.
    """
    with one_thread_a_library():
        process = _context().Process(target=_run, args=(dict(os.environ), target, arguments), daemon=True)
        for pause_s in PAUSES_S:
            try:
                import_ahead()
                process.start()
                return process
            except (ConnectionError, EOFError):  # it was killed; until all its threads have gone, it counts as running
                time.sleep(pause_s)
        process.start()
    return process


def _context() -> BaseContext:
    if not CAN_FORK:
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["mmw.generation.executors.local_processes"])
    return context


def _run(environment: Mapping[str, str], target: Callable[..., None], arguments: tuple[Any, ...]) -> None:
    """Body of a worker process. A server has the environment of its own start, perhaps that of an earlier run."""
    os.environ.clear()
    os.environ.update(environment)
    target(*arguments)


@contextmanager
def _not_interrupted() -> Iterator[None]:
    """Let a process that starts within the block ignore Ctrl-C, which goes to all of a terminal's processes."""
    if threading.current_thread() is not threading.main_thread():  # only that one may say so
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
