"""Start worker processes; on Linux by forking a server that has already imported Warp.

They never run the script of the user: it may call `mmw.generate` outside `if __name__ == "__main__"`.
"""

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from multiprocessing import spawn
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from typing import Any

from mmw.config.compute import ComputeConfig
from mmw.core.cpu_cores import single_threaded_libraries

CAN_FORK = sys.platform == "linux"
"""True if workers are forked. On other systems native libraries do not support it: each worker starts as a new
interpreter, whose imports take some seconds."""

RETRY_DELAYS_S = 0.1, 0.2, 0.4, 0.8
"""Delays before the start of a worker is tried again [s]."""

MIN_FRAMES_PER_WORKER = {"cpu": 16, "cuda": 300}
"""Scenario-weather-frames for which one more process pays off, where the number of workers is `auto`: reading a town
takes as long as some ten frames on a core, and as 200 on an H100. Design values."""


def may_use_processes(compute: ComputeConfig, frames: int) -> bool:
    """Return whether a run may need worker processes of this machine, before its devices are known."""
    if compute.workers == "auto":
        return compute.engine == "local" and frames >= 2 * min(MIN_FRAMES_PER_WORKER.values())
    return compute.engine == "local" and int(compute.workers) > 1


def start_server() -> None:
    """Start the fork server unless it is running; its imports run in parallel with this process."""
    if CAN_FORK:
        from multiprocessing import forkserver

        _context()
        with single_threaded_libraries(), _ignoring_interrupts():
            forkserver.ensure_running()


def start_process(target: Callable[..., None], *arguments: Any) -> BaseProcess:
    """Start a worker process, from a new fork server if the current one is dying; it ends with this process at latest.

    Raises:
        OSError, EOFError: If one server after the other dies.
    """
    with single_threaded_libraries():
        process = _context().Process(target=_run, args=(dict(os.environ), target, arguments), daemon=True)
        for delay_s in RETRY_DELAYS_S:
            try:
                start_server()
                _start(process)
                return process
            except (ConnectionError, EOFError):  # it was killed; it counts as running until all its threads have ended
                time.sleep(delay_s)
        _start(process)
    return process


_STARTING = threading.Lock()


def _start(process: BaseProcess) -> None:
    """Start a process that does not run this process's script.

    `multiprocessing` lets each child run it under the name `__mp_main__`, to find what it defines. Workers need
    nothing of it, and a script without a guard would call `mmw.generate` again in each.
    """
    with _STARTING:
        whole, starter = spawn.get_preparation_data, threading.get_ident()

        def without_script(name: str) -> dict[str, Any]:
            data = whole(name)
            if threading.get_ident() != starter:  # a process of the user's own
                return data
            return {key: value for key, value in data.items() if not key.startswith("init_main_from_")}

        spawn.get_preparation_data = without_script
        try:
            process.start()
        finally:
            spawn.get_preparation_data = whole


def _context() -> BaseContext:
    if not CAN_FORK:
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["mmw.generation.executors.preload"])
    return context


def _run(environment: Mapping[str, str], target: Callable[..., None], arguments: tuple[Any, ...]) -> None:
    """Call a function in a worker process, with an environment in place of the fork server's, which may be older."""
    os.environ.clear()
    os.environ.update(environment)
    target(*arguments)


@contextmanager
def _ignoring_interrupts() -> Iterator[None]:
    """Let a process that starts within the block ignore Ctrl-C, which a terminal sends to all of its processes."""
    if threading.current_thread() is not threading.main_thread():  # only the main thread may set signal handlers
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
