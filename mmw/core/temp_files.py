"""Name temporary files, and tell from a name which run is writing the file."""

import os
import re
import shutil
import tempfile
import threading
import weakref
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
    """Identify the writer of a file: a run of a part of a dataset, or one of its workers. Each run is unique."""

    index: int = 0
    """Part of the dataset that the run generates."""
    count: int = 1
    """Total number of parts."""
    run: str = field(default_factory=lambda: uuid4().hex[:12])
    worker: int | None = None
    """Number of the worker in its run; None for the run itself."""

    def __str__(self) -> str:
        return f"{self.index}of{self.count}-{self.run}" + ("" if self.worker is None else f"-w{self.worker}")

    def has(self, other: "Owner") -> bool:
        """Return whether another owner is this one, or a worker of this run."""
        return (self.run, self.index, self.count) == (other.run, other.index, other.count) and (
            self.worker in (None, other.worker)
        )


_owners: dict[Path, list[Owner]] = {}
_changing = threading.Lock()


@contextmanager
def owned(folder: Path, owner: Owner) -> Iterator[None]:
    """Put an owner into the names of temporary files of this process below a folder; inner blocks override outer."""
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
    """Return the name of a file until it is complete; readers skip it (leading dot, no `.parquet` at the end).

    The name is unique to this process on any machine, so that two processes can write the same file. Within a block of
    `owned` it includes the owner.
    """
    owners = next((_owners[folder] for folder in path.absolute().parents if folder in _owners), ())
    mark = "-".join([*(str(owner) for owner in owners[-1:]), _mark(os.getpid())])
    return path.with_name(f".{path.name}.{mark}.tmp{suffix}")


def is_temporary(path: PurePath) -> bool:
    """Return whether a file's name is one of `temporary_path`."""
    return _TEMPORARY.fullmatch(path.name) is not None


def owner_of(path: PurePath) -> Owner | None:
    """Return the owner of a temporary file; None if its name has none."""
    found = _OWNED.fullmatch(path.name)
    if found is None:
        return None
    index, count, run, worker = found.groups()
    return Owner(int(index), int(count), run, None if worker is None else int(worker))


@cache
def _mark(process: int) -> str:
    return uuid4().hex[:12]


class TemporaryFolder:
    """A folder that goes when the last reference to this goes, or at the end of the process.

    Unlike `tempfile.TemporaryDirectory` it may be left to that without a warning.
    """

    def __init__(self, prefix: str):
        """Make the folder; its name begins with `prefix`."""
        self.path = Path(tempfile.mkdtemp(prefix=prefix))
        weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)
