"""Read and write the files of a dataset through a `Store`: a local folder, or a place elsewhere."""

import os
import shutil
import stat
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from mmw.core.errors import InputError
from mmw.storage.atomic_files import DISK_FULL, OutOfSpaceError, StoreError, write_bytes_atomically

DATASET = "dataset.json"
"""File that identifies a dataset: configuration, its hash, versions."""
MANIFEST = "_manifest.parquet"
"""List of all files of a finished dataset."""
LOCKS = "_locks"
"""Folder of the locks (`mmw.storage.lock`); readers skip folders with an underscore."""


class Store:
    """Storage of a dataset in a local folder; a subclass stores it elsewhere and overrides all methods.

    Names of files are relative to it, with slashes. A run writes its files to `folder`, on this machine; `upload` then
    makes them a part of the dataset.
    """

    address: str
    """Path or URL for people."""

    def __init__(self, root: str | Path):
        """Store the path of the folder, which need not exist."""
        self._root = Path(root)
        self.address = str(self._root)
        self._is_begun = False

    def __str__(self) -> str:
        return self.address

    @property
    def folder(self) -> Path:
        """Folder on this machine to which files are written; the dataset itself if that is local."""
        return self._root

    @property
    def staging(self) -> Path:
        """Folder on this machine that contains `folder`, and the locks of the runs on this machine."""
        return self._root

    def location(self, name: str = "") -> str:
        """Return the path or URL of a file, or of the store itself, for people: without connection options."""
        return str(self._root / name)

    def resolved(self) -> "Store":
        """Return the store by an absolute name, valid in any working directory and on machines that share it."""
        store = Store(self._root.absolute())
        store._is_begun = self._is_begun
        return store

    def check_writable(self) -> None:
        """Check that the store can be reached and written to.

        Raises:
            InputError: If not.
            OutOfSpaceError: If the disk is full.
        """
        root = self._root
        existing = next(path for path in (root, *root.absolute().parents) if path.exists())
        if not existing.is_dir():
            raise InputError(f"{root}: {existing} is a file; the dataset needs a folder; give another --out")
        if not os.access(existing, os.W_OK | os.X_OK):
            raise InputError(f"{root}: {existing} cannot be written to; give another --out, or change its permissions")
        try:
            root.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            if error.errno in DISK_FULL:
                raise OutOfSpaceError(f"{root}: no space left to create it; free some space and run again") from error
            raise InputError(f"{root}: cannot be created ({error.strerror}); give another --out") from error

    def check_present(self) -> None:
        """Check that the dataset is still where `start_writing` began it: else its rest would go into a new folder.

        Raises:
            StoreError: If not.
        """
        if self._is_begun and not (self._root / DATASET).is_file():
            raise StoreError(f"{self}: was removed or moved while it was written; run the same command to begin anew")

    def read(self, name: str) -> bytes | None:
        """Return the content of a file; None if it does not exist.

        Raises:
            OSError: If it cannot be read, or nobody can say whether it exists.
        """
        path = self._root / name
        try:
            is_file = stat.S_ISREG(path.stat().st_mode)  # Path.is_file hides a lack of permission, in some versions
        except (FileNotFoundError, NotADirectoryError):
            return None
        return path.read_bytes() if is_file else None

    def read_all(self, names: Iterable[str], *, skip_unreadable: bool = False) -> dict[str, bytes]:
        """Return the contents of the files that exist.

        Raises:
            OSError: As `read`, unless `skip_unreadable`.
        """
        found = {}
        for name in names:
            with suppress(OSError) if skip_unreadable else nullcontext():
                if (data := self.read(name)) is not None:
                    found[name] = data
        return found

    def read_columns(self, name: str, columns: Sequence[str]) -> pa.Table:
        """Return columns of a Parquet file.

        Raises:
            pa.ArrowException, OSError: If it does not exist or is damaged.
            StoreError: If the store cannot be reached or refuses.
        """
        with pq.ParquetFile(self._root / name) as file:
            return file.read(columns=list(columns))

    def top_level_names(self) -> list[str]:
        """Return the names of the files and folders at the top level."""
        return sorted(path.name for path in self._root.iterdir()) if self._root.is_dir() else []

    def names(self, folder: str = "") -> list[str]:
        """Return the names of all files below a folder, sorted; links and special files, such as pipes, are files.

        Raises:
            OSError: If a folder cannot be listed.
        """
        found = []
        for place, folders, files in os.walk(self._root / folder, onerror=_raise_unless_missing):
            links = [name for name in folders if Path(place, name).is_symlink()]
            below = Path(place).relative_to(self._root).as_posix()  # once a folder: of many files, paths take long
            found += [name if below == "." else f"{below}/{name}" for name in (*links, *files)]
        return sorted(found)

    def sizes(self, names: Collection[str]) -> dict[str, int]:
        """Return the sizes [byte] of the files that exist."""
        paths = {name: self._root / name for name in names}
        return {name: path.stat().st_size for name, path in paths.items() if path.is_file()}

    def write_atomically(self, name: str, data: bytes) -> None:
        """Write or replace a file so that readers see all of it or nothing.

        Raises:
            OutOfSpaceError: If the disk is full.
            StoreError: If the store cannot be reached or refuses.
        """
        write_bytes_atomically(self._root / name, data)

    def remove(self, names: Iterable[str]) -> None:
        """Remove files, and folders with their contents, in this order; names that do not exist are skipped."""
        for path in (self._root / name for name in names):
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)

    def start_writing(self, head: bytes | None) -> None:
        """Start or resume writing a dataset: write `dataset.json`, and create `folder`.

        Args:
            head: Content of `dataset.json`; None resumes with the existing one.

        Raises:
            OutOfSpaceError, StoreError: As `write_atomically`.
        """
        if head is not None:
            self.write_atomically(DATASET, head)
        self._is_begun = True

    def upload(self, names: Iterable[str], last: str, *, remove_local: bool = False) -> None:
        """Make files of `folder` a part of the dataset, `last` only after all others are complete.

        Args:
            names: Files and folders.
            last: Marker file that declares them complete.
            remove_local: Remove them from `folder` if that is not the dataset itself.

        Raises:
            StoreError: If the store cannot be reached or refuses; the files stay in `folder`.
        """

    def download(self, names: Iterable[str], last: str) -> None:
        """Copy files of the dataset to `folder`, whichever machine uploaded them; do nothing if `last` does not exist.

        Arguments and errors are those of `upload`.
        """

    def remove_staging(self) -> None:
        """Remove `folder` unless it is the dataset itself, after a run that succeeded."""

    @contextmanager
    def local_copy(self, *names: str) -> Iterator[Path]:
        """Provide a read-only folder on this machine with some files and folders of the dataset."""
        yield self._root


def _raise_unless_missing(error: OSError) -> None:
    if not isinstance(error, FileNotFoundError | NotADirectoryError):
        raise error


Root = str | Path | Store
"""Dataset given by its folder, its URL, or as a store."""


def store_of(root: Root, staging: str | Path | None = None, part: str = "0-of-1") -> Store:
    """Return the store of a folder or of `s3://bucket/folder?options`; a store is returned as it is.

    Files to upload are staged below the folder `staging`, by default in the user's cache; each part has its own.

    Raises:
        InputError: If the URL is of another kind or incomplete.
    """
    if isinstance(root, Store):
        return root
    if "://" in str(root):
        from mmw.storage.s3_store import Bucket

        return Bucket(str(root), staging, part)
    return Store(root)
