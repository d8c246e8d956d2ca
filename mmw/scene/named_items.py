"""Look items up by name, with an error that lists the names."""

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import TypeVar

from mmw.core.errors import InputError

Item = TypeVar("Item")

LISTED = 8
"""Names that an error lists."""


class NamedItems(dict[str, Item]):
    """A mapping by name whose error for an unknown name lists those that are close to it, or the first ones."""

    def __init__(self, kind: str, items: Mapping[str, Item] | Iterable[tuple[str, Item]] = ()):
        """Hold items; `kind` names them in the message, such as `actor`."""
        super().__init__(items)
        self._kind = kind

    def __missing__(self, name: str) -> Item:
        near = get_close_matches(str(name), self, n=3, cutoff=0.5)
        listed = ", ".join(near or list(self)[:LISTED]) or "none"
        more = ", ..." if not near and len(self) > LISTED else ""
        raise InputError(f"{self._kind} {name!r}: the scene has {listed}{more}; name one of them")
