"""Put calls off until their results are wanted."""

import threading
from collections.abc import Callable, Iterable
from concurrent.futures import Executor, Future
from typing import Any


class Later:
    """A call that is made when its result is asked for first, in that thread, or earlier in a thread of a pool if
    `start` is called. It is lighter than a `Future`: a live frame has some thirty, most of which are never asked.

    Attributes:
        call: What is called.
        args: Its arguments.
    """

    __slots__ = ("_error", "_is_made", "_lock", "_pool", "_value", "args", "call")

    def __init__(self, pool: Executor, call: Callable[..., Any], *args: Any) -> None:
        """Put `call(*args)` off."""
        self.call, self.args = call, args
        self._pool = pool
        self._lock = threading.Lock()
        self._is_made = False
        self._value: Any = None
        self._error: BaseException | None = None

    def done(self) -> bool:
        """Return whether the call has been made."""
        return self._is_made

    def start(self) -> None:
        """Have a thread of the pool make the call, unless it has been made or begun."""
        if not self._is_made:
            self._pool.submit(self._make)

    def result(self) -> Any:
        """Return what the call returns, or raise what it raises."""
        if not self._is_made:
            self._make()
        if self._error is not None:
            raise self._error
        return self._value

    def _make(self) -> None:
        with self._lock:  # another thread that is at it is waited for
            if not self._is_made:
                try:
                    self._value = self.call(*self.args)
                except BaseException as error:
                    self._error = error
                self._is_made = True


Waiting = Future | Later
"""Something whose `result` may have to be waited for."""


def start_all(values: Iterable[Any]) -> None:
    """Start those of some values that are put off, so that threads work on all of them at once."""
    waiting = [value for value in values if isinstance(value, Later)]
    if len(waiting) > 1:
        for value in waiting:
            value.start()
