"""Sum up the time and the rays of the stages of a run."""

import time
from collections import defaultdict
from collections.abc import Mapping


class Stage:
    """Context that adds its time, and its rays, to a stage; a live step enters some twenty."""

    __slots__ = ("_begin", "_name", "_rays", "_timer")

    def __init__(self, timer: "StageTimer", name: str, rays: int) -> None:
        self._timer, self._name, self._rays = timer, name, rays

    def __enter__(self) -> None:
        self._begin = time.perf_counter()

    def __exit__(self, *_: object) -> None:
        self._timer.seconds[self._name] += time.perf_counter() - self._begin
        self._timer.rays[self._name] += self._rays


class StageTimer:
    """Seconds and rays by stage name; stages add up over batches."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.rays: dict[str, int] = defaultdict(int)
        self.start = time.perf_counter()

    def stage(self, name: str, rays: int = 0) -> "Stage":
        """Return a context that adds its time, and its rays, to a stage."""
        return Stage(self, name, rays)

    def add(self, seconds: Mapping[str, float], rays: Mapping[str, int]) -> None:
        """Add the sums of another timer."""
        for name, value in seconds.items():
            self.seconds[name] += value
        for name, count in rays.items():
            self.rays[name] += count

    @property
    def elapsed(self) -> float:
        """Time since the timer was created [s]."""
        return time.perf_counter() - self.start
