"""Remember what follows from objects that do not change, such as the actors of a scene, by the objects themselves."""

import threading
from collections import OrderedDict
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def remembered(owners: int = 1, size: int = 256) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Return a decorator that keeps the last results of a function of positional arguments.

    Its first arguments are told apart by being the same object, not by their values: tuples of actors and
    configurations are slow to hash or cannot be hashed, and stay the same objects from frame to frame. They must not
    change, nor may the results. The results keep them alive.

    Args:
        owners: Number of arguments that are told apart like this; the others are hashed.
        size: Number of results that are kept; the oldest go first.
    """

    def decorate(make: Callable[P, T]) -> Callable[P, T]:
        found: OrderedDict[tuple[Any, ...], tuple[tuple[Any, ...], T]] = OrderedDict()
        lock = threading.Lock()

        @wraps(make)
        def recall(*args: P.args, **kwargs: P.kwargs) -> T:
            if kwargs:  # they are no part of the key
                raise TypeError(f"{make.__name__}() takes no keywords: {', '.join(kwargs)}; give them by position")
            key = (id(args[0]), *args[1:]) if owners == 1 else (*map(id, args[:owners]), *args[owners:])
            entry = found.get(key)
            if entry is None:
                entry = args[:owners], make(*args)
                with lock:
                    found[key] = entry
                    while len(found) > size:
                        found.popitem(last=False)
            return entry[1]

        return recall

    return decorate
