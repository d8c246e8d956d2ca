"""Fork server of the worker processes: their environment, and the death of the server."""

import logging
import os
import signal
import subprocess
import sys
import threading
from multiprocessing import spawn
from pathlib import Path
from types import SimpleNamespace
from typing import NoReturn

import pytest

from mmw.config.compute import ComputeConfig
from mmw.generation.executors.child_process import WorkerDiedError
from mmw.generation.executors.local_processes import _WorkerProcess
from mmw.generation.executors.process_pool import CAN_FORK, _start, may_use_processes, start_server
from mmw.generation.executors.worker_protocol import FAILED

on_linux = pytest.mark.skipif(not CAN_FORK, reason="workers are not forked here")


class ReportingContext:
    """`GenerationContext` whose error reports a worker's environment variables and its parent process."""

    log_level = logging.WARNING

    @property
    def root(self) -> NoReturn:
        raise ValueError(f"{os.environ.get('MMW_TEST_WORD')} {os.environ['OPENBLAS_NUM_THREADS']} {os.getppid()}")


def report() -> list[str]:
    """Start a worker and return the words of its report."""
    worker = _WorkerProcess(ReportingContext(), "cpu")
    try:
        ((kind, error),) = worker.receive()
        assert kind == FAILED
        return str(error).split()
    finally:
        worker.kill()


def test_a_worker_has_the_environment_of_its_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    assert report()[:2] == ["None", "1"]
    monkeypatch.setenv("MMW_TEST_WORD", "later")
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    assert report()[:2] == ["later", "2"]


@on_linux
def test_workers_are_forked_from_one_server_and_from_another_if_it_dies(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    server = report()[2]
    assert report()[2] == server != str(os.getpid())
    os.kill(int(server), signal.SIGKILL)
    other = report()[2]
    assert other not in (server, str(os.getpid()))
    assert b"OPENBLAS_NUM_THREADS=1" in Path(f"/proc/{other}/environ").read_bytes().split(b"\0")


@on_linux
def test_a_worker_outlives_its_server() -> None:
    worker = _WorkerProcess(SimpleNamespace(log_level=logging.WARNING), "cpu")
    other = _WorkerProcess(SimpleNamespace(log_level=logging.WARNING), "cpu")
    os.kill(int(report()[2]), signal.SIGKILL)
    try:
        ((kind, _),) = worker.receive()  # its error: the context is empty
        assert kind == FAILED
        other.receive()
        with pytest.raises(WorkerDiedError, match="exit code"):
            other.receive()
    finally:
        worker.kill()
        other.kill()


def servers() -> list[int]:
    """Return the running fork servers of this process."""
    found = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    return [int(child) for child in found if b"forkserver" in Path(f"/proc/{child}/cmdline").read_bytes()]


@on_linux
def test_ctrl_c_leaves_a_server_alone_that_still_imports() -> None:
    old = int(report()[2])
    os.kill(old, signal.SIGKILL)
    while not (new := [server for server in servers() if server != old]):
        start_server()  # does nothing until all threads of the killed one have ended
    os.kill(new[0], signal.SIGINT)
    assert report()[2] == str(new[0])


@on_linux
def test_the_server_has_no_gpu_and_no_thread_of_a_library() -> None:
    """CUDA does not survive a fork, nor do threads."""
    code = (
        "import os, mmw.generation.executors.preload\n"
        "maps = open('/proc/self/maps').read()\n"
        "tasks = [open(f'/proc/self/task/{task}/comm').read().strip() for task in os.listdir('/proc/self/task')]\n"
        "print('warp.so' in maps, 'libcuda' in maps, *sorted(tasks))\n"
    )
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    warp, cuda, *threads = done.stdout.split()
    # jemalloc, which pyarrow brings, starts its thread again after a fork (jemalloc's background_thread.c).
    assert (warp, cuda) == ("False", "False") and set(threads) <= {Path(sys.executable).name[:15], "jemalloc_bg_thd"}
    assert len(threads) <= 2


def test_the_server_is_not_started_for_a_run_of_one_worker() -> None:
    assert not may_use_processes(ComputeConfig(), 31) and may_use_processes(ComputeConfig(), 32)
    assert not may_use_processes(ComputeConfig(workers=1), 1000) and may_use_processes(ComputeConfig(workers=2), 1)
    assert not may_use_processes(ComputeConfig(engine="ray"), 1000)


def test_a_worker_does_not_run_the_script_of_its_parent(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "from mmw.generation.executors.process_pool import start_process\n"
        "print('script', __name__, flush=True)\n"
        "start_process(print, 'worker').join()\n"
    )
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("script __main__\nworker\n", "")


def test_processes_of_the_users_own_run_the_script(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that another thread starts at the same moment, and later ones."""
    monkeypatch.setattr(sys.modules["__main__"], "__spec__", None)
    monkeypatch.setattr(sys.modules["__main__"], "__file__", "/script.py", raising=False)
    found = {}

    def prepare(name: str) -> None:
        found[name] = spawn.get_preparation_data(name).get("init_main_from_path")

    def start() -> None:
        prepare("worker")
        other = threading.Thread(target=prepare, args=("other",))
        other.start()
        other.join()

    _start(SimpleNamespace(start=start))
    prepare("later")
    assert found == {"worker": None, "other": "/script.py", "later": "/script.py"}
