"""Keep who is absent from live traffic, and who was put back a moment ago."""

from collections.abc import Collection

from mmw.core.errors import InputError

STILL_ROWS = 4
"""Rows in which an added actor stands still. The derivatives of its first frame depend on as many, see
`mmw.core.kinematics`, and a frame is shown when one of them is known: at rest they are zero, whatever comes later."""


class Presence:
    """Actors that were removed, and rows in which those that were added stand still."""

    def __init__(self, names: Collection[str]) -> None:
        """Start with all actors present."""
        self._names = names
        self._absent: dict[str, int] = {}
        self._still_until: dict[str, int] = {}

    @property
    def absent(self) -> Collection[str]:
        """Actors that have no pose in the next row."""
        return self._absent.keys()

    def stands(self, name: str, row: int) -> bool:
        """Return whether an actor was added so lately that it does not move in a row."""
        return row < self._still_until.get(name, 0)

    def remove(self, name: str, row: int) -> None:
        """Take an actor out from a row on, the next one.

        Raises:
            InputError: If there is no such actor, or it is absent.
        """
        self.check_name("remove", name)
        if name in self._absent:
            raise InputError(f"remove {name!r}: is absent already; add it first")
        self._absent[name] = row

    def add(self, name: str, row: int) -> None:
        """Take an actor in from a row on, the next one; errors as of `check_add`."""
        self.check_add(name, row)
        del self._absent[name]
        self._still_until[name] = row + STILL_ROWS

    def check_add(self, name: str, row: int) -> None:
        """Check that an actor can come back in a row, the next one.

        Raises:
            InputError: If there is no such actor, it is there, or it is present in the row before.
        """
        self.check_name("add", name)
        if name not in self._absent:
            raise InputError(f"add {name!r}: is there already; remove it first, or give it Control(pose=...)")
        if self._absent[name] == row:
            raise InputError(f"add {name!r}: has just been removed and is still in the known frames; step first")

    def check_name(self, call: str, name: str) -> None:
        """Check that there is an actor.

        Raises:
            InputError: If there is none; the message starts with the call.
        """
        if name not in self._names:
            known = ", ".join([*self._names][:8]) + (
                f" and {len(self._names) - 8} more" if len(self._names) > 8 else ""
            )
            raise InputError(f"{call} {name!r}: there is no such actor; there are {known}; name one of them")
