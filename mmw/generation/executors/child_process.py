"""Run a function in a process of this machine with a connection to it; it ends with this one, whatever ends it."""

import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from typing import Any

from mmw.generation.executors.process_pool import start_process


class WorkerDiedError(Exception):
    """Report that a worker died; the text gives the cause."""


class ChildProcess:
    """A process and the connection to it."""

    def __init__(self, target: Callable[..., None], *arguments: Any) -> None:
        """Start the process.

        Args:
            target: Called there with its end of the connection and the arguments; the process ends when it returns.
            arguments: Picklable.
        """
        self.connection, child_end = Pipe()
        lifeline, self._lifeline = Pipe(duplex=False)
        self._process = start_process(_run, child_end, lifeline, target, arguments)
        child_end.close()
        lifeline.close()

    @property
    def pid(self) -> int | None:
        """Number of the process."""
        return self._process.pid

    def send(self, message: Any) -> None:
        """Send a picklable object; a process that has died does not get it."""
        with suppress(BrokenPipeError):  # the next call of `receive` reports that it died
            self.connection.send(message)

    def receive(self) -> Any:
        """Return the next object that the process sends.

        Raises:
            WorkerDiedError: If the process died.
        """
        try:
            message = self.connection.recv_bytes()
        except (EOFError, ConnectionError):  # the other end is closed
            self._process.join()
            code = self._process.exitcode
            cause = f"by signal {-code}" if code is not None and code < 0 else f"with exit code {code}"
            raise WorkerDiedError(cause) from None
        return pickle.loads(message)  # what an object raises here is no death

    def close(self) -> None:
        """Wait until the process ends, and clean up."""
        self._process.join()
        self.connection.close()
        self._lifeline.close()

    def kill(self) -> None:
        """Kill the process and clean up."""
        self._process.kill()
        self.close()


def _run(connection: Connection, lifeline: Connection, target: Callable[..., None], arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C
    threading.Thread(target=_exit_with_parent, args=(lifeline,), daemon=True).start()
    target(connection, *arguments)


def _exit_with_parent(lifeline: Connection) -> None:
    with suppress(EOFError, OSError):
        lifeline.recv()
    os._exit(1)


def picklable_error(error: Exception) -> Exception:
    """Return an error that can be sent to another process, with its stack trace as a note."""
    error.add_note("in a worker process:\n" + "".join(traceback.format_exception(error)))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # the error class of a library may fail in any way when it is copied
        copied = RuntimeError(f"{type(error).__name__}: {error}")
        copied.__notes__ = error.__notes__
        return copied
    return error
