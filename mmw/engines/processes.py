"""Work in several processes of this machine, one a device or a core. A process that dies is replaced.

The parent hands out one piece of work after another and counts what comes back; what is finished, the markers on the
disk say. A worker ends with its parent, however that ends.
"""

import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

from mmw.engines.queue import WorkQueue
from mmw.report import Clock, Console
from mmw.shards import Work, pending_work
from mmw.worker import Making, Worker

READY, TRACED, NOTE, ENDED, FAILED = "ready", "traced", "note", "ended", "failed"
"""Kinds of messages from a worker: it wants work; frames, scenario and times; one line; its last times; its error."""


class Relay:
    """A worker's `Reporter`: what it says goes to the parent."""

    def __init__(self, connection: Connection):
        self._connection = connection
        self._sent = Clock()
        self.clock = Clock()

    def send(self, kind: str, *content: Any) -> None:
        """Send one message."""
        self._connection.send((kind, *content))

    def warn_once(self, text: str) -> None:
        """Send a warning; the parent shows each once."""
        self.send(NOTE, text)

    def advance(self, frames: int, where: str) -> None:
        """Send how many frames were traced, and the times since the last message."""
        self.send(TRACED, frames, where, *self.since())

    def since(self) -> tuple[dict[str, float], dict[str, int]]:
        """Return seconds and rays of each stage since this was last asked."""
        seconds = {name: value - self._sent.seconds[name] for name, value in self.clock.seconds.items()}
        rays = {name: count - self._sent.rays[name] for name, count in self.clock.rays.items()}
        self._sent.add(seconds, rays)
        return seconds, rays


def serve(connection: Connection, lifeline: Connection, making: Making, device: str) -> None:
    """Body of a worker process: make what the parent sends until it sends None.

    Args:
        connection: To the parent.
        lifeline: Never sends; it closes when the parent ends.
        making: What is made.
        device: Warp device name.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what Ctrl-C means
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()
    relay = Relay(connection)
    try:
        with Worker(making, device, relay) as worker:
            relay.send(READY)
            while (work := connection.recv()) is not None:
                worker.make(work)
                relay.send(READY)
            worker.finish()
        relay.send(ENDED, *relay.since())
    except Exception as error:  # the parent says what it means
        relay.send(FAILED, _portable(error))


def _portable(error: Exception) -> Exception:
    """Return an error that can go to another process, with where it was raised as a note."""
    error.add_note("".join(traceback.format_exception(error)))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # whatever a library's error does when it is copied
        copied = RuntimeError(f"{type(error).__name__}: {error}")
        copied.__notes__ = error.__notes__
        return copied
    return error


def _end_with(lifeline: Connection) -> None:
    with suppress(EOFError, OSError):
        lifeline.recv()
    os._exit(1)


@dataclass
class _Child:
    """One worker process."""

    number: int
    device: str
    process: BaseProcess
    connection: Connection
    lifeline: Connection
    has: list[Work] = field(default_factory=list)
    """Everything that it was given."""
    traced: int = 0
    """Scenario-weather-frames that it traced."""

    def close(self) -> None:
        self.process.join()
        self.connection.close()
        self.lifeline.close()


class Processes:
    """Workers that make a list of work."""

    def __init__(self, making: Making, work: Sequence[Work], devices: Sequence[str], console: Console):
        """Queue the work.

        Args:
            making: What is made.
            work: The work.
            devices: Device of each worker; the same may stand there more than once.
            console: Where progress goes.
        """
        self._making = making
        self._queue = WorkQueue(work)
        self._devices = devices
        self._console = console
        self._children: dict[Any, _Child] = {}
        self._born = 0

    def run(self) -> None:
        """Make everything.

        Raises:
            WorkerLostError: If workers die over the same work again and again.
            ValueError, OutOfSpaceError, OSError, MemoryError, RuntimeError: What a worker raised, see `Worker.make`.
        """
        try:
            for device in self._devices[: len(self._queue)]:
                self._start(device)
            while self._children:
                for connection in wait(list(self._children)):
                    self._hear(self._children[connection])
        finally:
            for child in self._children.values():  # none is left unless something failed
                child.process.kill()
                child.close()

    def _start(self, device: str) -> None:
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        ends, held = context.Pipe(duplex=False)
        process = context.Process(
            target=serve, args=(there, ends, self._making, device), name=f"mmw-worker-{self._born}", daemon=True
        )
        process.start()
        there.close()
        ends.close()
        self._children[here] = _Child(self._born, device, process, here, held)
        self._born += 1

    def _hear(self, child: _Child) -> None:
        try:
            kind, *content = child.connection.recv()
        except (EOFError, OSError):
            self._lost(child)
            return
        if kind == READY:
            work = self._queue.next(child.number)
            if work is not None:
                child.has.append(work)
            with suppress(BrokenPipeError):  # then the next message is that it died
                child.connection.send(work)
        elif kind == TRACED:
            frames, where, seconds, rays = content
            child.traced += frames
            self._console.clock.add(seconds, rays)
            self._console.advance(frames, where)
        elif kind == NOTE:
            self._console.warn_once(*content)
        elif kind == ENDED:
            self._console.clock.add(*content)
            del self._children[child.connection]
            child.close()
            if len(self._queue):  # given back by one that died after this one had been let go
                self._start(child.device)
        elif kind == FAILED:
            raise content[0]

    def _lost(self, child: _Child) -> None:
        """Replace a worker that died, and queue what it had not finished."""
        del self._children[child.connection]
        child.close()
        code = child.process.exitcode
        cause = f"by signal {-code}" if code is not None and code < 0 else f"with exit code {code}"
        unfinished = pending_work(self._making.root, child.has)
        self._console.say(f"a worker on {child.device} died {cause}; its work goes to another one")
        finished = sum(item.frames for item in child.has) - sum(item.frames for item in unfinished)
        self._console.done -= child.traced - finished
        self._queue.give_back(child.number, unfinished, cause)
        if len(self._queue):
            self._start(child.device)
