"""Work in several processes of this machine, one a device or a core; they end with their parent, however that ends."""

import os
import signal
import threading
from collections.abc import Iterable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe, wait

from mmw.generation.executors.process_pool import start
from mmw.generation.executors.supervisor import LostError, Supervisor
from mmw.generation.executors.worker_protocol import Message, serve
from mmw.generation.progress import Console
from mmw.generation.shards import Work
from mmw.generation.worker import GenerationContext


def make_in_processes(
    making: GenerationContext, work: Sequence[Work], devices: Sequence[str], console: Console
) -> None:
    """Make all work; see `Supervisor.run` for errors.

    Args:
        making: What is made.
        work: The work.
        devices: Device of each worker; the same may stand there more than once.
        console: Where progress goes.
    """
    Supervisor(making, work, devices, console, _Process, _wait).run()


class _Process:
    """One worker process and the connection to it."""

    def __init__(self, making: GenerationContext, device: str):
        self.connection, there = Pipe()
        ends, self._lifeline = Pipe(duplex=False)
        self._process = start(_serve, there, ends, making, device)
        there.close()
        ends.close()

    def receive(self) -> Iterable[Message]:
        try:
            return [self.connection.recv()]
        except (EOFError, OSError):
            self._process.join()
            code = self._process.exitcode
            cause = f"by signal {-code}" if code is not None and code < 0 else f"with exit code {code}"
            raise LostError(cause) from None

    def send(self, work: Work | None) -> None:
        with suppress(BrokenPipeError):  # then the next message is that it died
            self.connection.send(work)

    def close(self) -> None:
        self._process.join()
        self.connection.close()
        self._lifeline.close()

    def kill(self) -> None:
        self._process.kill()
        self.close()


def _wait(links: list[_Process]) -> list[_Process]:
    ready = wait([link.connection for link in links])
    return [link for link in links if link.connection in ready]


def _serve(connection: Connection, lifeline: Connection, making: GenerationContext, device: str) -> None:
    """Body of a worker process.

    Args:
        connection: To the parent.
        lifeline: Never sends; it closes when the parent ends.
        making: What is made.
        device: Warp device name.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what Ctrl-C means
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()
    serve(making, device, connection.recv, connection.send)


def _end_with(lifeline: Connection) -> None:
    with suppress(EOFError, OSError):
        lifeline.recv()
    os._exit(1)
