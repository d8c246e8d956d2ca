"""A dataset in an S3-compatible store: files are made in a folder on this machine, then put; the marker goes last.

An object is there whole or not at all. What decides what is done is what the store holds: one listing says it, to
whatever machine asks.
"""

import hashlib
import re
import shutil
import tempfile
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import parse_qs, unquote, urlsplit

import pyarrow as pa
import pyarrow.fs as pafs
import pyarrow.parquet as pq

from mmw.core.errors import InputError
from mmw.core.resources import cache_dir
from mmw.core.temp_files import is_temporary
from mmw.storage.atomic_files import StoreError, write_bytes_atomically
from mmw.storage.store import DATASET, Folder, Store

WAITS_S = (1.0, 5.0, 25.0)
"""Pauses before a request that failed is tried again [s]; the S3 client has tried it for some seconds each time. Design
value: a minute without network passes unnoticed."""

SINGLE_PUT = 5_000_000
"""Objects up to this size are put by one request [byte]. Arrow sends up to 10 MB so, and what is more in parts."""

FEW = 64
"""Files up to which each is asked for by itself, where otherwise the whole dataset is listed."""

READERS = 16
"""Threads that read small files."""

CAUSES = (
    ("NO_SUCH_BUCKET|Bucket '.*' not found", "there is no such bucket", "make it, or correct the address"),
    (
        r"INVALID_ACCESS_KEY|SIGNATURE_DOES_NOT_MATCH|INVALID_CLIENT_TOKEN|UNRECOGNIZED_CLIENT|MISSING_AUTHENTICATION"
        "|ExpiredToken|InvalidToken|TokenRefreshRequired",
        "the credentials are not accepted",
        "see AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN or AWS_PROFILE",
    ),
    (
        r"PermanentRedirect|AuthorizationHeaderMalformed|HTTP status 301",
        "the bucket is in another region",
        "name it in the address: ?region=NAME",
    ),
    (
        r"ACCESS_DENIED|HTTP status 40[13]",
        "permission is denied",
        "set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE, of who may list, get, put and delete there",
    ),
)
"""Error code -> cause and cure, where a retry is of no use."""

UNREACHABLE = (
    r"NETWORK_CONNECTION|curlCode", "it cannot be reached", "see the network, and endpoint_override in the address"
)  # fmt: skip
"""The same where trying again may help."""

Result = TypeVar("Result")


class Bucket(Store):
    """A dataset below a prefix of a bucket."""

    def __init__(self, address: str, staging: str | Path | None = None, part: str = "0-of-1"):
        """Name the place; nothing is asked of it yet.

        Args:
            address: `s3://bucket/folder`, with options as pyarrow has them: `?endpoint_override=...&region=...`.
            staging: Folder on this machine below which files are made; None for one in the user's cache.
            part: Which part of the dataset is made from here.

        Raises:
            InputError: If it is no such address, or holds credentials.
        """
        parts = urlsplit(address)
        if "@" in parts.netloc:
            raise InputError(
                f"{parts.scheme}://...@{parts.netloc.rpartition('@')[2]}: credentials do not belong into an address, "
                "which is stored with the data; set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"
            )
        if parts.scheme != "s3" or not parts.netloc:
            raise InputError(f"{address}: is no place for a dataset; give a folder or s3://bucket/folder")
        self.address = address
        self._root = "/".join([parts.netloc, *filter(None, unquote(parts.path).split("/"))])
        self._part = part
        endpoint = parse_qs(parts.query).get("endpoint_override", [""])[0]
        mark = hashlib.sha256(f"{endpoint} {self._root}".encode()).hexdigest()[:8]
        own = re.sub(r"[^\w.-]+", "-", self._root)[-60:].strip("-.")
        self._staging = Path(staging or cache_dir() / "mmw" / "staging").absolute() / f"{own}-{mark}"
        self._same: set[str] = set()
        """Files that are in the store as they are in `folder`."""

    def __getstate__(self) -> dict[str, Any]:
        """Leave the connections out: another process opens its own."""
        return {name: value for name, value in self.__dict__.items() if name not in ("_system", "_single")}

    @cached_property
    def folder(self) -> Path:
        """Folder in which files of this very dataset are made: what is left of another one is in another folder."""
        head = self.read(DATASET)
        if head is None:
            raise InputError(f"{self.where()}: has no {DATASET}; it is no dataset; run its configuration again")
        return self._staging / f"{hashlib.sha256(head).hexdigest()[:12]}.{self._part}"

    @property
    def staging(self) -> Path:
        return self._staging

    def where(self, name: str = "") -> str:
        return "/".join(part for part in (f"s3://{self._root}", name) if part)

    def anywhere(self) -> "Bucket":
        return self

    def check(self) -> None:
        Folder(self._staging).check()
        try:
            self._do("listed", "", lambda: self._list("", recursive=False), waits=())
        except StoreError as error:
            raise InputError(str(error)) from error

    def read(self, name: str) -> bytes | None:
        def read() -> bytes | None:
            try:
                with self._system.open_input_stream(self._path(name), compression=None) as stream:
                    return stream.read()
            except FileNotFoundError:
                return None

        return self._do("read", name, read)

    def read_all(self, names: Iterable[str]) -> dict[str, bytes]:
        names = list(names)
        if len(names) > FEW:
            there = {name for top in sorted({name.partition("/")[0] for name in names}) for name in self._sizes(top)}
            names = [name for name in names if name in there]
        with ThreadPoolExecutor(READERS) as pool:
            found = pool.map(self.read, names)
            return {name: data for name, data in zip(names, found, strict=True) if data is not None}

    def rows(self, name: str, columns: Sequence[str]) -> pa.Table:
        def read() -> pa.Table | Exception:
            try:
                with self._system.open_input_file(self._path(name)) as source, pq.ParquetFile(source) as file:
                    return file.read(columns=list(columns))
            except (pa.ArrowException, OSError) as error:
                if "AWS Error" in str(error):
                    raise
                return error  # it is the file's fault

        found = self._do("read", name, read)
        if isinstance(found, Exception):
            raise found
        return found

    def top(self) -> list[str]:
        found = self._do("listed", "", lambda: self._list("", recursive=False))
        return sorted(self._name(info) for info in found)

    def names(self, folder: str = "") -> list[str]:
        return sorted(self._sizes(folder))

    def sizes(self, names: Collection[str]) -> dict[str, int]:
        if len(names) > FEW:
            found = self._sizes("")
            return {name: found[name] for name in names if name in found}
        paths = [self._path(name) for name in names]
        infos = self._do("looked at", "", lambda: self._system.get_file_info(paths)) if paths else []
        return {self._name(info): info.size for info in infos if info.type == pafs.FileType.File}

    def publish(self, name: str, data: bytes) -> None:
        self._do("written", name, lambda: _undisturbed(lambda: self._put(name, data)))

    def remove(self, names: Iterable[str]) -> None:
        for name in names:
            path = self._path(name)
            kind = self._do("looked at", name, lambda path=path: self._system.get_file_info(path)).type
            if kind == pafs.FileType.Directory:
                self._do("removed", name, lambda path=path: self._system.delete_dir(path))
            elif kind == pafs.FileType.File:
                self._do("removed", name, lambda path=path: self._system.delete_file(path))

    def claim(self, head: bytes | None) -> None:
        head = head or self.read(DATASET)
        if head is not None:
            self.publish(DATASET, head)  # also as it is: to know before anything is made whether it can be written
        self.folder.mkdir(parents=True, exist_ok=True)
        is_whole = self._part == "0-of-1"  # then nobody else writes here
        for other in self._staging.iterdir():
            named = re.fullmatch(r"[0-9a-f]{12}\.(\d+-of-\d+)", other.name)
            if named and other != self.folder and (is_whole or named[1] == self._part):
                shutil.rmtree(other, ignore_errors=True)

    def keep(self, names: Iterable[str], last: str, *, drop: bool = False) -> None:
        files = self._here(names)
        data = (self.folder / last).read_bytes()
        if self.read(last) != data or self._differing(files):
            for name in files:
                if name not in self._same:
                    self.publish(name, (self.folder / name).read_bytes())
            if wrong := self._differing(files):
                raise StoreError(self._said("written", wrong[0], "it is not there whole after it was put"))
            self.publish(last, data)
        if drop:
            for name in (*files, last):  # the marker last: without it nothing that is left counts
                (self.folder / name).unlink(missing_ok=True)
        else:
            self._same.update(files)

    def fetch(self, names: Iterable[str], last: str) -> None:
        data = self.read(last)
        here = self.folder / last
        if data is None or (here.is_file() and here.read_bytes() == data):
            return
        there = [name for name in self._below(names) if name not in self._same]
        self._bring(there, self.folder)
        self._same.update(there)
        write_bytes_atomically(here, data)

    def leave(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)

    @contextmanager
    def copy(self, *names: str) -> Iterator[Path]:
        with tempfile.TemporaryDirectory(prefix="mmw-") as made:
            self._bring(self._below(names), Path(made))
            yield Path(made)

    def _here(self, names: Iterable[str]) -> dict[str, int]:
        """Return files of `folder` and their sizes [byte]; a folder stands for the files in it."""
        files: dict[str, int] = {}
        for name in names:
            path = self.folder / name
            for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
                if file.is_file() and not is_temporary(file):
                    files[file.relative_to(self.folder).as_posix()] = file.stat().st_size
        return files

    def _differing(self, files: dict[str, int]) -> list[str]:
        """Return the files that are not in the store with their sizes."""
        there = self.sizes(files.keys())
        return [name for name, size in files.items() if there.get(name) != size]

    def _below(self, names: Iterable[str]) -> list[str]:
        """Return the files that are there of some files and folders."""
        return [name for top in names for name in ([top] if self.sizes([top]) else self.names(top))]

    def _bring(self, names: Sequence[str], folder: Path) -> None:
        def bring(name: str) -> None:
            data = self.read(name)
            if data is not None:
                write_bytes_atomically(folder / name, data)

        with ThreadPoolExecutor(READERS) as pool:
            list(pool.map(bring, names))

    def _put(self, name: str, data: bytes) -> None:
        """Put an object. The data is at hand before it is begun: closing a stream publishes what was written to it."""
        system = self._single if len(data) <= SINGLE_PUT else self._system
        stream = system.open_output_stream(self._path(name), compression=None)
        stream.write(data)
        stream.close()

    def _sizes(self, folder: str) -> dict[str, int]:
        found = self._do("listed", folder, lambda: self._list(folder, recursive=True))
        return {self._name(info): info.size for info in found if info.type == pafs.FileType.File}

    def _list(self, folder: str, *, recursive: bool) -> list[pafs.FileInfo]:
        selector = pafs.FileSelector(self._path(folder), recursive=recursive, allow_not_found=True)
        return self._system.get_file_info(selector)

    def _path(self, name: str) -> str:
        return f"{self._root}/{name}" if name else self._root

    def _name(self, info: pafs.FileInfo) -> str:
        return info.path[len(self._root) + 1 :]

    @cached_property
    def _system(self) -> pafs.FileSystem:
        """The store; objects are put in parts."""
        return pafs.FileSystem.from_uri(self.address)[0]

    @cached_property
    def _single(self) -> pafs.FileSystem:
        """The store; objects are put by one request, as far as they are small. With a large one that could not be begun
        Arrow would leave an empty object."""
        sign = "&" if "?" in self.address else "?"
        try:
            return pafs.FileSystem.from_uri(f"{self.address}{sign}allow_delayed_open=true")[0]
        except pa.ArrowInvalid:
            return self._system  # until version 20 addresses do not have that option

    def _do(self, done: str, name: str, work: Callable[[], Result], waits: tuple[float, ...] | None = None) -> Result:
        """Ask something of the store, and again after a pause where that may help.

        Raises:
            StoreError: If it cannot be reached or refuses.
            FileNotFoundError: If there is no such object.
        """
        for wait in (*(WAITS_S if waits is None else waits), None):
            try:
                return work()
            except FileNotFoundError:
                raise
            except (pa.ArrowException, OSError) as error:
                reason = " ".join(str(error).split())
                is_lasting = isinstance(error, pa.ArrowInvalid) or any(re.search(cause[0], reason) for cause in CAUSES)
                if wait is None or is_lasting:
                    raise StoreError(self._said(done, name, reason)) from error
            time.sleep(wait)
        raise AssertionError("unreachable")

    def _said(self, done: str, name: str, reason: str) -> str:
        where = self.where(name)
        for pattern, cause, cure in (*CAUSES, UNREACHABLE):
            if re.search(pattern, reason):
                return f"{where}: cannot be {done}: {cause} ({reason}); {cure}"
        return f"{where}: cannot be {done} ({reason}); see the address and the state of the store"


def _undisturbed(work: Callable[[], None]) -> None:
    """Do something in a thread of its own, which no Ctrl-C can interrupt halfway."""
    with ThreadPoolExecutor(1) as pool:
        pool.submit(work).result()
