"""Distribute work: a scenario goes to the worker that has it loaded, and is shared when others idle."""

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from dataclasses import replace

from mmw.core.errors import Error
from mmw.generation.shards import Work

MAX_TRIES = 3
"""Workers that may die over the same piece of work before the run gives up; as many for each may die before they begin,
so that a machine that is lost with many workers is no reason."""


class WorkerLostError(Error, RuntimeError):
    """Report workers that die again and again, or are out of reach. What they finished is kept, and a rerun resumes."""


def divided(item: Work, workers: int) -> tuple[Work, Work | None]:
    """Return the part of a piece of work that the first of some workers should make, and the rest of it.

    Args:
        item: The work.
        workers: How many could make it; each gets whole weathers.
    """
    names = item.weathers
    own = -(-len(names) // max(1, workers))
    if own >= len(names):
        return item, None
    return replace(item, weathers=names[:own]), replace(item, weathers=names[own:])


class WorkQueue:
    """Work that no worker has, and what each worker has."""

    def __init__(self, work: Iterable[Work], workers: int = 1, clock: Callable[[], float] = time.monotonic):
        """Queue work, which stays in its order within a scenario.

        Args:
            work: The work.
            workers: How many make it at a time.
            clock: Returns the time [s].
        """
        self._workers = workers
        self._clock = clock
        self._has: dict[int, tuple[Work, float]] = {}
        self._seconds, self._frames = 0.0, 0
        self._waiting: dict[str, list[Work]] = defaultdict(list)
        self._tries: Counter[Work | None] = Counter()
        self._scenario: dict[int, str] = {}
        for item in work:
            self._waiting[item.scenario].append(item)

    def __len__(self) -> int:
        return sum(map(len, self._waiting.values()))

    def next(self, worker: int) -> Work | None:
        """Return what a worker should make now; None if nothing is left.

        It goes on with its scenario; else it begins one that nobody has, or helps where most frames are left for each
        worker. At the end, where more workers are about to be free than pieces are left, weathers of a piece go to
        workers of their own: that costs more in all, since what they share is traced for each, and ends sooner.
        """
        self._end(worker)
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
        first, rest = divided(item, self._soon_free(item) // (1 + len(self)))
        if rest is not None:
            self._waiting[own].insert(0, rest)
        self._has[worker] = first, self._clock()
        return first

    def _end(self, worker: int) -> None:
        """Learn how long a worker took for what it had."""
        if worker in self._has:
            item, begin = self._has.pop(worker)
            self._seconds += self._clock() - begin
            self._frames += item.frames

    def _soon_free(self, item: Work) -> int:
        """Return how many workers could make a piece together: who asks, and who is free before half of it is made."""
        if not self._frames:
            return 1  # nobody has made anything yet
        pace, now = self._seconds / self._frames, self._clock()
        left = [begin + pace * other.frames - now for other, begin in self._has.values()]
        return 1 + sum(seconds < 0.5 * pace * item.frames for seconds in left)

    def give_back(self, worker: int, work: Iterable[Work], cause: str) -> None:
        """Take back what a lost worker left unfinished.

        Args:
            worker: The worker.
            work: What it had and did not finish, the oldest first.
            cause: What it died of, for the message.

        Raises:
            WorkerLostError: If workers died over the same work too often.
        """
        self._scenario.pop(worker, None)
        self._has.pop(worker, None)
        items = list(work)
        for item in reversed(items):
            self._waiting[item.scenario].insert(0, item)
        first = items[0] if items else None  # what it was at; none if it died before it began
        self._tries[first] += 1
        if self._tries[first] > MAX_TRIES * (self._workers if first is None else 1):
            where = "before they began" if first is None else f"at {first}"
            raise WorkerLostError(
                f"{self._tries[first]} workers died {where}, the last {cause}; everything that was finished is kept; "
                "see whether memory ran out, and run the same command again: it resumes"
            )
