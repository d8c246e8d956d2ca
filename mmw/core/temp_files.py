"""Names of files that are not complete yet, and whose they are."""

import os
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path, PurePath
from uuid import uuid4

_TEMPORARY = re.compile(r"\..*\.tmp(\.\w+)?")
_OWNED = re.compile(r"\..*\.(\d+)of(\d+)-([0-9a-f]{12})(?:-w(\d+))?(?:-[0-9a-f]{12})?\.tmp(?:\.\w+)?")


@dataclass(frozen=True)
class Owner:
    """Identify the maker of a file: a run of a part of a dataset, or one worker of it. No two runs are equal."""

    index: int = 0
    """Part of the dataset that the run makes."""
    count: int = 1
    """Parts in all."""
    run: str = field(default_factory=lambda: uuid4().hex[:12])
    worker: int | None = None
    """Number of the worker in its run; None for the run itself, which all its workers belong to."""

    def __str__(self) -> str:
        return f"{self.index}of{self.count}-{self.run}" + ("" if self.worker is None else f"-w{self.worker}")

    def has(self, other: "Owner") -> bool:
        """Return whether another one is this one, or a worker of this run."""
        return (self.run, self.index, self.count) == (other.run, other.index, other.count) and (
            self.worker in (None, other.worker)
        )


_owners: dict[Path, list[Owner]] = {}
_changing = threading.Lock()


@contextmanager
def owned(folder: Path, owner: Owner) -> Iterator[None]:
    """Let temporary files of this process in a folder, or below it, bear an owner's mark; the innermost block counts.

    Args:
        folder: Absolute, or relative to the working directory of now.
        owner: Whose they are.
    """
    folder = folder.absolute()
    with _changing:
        _owners[folder] = [*_owners.get(folder, []), owner]
    try:
        yield
    finally:
        with _changing:
            left = [other for other in _owners[folder] if other is not owner]
            if left:
                _owners[folder] = left
            else:
                del _owners[folder]


def temporary_path(path: Path, suffix: str = "") -> Path:
    """Return the name that a file has until it is complete; readers skip it (leading dot, no `.parquet` at the end).

    Every process has its own, on whatever machine: two that write the same file never mix their bytes. Within a block
    of `owned` the name tells the owner too.

    Args:
        path: Final name.
        suffix: What the name must end with, for a library that tells the format by it.
    """
    owners = next((_owners[folder] for folder in path.absolute().parents if folder in _owners), ())
    mark = "-".join([*(str(owner) for owner in owners[-1:]), _mark(os.getpid())])
    return path.with_name(f".{path.name}.{mark}.tmp{suffix}")


def is_temporary(path: PurePath) -> bool:
    """Return whether a file's name is one of `temporary_path`."""
    return _TEMPORARY.fullmatch(path.name) is not None


def owner_of(path: PurePath) -> Owner | None:
    """Return whose a temporary file is; None if its name does not tell."""
    found = _OWNED.fullmatch(path.name)
    if found is None:
        return None
    index, count, run, worker = found.groups()
    return Owner(int(index), int(count), run, None if worker is None else int(worker))


@cache
def _mark(process: int) -> str:
    return uuid4().hex[:12]
