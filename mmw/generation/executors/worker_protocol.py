"""Messages between a worker and the run, and the worker's side of them: receive work, run it, report progress."""

import faulthandler
import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from logging.handlers import QueueHandler
from types import SimpleNamespace
from typing import Any

from mmw.core.temp_files import owned
from mmw.core.timing import StageTimer
from mmw.generation.executors.child_process import picklable_error
from mmw.generation.shards import Work
from mmw.generation.worker import GenerationContext, Worker

READY, TRACED, NOTE, LOG, ENDED, FAILED = "ready", "traced", "note", "log", "ended", "failed"
"""Kinds of messages of a worker: ready for work; frames, scenario and times; one line of text; a log record; its last
times; its error."""

LOGGER = logging.getLogger(__name__)

Message = tuple[Any, ...]
"""A kind and its content, picklable."""


@contextmanager
def _logging_to(send: Callable[[Message], None], level: int) -> Iterator[None]:
    """Send the log records of this process as messages while the block runs."""
    queue = SimpleNamespace(put_nowait=lambda record: send((LOG, record)))  # records are picklable there
    root, handler = logging.getLogger("mmw"), QueueHandler(queue)
    before = root.level
    root.addHandler(handler)
    root.setLevel(level)
    try:
        yield
    finally:
        root.removeHandler(handler)
        root.setLevel(before)


class MessageReporter:
    """`Reporter` of a worker that sends messages."""

    def __init__(self, send: Callable[[Message], None]):
        self._send = send
        self._sent = StageTimer()
        self.timer = StageTimer()

    def warn_once(self, text: str) -> None:
        """Send a warning; the run shows each text once."""
        self._send((NOTE, text))

    def advance(self, frames: int, where: str) -> None:
        """Send how many frames of a scenario were traced, and the times since the last message."""
        self._send((TRACED, frames, where, *self.unsent_times()))

    def unsent_times(self) -> tuple[dict[str, float], dict[str, int]]:
        """Return seconds and rays of each stage since the last call."""
        seconds = {name: value - self._sent.seconds[name] for name, value in self.timer.seconds.items()}
        rays = {name: count - self._sent.rays[name] for name, count in self.timer.rays.items()}
        self._sent.add(seconds, rays)
        return seconds, rays


def serve(
    context: GenerationContext,
    device: str,
    receive: Callable[[], Work | None],
    send: Callable[[Message], None],
    check: Callable[[], None] = lambda: None,
) -> None:
    """Run a worker until it receives None; `check` raises an error if this machine is not fit for a worker."""
    lock = threading.Lock()

    def send_locked(message: Message) -> None:
        with lock:  # other threads log while this one reports
            send(message)

    reporter = MessageReporter(send_locked)
    if not faulthandler.is_enabled():
        faulthandler.enable()  # prints the stack on standard error if native code crashes
    with _logging_to(send_locked, context.log_level):
        try:
            check()
            LOGGER.info("worker on %s started", device)
            with owned(context.root.staging, context.owner), Worker(context, device, reporter) as worker:
                send_locked((READY,))
                while (work := receive()) is not None:
                    LOGGER.info("starting %s", work)
                    worker.trace(work)
                    send_locked((READY,))
                worker.finish()
            send_locked((ENDED, *reporter.unsent_times()))
        except Exception as error:  # the run explains it, and logs the trace that comes with it
            send_locked((FAILED, picklable_error(error)))
