"""Sum up the time and the rays of the stages of a run."""

import time
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager


class StageTimer:
    """Seconds and rays by stage name; stages add up over batches."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.rays: dict[str, int] = defaultdict(int)
        self.start = time.perf_counter()

    @contextmanager
    def stage(self, name: str, rays: int = 0) -> Iterator[None]:
        """Add the time of the enclosed block, and its rays, to a stage."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] += time.perf_counter() - begin
            self.rays[name] += rays

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
