"""The run's end of an engine: who makes what, what the console shows of it, and who replaces a worker that died.

It hands out one piece of work after another and counts what comes back; what is finished, the markers on the disk say.
"""

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

from mmw.generation.executors.work_queue import WorkQueue
from mmw.generation.executors.worker_protocol import ENDED, FAILED, LOG, NOTE, READY, TRACED, Message
from mmw.generation.progress import Console
from mmw.generation.shards import Work, pending_work
from mmw.generation.worker import GenerationContext
from mmw.storage.lock import remove_temporaries


class LostError(Exception):
    """A worker died; the text says how."""


class Link(Protocol):
    """Connection to one worker."""

    def receive(self) -> Iterable[Message]:
        """Return what the worker said; something is there.

        Raises:
            LostError: If it died.
        """
        ...

    def send(self, work: Work | None) -> None:
        """Give it work; None lets it go."""

    def close(self) -> None:
        """Clean up after a worker that ended or died."""

    def kill(self) -> None:
        """End a worker, whatever it is at, and clean up."""


L = TypeVar("L", bound=Link)


@dataclass
class _Member:
    """One worker."""

    number: int
    device: str
    has: list[Work] = field(default_factory=list)
    """Everything that it was given."""
    traced: int = 0
    """Scenario-weather-frames that it traced."""
    is_up: bool = False
    """Whether it has said anything."""


class Supervisor(Generic[L]):
    """Workers that make a list of work, on whatever an engine starts them."""

    def __init__(
        self,
        making: GenerationContext,
        work: Sequence[Work],
        devices: Sequence[str],
        console: Console,
        start: Callable[[GenerationContext, str], L],
        wait: Callable[[list[L]], Iterable[L]],
    ):
        """Queue the work.

        Args:
            making: What is made.
            work: The work.
            devices: Device of each worker; the same may stand there more than once.
            console: Where progress goes.
            start: Starts a worker, which makes what `making` says, on a device.
            wait: Returns those of some links that have something to receive; none if it waited long enough.
        """
        self._making = making
        self._queue = WorkQueue(work, len(devices))
        self._devices = devices
        self._console = console
        self._start = start
        self._wait = wait
        self._members: dict[L, _Member] = {}
        self._born = 0

    def run(self) -> None:
        """Make everything.

        Raises:
            WorkerLostError: If workers die over the same work again and again.
            InputError, OutOfSpaceError, OSError, MemoryError, RuntimeError: What a worker raised, see `Worker.make`.
        """
        try:
            for device in self._devices[: len(self._queue)]:
                self._hire(device)
            while len(self._queue) or any(member.is_up for member in self._members.values()):
                for link in self._wait(list(self._members)):
                    self._hear(link, self._members[link])
        finally:
            for link in self._members:  # who has not begun when all is done, or everybody if something failed
                link.kill()

    def _hire(self, device: str) -> None:
        making = self._making.for_worker(self._born)
        self._members[self._start(making, device)] = _Member(self._born, device)
        self._born += 1

    def _hear(self, link: L, member: _Member) -> None:
        try:
            messages = link.receive()
        except LostError as error:
            self._let_go(link)
            self._lost(member, str(error))
            return
        member.is_up = True
        for kind, *content in messages:
            if kind == READY:
                work = self._queue.next(member.number)
                if work is not None:
                    member.has.append(work)
                link.send(work)
            elif kind == TRACED:
                frames, where, seconds, rays = content
                member.traced += frames
                self._console.clock.add(seconds, rays)
                self._console.advance(frames, where)
            elif kind == NOTE:
                self._console.warn_once(*content)
            elif kind == LOG:
                logging.getLogger(content[0].name).handle(content[0])
            elif kind == ENDED:
                self._console.clock.add(*content)
                self._let_go(link)
                if len(self._queue):  # given back by one that died after this one had been let go
                    self._hire(member.device)
            elif kind == FAILED:
                raise content[0]
            else:
                raise AssertionError(f"message {kind!r} of a worker has no case")

    def _let_go(self, link: L) -> None:
        del self._members[link]
        link.close()

    def _lost(self, member: _Member, cause: str) -> None:
        """Replace a worker that died, and queue what it had not finished."""
        own, root = self._making.for_worker(member.number).owner, self._making.root
        # On another machine it may only be out of reach. Then what it writes fails, and another one makes that again.
        remove_temporaries(root.staging, lambda owner: owner == own)
        unfinished = pending_work(root, member.has)
        self._console.say(f"a worker on {member.device} died {cause}; its work goes to another one")
        finished = sum(item.frames for item in member.has) - sum(item.frames for item in unfinished)
        self._console.done -= member.traced - finished
        self._queue.give_back(member.number, unfinished, cause)
        if len(self._queue):
            self._hire(member.device)
