"""Submit images to the threads that encode them, as many as fit, so that a fast device does not fill memory."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any

import numpy as np

from mmw.core.later import Later, Waiting

MAX_WAITING_BYTES = 1 << 29
"""Images that may wait for a thread [bytes]: 580 RGB images of 640 x 480, 0.2 s of work for eight threads. Design
value."""


class Encoder:
    """Hands images to a pool of threads; the caller waits while too many bytes wait for it."""

    def __init__(self, pool: ThreadPoolExecutor, *, puts_off: bool = False) -> None:
        """Use a pool, which others may use too.

        Args:
            pool: The pool.
            puts_off: Encode only when the bytes are asked for (`Later`); the caller never waits then.
        """
        self._pool = pool
        self._puts_off = puts_off
        self._waiting: deque[tuple[Future[bytes], int]] = deque()
        self._bytes = 0

    def submit(self, encode: Callable[..., bytes], image: np.ndarray, *settings: Any) -> Waiting:
        """Return the future of `encode(image, *settings)`, a file's bytes."""
        if self._puts_off:
            return Later(self._pool, encode, image, *settings)
        while self._waiting and (self._bytes + image.nbytes > MAX_WAITING_BYTES or self._waiting[0][0].done()):
            future, size = self._waiting.popleft()
            wait([future])  # what it raises, it raises where its bytes are wanted
            self._bytes -= size
        future = self._pool.submit(encode, image, *settings)
        self._waiting.append((future, image.nbytes))
        self._bytes += image.nbytes
        return future
