"""Run work in several processes of this machine, which end with their parent, whatever ends it."""

import os
import signal
import threading
from collections.abc import Iterable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe, wait

from mmw.generation.executors.process_pool import start_process
from mmw.generation.executors.supervisor import Supervisor, WorkerDiedError
from mmw.generation.executors.worker_protocol import Message, serve
from mmw.generation.progress import Console
from mmw.generation.shards import Work
from mmw.generation.worker import GenerationContext


def run_in_processes(
    context: GenerationContext, work: Sequence[Work], devices: Sequence[str], console: Console
) -> None:
    """Generate all work; see `Supervisor.run` for errors."""
    Supervisor(context, work, devices, console, _WorkerProcess, _wait).run()


class _WorkerProcess:
    """One worker process and the connection to it; see `WorkerConnection`."""

    def __init__(self, context: GenerationContext, device: str):
        self.connection, worker_end = Pipe()
        lifeline, self._lifeline = Pipe(duplex=False)
        self._process = start_process(_serve, worker_end, lifeline, context, device)
        worker_end.close()
        lifeline.close()

    def receive(self) -> Iterable[Message]:
        try:
            return [self.connection.recv()]
        except (EOFError, OSError):
            self._process.join()
            code = self._process.exitcode
            cause = f"by signal {-code}" if code is not None and code < 0 else f"with exit code {code}"
            raise WorkerDiedError(cause) from None

    def send(self, work: Work | None) -> None:
        with suppress(BrokenPipeError):  # the next call of `receive` reports that it died
            self.connection.send(work)

    def close(self) -> None:
        self._process.join()
        self.connection.close()
        self._lifeline.close()

    def kill(self) -> None:
        self._process.kill()
        self.close()


def _wait(workers: list[_WorkerProcess]) -> list[_WorkerProcess]:
    ready = wait([worker.connection for worker in workers])
    return [worker for worker in workers if worker.connection in ready]


def _serve(connection: Connection, lifeline: Connection, context: GenerationContext, device: str) -> None:
    """Run a worker in this process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C
    threading.Thread(target=_exit_with_parent, args=(lifeline,), daemon=True).start()
    serve(context, device, connection.recv, connection.send)


def _exit_with_parent(lifeline: Connection) -> None:
    with suppress(EOFError, OSError):
        lifeline.recv()
    os._exit(1)
