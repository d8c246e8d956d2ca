"""A worker's end of an engine: it asks for work and makes it; what it says goes to the run as messages."""

import faulthandler
import logging
import pickle
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from logging.handlers import QueueHandler
from typing import Any

from mmw.core.temp_files import owned
from mmw.core.timing import StageTimer
from mmw.generation.shards import Work
from mmw.generation.worker import GenerationContext, Worker

READY, TRACED, NOTE, LOG, ENDED, FAILED = "ready", "traced", "note", "log", "ended", "failed"
"""Kinds of messages from a worker: it wants work; frames, scenario and times; one line; a log record; its last times;
its error."""

LOGGER = logging.getLogger(__name__)

Message = tuple[Any, ...]
"""A kind and its content; it can be pickled."""


class _Sender(QueueHandler):
    """A logging handler that turns records into messages."""

    def enqueue(self, record: logging.LogRecord) -> None:
        """Send a record that `QueueHandler.prepare` has made fit for another process."""
        self.queue((LOG, record))


@contextmanager
def _logging_to(send: Callable[[Message], None], level: int) -> Iterator[None]:
    """Send the records of this process as messages while the block runs."""
    root, handler = logging.getLogger("mmw"), _Sender(send)
    before = root.level
    root.addHandler(handler)
    root.setLevel(level)
    try:
        yield
    finally:
        root.removeHandler(handler)
        root.setLevel(before)


class Relay:
    """A worker's `Reporter`: what it says becomes messages."""

    def __init__(self, send: Callable[[Message], None]):
        self._send = send
        self._sent = StageTimer()
        self.clock = StageTimer()

    def warn_once(self, text: str) -> None:
        """Send a warning; the run shows each once."""
        self._send((NOTE, text))

    def advance(self, frames: int, where: str) -> None:
        """Send how many frames were traced, and the times since the last message."""
        self._send((TRACED, frames, where, *self.since()))

    def since(self) -> tuple[dict[str, float], dict[str, int]]:
        """Return seconds and rays of each stage since this was last asked."""
        seconds = {name: value - self._sent.seconds[name] for name, value in self.clock.seconds.items()}
        rays = {name: count - self._sent.rays[name] for name, count in self.clock.rays.items()}
        self._sent.add(seconds, rays)
        return seconds, rays


def serve(
    making: GenerationContext,
    device: str,
    receive: Callable[[], Work | None],
    send: Callable[[Message], None],
    check: Callable[[], None] = lambda: None,
) -> None:
    """Be a worker: make what comes until None comes.

    Args:
        making: What is made.
        device: Warp device name.
        receive: Waits for the next piece of work.
        send: Takes messages.
        check: Raises an error if this is no place to work.
    """
    lock = threading.Lock()

    def send_whole(message: Message) -> None:
        with lock:  # threads log while this one reports
            send(message)

    relay = Relay(send_whole)
    if not faulthandler.is_enabled():
        faulthandler.enable()  # a crash of native code says on standard error where it was
    with _logging_to(send_whole, making.log_level):
        try:
            check()
            LOGGER.info("worker on %s begins", device)
            with owned(making.root.staging, making.owner), Worker(making, device, relay) as worker:
                send_whole((READY,))
                while (work := receive()) is not None:
                    LOGGER.info("makes %s", work)
                    worker.make(work)
                    send_whole((READY,))
                worker.finish()
            send_whole((ENDED, *relay.since()))
        except Exception as error:  # the run says what it means, and logs the trace that goes with it
            send_whole((FAILED, portable(error)))


def portable(error: Exception) -> Exception:
    """Return an error that can go to another process, with where it was raised as a note."""
    error.add_note("in a worker process:\n" + "".join(traceback.format_exception(error)))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # whatever a library's error does when it is copied
        copied = RuntimeError(f"{type(error).__name__}: {error}")
        copied.__notes__ = error.__notes__
        return copied
    return error
