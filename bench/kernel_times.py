"""Time of each kernel: while a `KernelTimes` is open, every launch waits for the device before and after it."""

import math
import time
from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import warp as wp


class KernelTimes:
    """Context in which launches are timed one by one.

    Attributes:
        seconds: Kernel name -> seconds of all its launches.
        threads: Kernel name -> threads of all its launches.
    """

    def __init__(self, device: str):
        """Time the launches on a Warp device."""
        self.device = device
        self.seconds: dict[str, float] = defaultdict(float)
        self.threads: dict[str, int] = defaultdict(int)
        self._launch = wp.launch

    def __enter__(self) -> "KernelTimes":
        """Start."""
        self._launch = wp.launch
        wp.launch = self._timed
        return self

    def __exit__(self, *_: object) -> None:
        """Launch as before."""
        wp.launch = self._launch

    def _timed(self, kernel: Any, dim: int | Sequence[int], *args: Any, **options: Any) -> None:
        wp.synchronize_device(self.device)
        start = time.perf_counter()
        self._launch(kernel, dim, *args, **options)
        wp.synchronize_device(self.device)
        self.seconds[kernel.key] += time.perf_counter() - start
        self.threads[kernel.key] += math.prod([dim] if isinstance(dim, int) else dim)
