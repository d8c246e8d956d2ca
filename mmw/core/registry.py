"""Find plug-ins by name: those of mmw, and those that other packages register as entry points."""

import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Any, Generic, TypeVar

from mmw.core.errors import InputError

T = TypeVar("T")

REGISTERED = "register()"
"""Owner of plug-ins that `Registry.register` added: other processes do not have them."""


_IMPORTED: dict[str, ModuleType] = {}
"""Modules of `load_reference`, which a live step calls some twenty times; `import_module` takes four times as long."""


def load_reference(reference: str) -> Any:
    """Import what a `module:attribute` string names."""
    module, _, attribute = reference.partition(":")
    known = _IMPORTED.get(module)
    if known is None or sys.modules.get(module) is not known:
        known = _IMPORTED[module] = import_module(module)
    return getattr(known, attribute)


class Registry(Mapping[str, T], Generic[T]):
    """Map names to plug-ins, which are imported when they are first requested.

    Iteration yields built-in names first, then those of entry points sorted by name, then those of `register`.
    """

    def __init__(self, group: str, what: str, kind: str, builtin: Mapping[str, str], check: str | None = None) -> None:
        """Store names and references, without importing a plug-in.

        Args:
            group: Entry point group of other packages, such as `mmw.sensors`.
            what: Kind of plug-in, for messages, such as `sensor`.
            kind: Its class as `module:class`; anything else is refused.
            builtin: Name -> `module:attribute` of the plug-ins of mmw.
            check: `module:function` that is called with name and plug-in when one is registered or loaded, and raises
                if it is wrong.
        """
        self._group, self._what, self._kind, self._builtin = group, what, kind, dict(builtin)
        self._check = check
        self._loaded: dict[str, T] = {}
        self._added: dict[str, T] = {}
        self._found: dict[str, EntryPoint] | None = None

    def register(self, name: str, plugin: T) -> T:
        """Add a plug-in of this process and return it.

        Raises:
            InputError: If the name is taken, or the plug-in has another type or is wrong.
        """
        if name in self:
            raise InputError(f"{self._what} {name!r}: is registered by {self.owner(name)} already; choose another name")
        self._added[name] = self._checked(name, plugin, REGISTERED)
        return plugin

    def owner(self, name: str) -> str:
        """Return the provider of a plug-in: `mmw`, the distribution of an entry point, or `REGISTERED`."""
        if name in self._builtin:
            return "mmw"
        if name in self._entry_points():
            return _owner(self._entry_points()[name])
        return REGISTERED

    def __getitem__(self, name: str) -> T:
        if name in self._added:
            return self._added[name]
        if name not in self._loaded:
            if name in self._builtin:
                plugin = load_reference(self._builtin[name])
            elif name in self._entry_points():
                plugin = self._load(name)
            else:
                raise KeyError(name)
            self._loaded[name] = self._checked(name, plugin, self.owner(name))
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        yield from (*self._builtin, *sorted(self._entry_points()), *self._added)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, name: object) -> bool:
        return name in self._added or name in self._builtin or name in self._entry_points()

    def _load(self, name: str) -> Any:
        entry = self._entry_points()[name]
        try:
            return entry.load()
        except Exception as error:  # a bug of that package: its trace stays, with a note of its owner
            error.add_note(f"{self._what} {name!r}: {entry.value} of {_owner(entry)} cannot be imported")
            raise

    def _entry_points(self) -> dict[str, EntryPoint]:
        """Return the entry points of the group by name, read once."""
        if self._found is None:
            found: dict[str, EntryPoint] = {}
            for entry in entry_points(group=self._group):
                other = "mmw" if entry.name in self._builtin else None
                if entry.name in found and found[entry.name].value != entry.value:
                    other = _owner(found[entry.name])
                if other is not None:
                    raise InputError(
                        f"{self._what} {entry.name!r}: both {other} and {_owner(entry)} provide it; remove one of them"
                    )
                found[entry.name] = entry
            self._found = found
        return self._found

    def _checked(self, name: str, plugin: Any, owner: str) -> T:
        kind = load_reference(self._kind)
        if not isinstance(plugin, kind):
            raise InputError(
                f"{self._what} {name!r} of {owner}: is a {type(plugin).__name__}; a {kind.__name__} is needed"
            )
        if self._check is not None:
            load_reference(self._check)(name, plugin)
        return plugin


def _owner(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist is not None else entry.value
