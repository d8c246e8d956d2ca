"""Supervise the workers of a run: assign work, handle their messages, replace workers that died.

Work is finished when its markers are stored, whatever a worker reported.
"""

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

from mmw.generation.executors.child_process import WorkerDiedError
from mmw.generation.executors.work_queue import WorkQueue
from mmw.generation.executors.worker_protocol import ENDED, FAILED, LOG, NOTE, READY, TRACED, Message
from mmw.generation.progress import Console
from mmw.generation.shards import Work, pending_work
from mmw.generation.worker import GenerationContext
from mmw.storage.lock import remove_temporaries


class WorkerConnection(Protocol):
    """Connection to one worker."""

    def receive(self) -> Iterable[Message]:
        """Return the messages that have arrived, at least one.

        Raises:
            WorkerDiedError: If the worker died.
        """
        ...

    def send(self, work: Work | None) -> None:
        """Send a piece of work; None tells the worker to finish."""

    def close(self) -> None:
        """Clean up after a worker that ended or died."""

    def kill(self) -> None:
        """Kill the worker and clean up."""


C = TypeVar("C", bound=WorkerConnection)


@dataclass
class _WorkerState:
    """State of one worker."""

    number: int
    device: str
    assigned: list[Work] = field(default_factory=list)
    """All work that was sent to it."""
    traced: int = 0
    """Scenario-weather-frames that it traced."""
    has_started: bool = False
    """True once a message of it has arrived."""


class Supervisor(Generic[C]):
    """Workers that run a list of work, wherever an executor starts them."""

    def __init__(
        self,
        context: GenerationContext,
        work: Sequence[Work],
        devices: Sequence[str],
        console: Console,
        connect: Callable[[GenerationContext, str], C],
        wait: Callable[[list[C]], Iterable[C]],
    ):
        """Queue the work; `connect` starts a worker, `wait` returns connections with messages, none if it timed out."""
        self._context = context
        self._queue = WorkQueue(work, len(devices))
        self._devices = devices
        self._console = console
        self._connect = connect
        self._wait = wait
        self._workers: dict[C, _WorkerState] = {}
        self._start_count = 0

    def run(self) -> None:
        """Run all work.

        Raises:
            WorkerLostError: If workers die repeatedly over the same work.
            InputError, OutOfSpaceError, OSError, MemoryError, RuntimeError: Errors of a worker, see `Worker.trace`.
        """
        try:
            for device in self._devices[: len(self._queue)]:
                self._start_worker(device)
            while len(self._queue) or any(worker.has_started for worker in self._workers.values()):
                for connection in self._wait(list(self._workers)):
                    self._handle_messages(connection, self._workers[connection])
        finally:
            for connection in self._workers:  # workers that have not started yet, or all of them after an error
                connection.kill()

    def _start_worker(self, device: str) -> None:
        context = self._context.for_worker(self._start_count)
        self._workers[self._connect(context, device)] = _WorkerState(self._start_count, device)
        self._start_count += 1

    def _handle_messages(self, connection: C, worker: _WorkerState) -> None:
        try:
            messages = connection.receive()
        except WorkerDiedError as error:
            self._stop_worker(connection)
            self._replace_worker(worker, str(error))
            return
        worker.has_started = True
        for message in messages:
            self._handle_message(connection, worker, message)

    def _handle_message(self, connection: C, worker: _WorkerState, message: Message) -> None:
        kind, *content = message
        if kind == READY:
            work = self._queue.next(worker.number)
            if work is not None:
                worker.assigned.append(work)
            connection.send(work)
        elif kind == TRACED:
            frames, scenario, seconds, rays = content
            worker.traced += frames
            self._console.timer.add(seconds, rays)
            self._console.advance(frames, scenario)
        elif kind == NOTE:
            self._console.warn_once(*content)
        elif kind == LOG:
            logging.getLogger(content[0].name).handle(content[0])
        elif kind == ENDED:
            self._console.timer.add(*content)
            self._stop_worker(connection)
            if len(self._queue):  # requeued from a worker that died after this one was told to finish
                self._start_worker(worker.device)
        elif kind == FAILED:
            raise content[0]
        else:
            raise AssertionError(f"message {kind!r} of a worker has no handler")

    def _stop_worker(self, connection: C) -> None:
        del self._workers[connection]
        connection.close()

    def _replace_worker(self, worker: _WorkerState, cause: str) -> None:
        """Requeue the unfinished work of a worker that died, and start another one for it."""
        owner, root = self._context.for_worker(worker.number).owner, self._context.root
        # A worker on another machine may be alive but unreachable. It then fails to write, and its work is redone.
        remove_temporaries(root.staging, lambda other: other == owner)
        unfinished = pending_work(root, worker.assigned)
        self._console.say(f"a worker on {worker.device} died {cause}; its work goes to another one")
        finished = sum(item.frames for item in worker.assigned) - sum(item.frames for item in unfinished)
        self._console.done -= worker.traced - finished
        self._queue.requeue(worker.number, unfinished, cause)
        if len(self._queue):
            self._start_worker(worker.device)
