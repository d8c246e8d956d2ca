"""Put calls off until their results are wanted."""

import threading
from collections.abc import Callable, Iterable
from concurrent.futures import Executor, Future
from typing import Any


class Later(Future):
    """Future of a call that is made when its result is asked for first, in that thread, or earlier in a thread of a
    pool if `start` is called.

    Attributes:
        call: What is called.
        args: Its arguments.
    """

    def __init__(self, pool: Executor, call: Callable[..., Any], *args: Any) -> None:
        """Put `call(*args)` off."""
        super().__init__()
        self.call, self.args = call, args
        self._pool = pool
        self._claim = threading.Lock()

    def start(self) -> None:
        """Have a thread of the pool make the call, unless it has been made or begun."""
        if not self.done():
            self._pool.submit(self._make)

    def result(self, timeout: float | None = None) -> Any:
        """Return the result, see `concurrent.futures.Future.result`."""
        self._make()
        return super().result(timeout)

    def _make(self) -> None:
        if self._claim.acquire(blocking=False) and self.set_running_or_notify_cancel():
            try:
                self.set_result(self.call(*self.args))
            except BaseException as error:
                self.set_exception(error)


def start_all(values: Iterable[Any]) -> None:
    """Start those of some values that are put off, so that threads work on all of them at once."""
    waiting = [value for value in values if isinstance(value, Later)]
    if len(waiting) > 1:
        for value in waiting:
            value.start()
