"""Read and write the files of a dataset through a `Store`, such as a local folder."""

import os
import shutil
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from mmw.core.errors import InputError
from mmw.storage.atomic_files import FULL, OutOfSpaceError, write_bytes_atomically

DATASET = "dataset.json"
"""Whose dataset it is: configuration, its hash, versions."""
LOCKS = "_locks"
"""Folder of the locks (`mmw.storage.lock`); the underscore hides it from readers."""


class Store(ABC):
    """A place that holds a dataset. Its files have names relative to it, with slashes.

    What a run makes it makes in `folder`, on this machine; `keep` then makes it a part of the dataset.
    """

    address: str
    """How people call it."""

    def __str__(self) -> str:
        return self.address

    @property
    @abstractmethod
    def folder(self) -> Path:
        """Folder on this machine in which files are made; the dataset itself where that is local."""

    @property
    @abstractmethod
    def staging(self) -> Path:
        """Folder on this machine that holds `folder`, and the locks of the runs that write the dataset from here."""

    @abstractmethod
    def where(self, name: str = "") -> str:
        """Return what people call one of its files, or the place itself without what only programs need."""

    @abstractmethod
    def anywhere(self) -> "Store":
        """Return the same place by a name that holds in any working directory, and on machines that share it."""

    @abstractmethod
    def check(self) -> None:
        """See that the place is there and can be written to.

        Raises:
            InputError: If not.
            OutOfSpaceError: If the disk is full.
        """

    @abstractmethod
    def read(self, name: str) -> bytes | None:
        """Return the content of a file; None if there is none."""

    @abstractmethod
    def read_all(self, names: Iterable[str]) -> dict[str, bytes]:
        """Return the content of those files that can be read."""

    @abstractmethod
    def rows(self, name: str, columns: Sequence[str]) -> pa.Table:
        """Return columns of a Parquet file.

        Raises:
            pa.ArrowException, OSError: If there is none, or it is damaged.
            StoreError: If the store cannot be reached or refuses.
        """

    @abstractmethod
    def top(self) -> list[str]:
        """Return the names of files and folders that are in it, not further down."""

    @abstractmethod
    def names(self, folder: str = "") -> list[str]:
        """Return the names of all files below a folder, sorted."""

    @abstractmethod
    def sizes(self, names: Collection[str]) -> dict[str, int]:
        """Return the size [byte] of those files that are there."""

    @abstractmethod
    def publish(self, name: str, data: bytes) -> None:
        """Write a file so that a reader sees all of it or nothing; one that is there is replaced.

        Raises:
            OutOfSpaceError: If the disk is full.
            StoreError: If the store cannot be reached or refuses.
        """

    @abstractmethod
    def remove(self, names: Iterable[str]) -> None:
        """Remove files, and folders with everything in them, in this order; those that are not there are left out."""

    @abstractmethod
    def claim(self, head: bytes | None) -> None:
        """Begin to write a dataset, or go on: `dataset.json` and `folder` are there then, and the place can be written.

        Args:
            head: Content of `dataset.json`; None goes on with the one that is there.

        Raises:
            OutOfSpaceError, StoreError: As `publish`.
        """

    @abstractmethod
    def keep(self, names: Iterable[str], last: str, *, drop: bool = False) -> None:
        """Make files of `folder` a part of the dataset, `last` not before all others are there whole.

        Args:
            names: Files and folders.
            last: File that says that they are there.
            drop: Whether `folder` needs them no more.

        Raises:
            StoreError: If the store cannot be reached or refuses; the files stay in `folder`.
        """

    @abstractmethod
    def fetch(self, names: Iterable[str], last: str) -> None:
        """Have in `folder` what `keep` made a part of the dataset, by whomever; nothing happens if `last` is not there.

        Arguments and errors are those of `keep`.
        """

    @abstractmethod
    def leave(self) -> None:
        """Remove `folder` if everything in it is kept elsewhere; the run that made it has ended well."""

    @abstractmethod
    def copy(self, *names: str) -> AbstractContextManager[Path]:
        """Hold a folder on this machine with some files and folders of the dataset, which nobody changes."""


Root = str | Path | Store
"""A dataset by its folder, its address, or as a store."""


def store_of(root: Root, staging: str | Path | None = None, part: str = "0-of-1") -> Store:
    """Return the store that a folder or an address names.

    Args:
        root: A folder, or `s3://bucket/folder?options`; a store is returned as it is.
        staging: Folder on this machine for what is on its way to another place; None for one in the user's cache.
        part: Which part of the dataset is made: each has a folder of its own there.

    Raises:
        InputError: If it is an address of another kind, or not whole.
    """
    if isinstance(root, Store):
        return root
    if "://" in str(root):
        from mmw.storage.s3_store import Bucket

        return Bucket(str(root), staging, part)
    return Folder(root)


class Folder(Store):
    """A dataset in a local folder."""

    def __init__(self, root: str | Path):
        """Name the folder; it need not exist."""
        self._root = Path(root)
        self.address = str(self._root)

    @property
    def folder(self) -> Path:
        return self._root

    @property
    def staging(self) -> Path:
        return self._root

    def where(self, name: str = "") -> str:
        return str(self._root / name)

    def anywhere(self) -> "Folder":
        return Folder(self._root.absolute())

    def check(self) -> None:
        root = self._root
        there = next(path for path in (root, *root.absolute().parents) if path.exists())
        if not there.is_dir():
            raise InputError(f"{root}: {there} is a file; the dataset needs a folder; give another --out")
        if not os.access(there, os.W_OK | os.X_OK):
            raise InputError(f"{root}: {there} cannot be written to; give another --out, or change its permissions")
        try:
            root.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            if error.errno in FULL:
                raise OutOfSpaceError(f"{root}: no space left to make it; free some space and run again") from error
            raise InputError(f"{root}: cannot be made ({error.strerror}); give another --out") from error

    def read(self, name: str) -> bytes | None:
        path = self._root / name
        return path.read_bytes() if path.is_file() else None

    def read_all(self, names: Iterable[str]) -> dict[str, bytes]:
        found = {}
        for name in names:
            try:
                found[name] = (self._root / name).read_bytes()
            except OSError:
                continue
        return found

    def rows(self, name: str, columns: Sequence[str]) -> pa.Table:
        with pq.ParquetFile(self._root / name) as file:
            return file.read(columns=list(columns))

    def top(self) -> list[str]:
        return sorted(path.name for path in self._root.iterdir()) if self._root.is_dir() else []

    def names(self, folder: str = "") -> list[str]:
        """Return the names of all files below a folder, sorted; links count as files, wherever they lead."""
        found = (path for path in (self._root / folder).rglob("*") if path.is_file() or path.is_symlink())
        return sorted(path.relative_to(self._root).as_posix() for path in found)

    def sizes(self, names: Collection[str]) -> dict[str, int]:
        paths = {name: self._root / name for name in names}
        return {name: path.stat().st_size for name, path in paths.items() if path.is_file()}

    def publish(self, name: str, data: bytes) -> None:
        write_bytes_atomically(self._root / name, data)

    def remove(self, names: Iterable[str]) -> None:
        for path in (self._root / name for name in names):
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)

    def claim(self, head: bytes | None) -> None:
        if head is not None:
            self.publish(DATASET, head)

    def keep(self, names: Iterable[str], last: str, *, drop: bool = False) -> None:
        """Nothing is to be done: what is made in the folder is a part of the dataset."""

    def fetch(self, names: Iterable[str], last: str) -> None:
        """Nothing is to be done, see `keep`."""

    def leave(self) -> None:
        """Nothing is to be done: the folder is the dataset."""

    @contextmanager
    def copy(self, *names: str) -> Iterator[Path]:
        yield self._root
