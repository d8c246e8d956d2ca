"""Distribute work: a scenario goes to the worker that has it loaded, and is shared when others idle."""

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from dataclasses import replace

from mmw.core.errors import Error
from mmw.generation.shards import Work

MAX_TRIES = 3
"""Workers that may die over the same piece of work before the run fails. Before they start, as many may die for each
worker, so that the loss of a machine with many workers does not end the run."""


class WorkerLostError(Error, RuntimeError):
    """Report workers that die repeatedly or are out of reach. Finished work is stored, and a rerun resumes."""


class WorkQueue:
    """Work that is not assigned yet, and the piece that each worker is running."""

    def __init__(self, work: Iterable[Work], workers: int = 1, clock: Callable[[], float] = time.monotonic):
        """Queue work, whose order within a scenario is preserved."""
        self._workers = workers
        self._clock = clock
        self._running: dict[int, tuple[Work, float]] = {}
        self._seconds, self._frames = 0.0, 0
        self._waiting: dict[str, list[Work]] = defaultdict(list)
        self._deaths: Counter[Work | None] = Counter()
        self._scenario: dict[int, str] = {}
        for item in work:
            self._waiting[item.scenario].append(item)

    def __len__(self) -> int:
        return sum(map(len, self._waiting.values()))

    def next(self, worker: int) -> Work | None:
        """Return the next piece of work for a worker; None if nothing is left.

        A worker stays with its scenario; otherwise it starts one that no worker has, or joins the one with most
        frames left for each worker. At the end, where more workers are about to be idle than pieces are left, the
        weathers of a piece are split among workers: this costs more in total, because each traces what the weathers
        share, but ends sooner.
        """
        self._finish(worker)
        open_scenarios = {name: items for name, items in self._waiting.items() if items}
        if not open_scenarios:
            return None
        own = self._scenario.get(worker)
        if own not in open_scenarios:
            helpers = Counter(name for other, name in self._scenario.items() if other != worker)
            left = {name: sum(item.frames for item in items) for name, items in open_scenarios.items()}
            own = max(left, key=lambda name: (left[name] / (1 + helpers[name]), name))
            self._scenario[worker] = own
        item = self._waiting[own].pop(0)
        sharers = max(1, self._count_idle_soon(item) // (1 + len(self)))
        count = -(-len(item.weathers) // sharers)
        if count < len(item.weathers):
            self._waiting[own].insert(0, replace(item, weathers=item.weathers[count:]))
            item = replace(item, weathers=item.weathers[:count])
        self._running[worker] = item, self._clock()
        return item

    def _finish(self, worker: int) -> None:
        """Add the duration of a worker's last piece of work to the statistics."""
        if worker in self._running:
            item, start = self._running.pop(worker)
            self._seconds += self._clock() - start
            self._frames += item.frames

    def _count_idle_soon(self, item: Work) -> int:
        """Return how many workers could share a piece: the caller, and those idle before half of it is done."""
        if not self._frames:
            return 1  # no duration is known yet
        pace, now = self._seconds / self._frames, self._clock()
        left = [start + pace * other.frames - now for other, start in self._running.values()]
        return 1 + sum(seconds < 0.5 * pace * item.frames for seconds in left)

    def requeue(self, worker: int, work: Iterable[Work], cause: str) -> None:
        """Queue the unfinished work of a dead worker again, before all other work of its scenarios.

        Raises:
            WorkerLostError: If too many workers died over the same work.
        """
        self._scenario.pop(worker, None)
        self._running.pop(worker, None)
        items = list(work)
        for item in reversed(items):
            self._waiting[item.scenario].insert(0, item)
        first = items[0] if items else None  # the piece it was running; None if it died before it started
        self._deaths[first] += 1
        if self._deaths[first] > MAX_TRIES * (self._workers if first is None else 1):
            where = "before they started" if first is None else f"at {first}"
            raise WorkerLostError(
                f"{self._deaths[first]} workers died {where}, the last {cause}; all finished work is stored; "
                "check whether memory ran out, and run the same command again: it resumes"
            )
