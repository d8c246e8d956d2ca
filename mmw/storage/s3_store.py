"""Store a dataset in an S3-compatible bucket: files are written to a local folder, then uploaded, the marker last.

An object exists completely or not at all. The content of the bucket alone decides which work is finished, so that any
machine can resume it from one listing.
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
from mmw.core.file_names import path_inside
from mmw.core.resources import cache_dir
from mmw.core.temp_files import is_temporary
from mmw.storage.atomic_files import StoreError, write_bytes_atomically
from mmw.storage.s3_client import CHECKSUMS, is_chunked, open_client
from mmw.storage.store import DATASET, Store

RETRY_DELAYS_S = (1.0, 5.0, 25.0)
"""Delays before a failed request is repeated [s], after some seconds of retries of the S3 client itself. Design value:
enough for a network failure of a minute."""

MAX_SINGLE_PUT_BYTES = 5_000_000
"""Size up to which objects are uploaded by one request [bytes]. Arrow does so up to 10 MB."""

MAX_SINGLE_LOOKUPS = 64
"""Number of files up to which each is looked up by itself; for more, the whole dataset is listed."""

READ_THREADS = 16
"""Threads that read small files."""

CAUSES = (
    ("NO_SUCH_BUCKET|Bucket '.*' not found", "there is no such bucket", "create it, or correct the address"),
    (
        r"INVALID_ACCESS_KEY|SIGNATURE_DOES_NOT_MATCH|INVALID_CLIENT_TOKEN|UNRECOGNIZED_CLIENT|MISSING_AUTHENTICATION"
        "|ExpiredToken|InvalidToken|TokenRefreshRequired",
        "the credentials are not accepted",
        "check AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN or AWS_PROFILE",
    ),
    (
        r"PermanentRedirect|AuthorizationHeaderMalformed|HTTP status 301",
        "the bucket is in another region",
        "name it in the address: ?region=NAME",
    ),
    (
        "MissingContentLength|HTTP status 411",
        "the server does not take aws-chunked uploads",
        f"set {CHECKSUMS}=when_required, or unset it and name the endpoint in the address (endpoint_override)",
    ),
    (
        r"ACCESS_DENIED|HTTP status 40[13]",
        "permission is denied",
        "set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE, with permission to list, get, put and delete",
    ),
)
"""Error code -> cause and cure, where a retry is of no use."""

UNREACHABLE = (
    r"NETWORK_CONNECTION|curlCode", "it cannot be reached", "check the network, and endpoint_override in the address"
)  # fmt: skip
"""The same for errors that may pass."""

Result = TypeVar("Result")


class Bucket(Store):
    """Dataset below a prefix of a bucket."""

    def __init__(self, address: str, staging: str | Path | None = None, part: str = "0-of-1"):
        """Parse `s3://bucket/folder?endpoint_override=...&region=...`, without a request to the bucket.

        Raises:
            InputError: If the address is not valid, or contains credentials.
        """
        parts = urlsplit(address)
        if "@" in parts.netloc:
            raise InputError(
                f"{parts.scheme}://...@{parts.netloc.rpartition('@')[2]}: credentials must not be in an address, "
                "which is stored with the data; set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"
            )
        if parts.scheme != "s3" or not parts.netloc:
            raise InputError(f"{address}: is not the address of a dataset; give a folder or s3://bucket/folder")
        self.address = address
        self._root = "/".join([parts.netloc, *filter(None, unquote(parts.path).split("/"))])
        self._part = part
        endpoint = parse_qs(parts.query).get("endpoint_override", [""])[0]
        mark = hashlib.sha256(f"{endpoint} {self._root}".encode()).hexdigest()[:8]
        own = re.sub(r"[^\w.-]+", "-", self._root)[-60:].strip("-.")
        self._staging = Path(staging or cache_dir() / "mmw" / "staging").absolute() / f"{own}-{mark}"
        self._synchronized: set[str] = set()
        """Files that are the same in the bucket and in `folder`."""

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the connections, which each process opens itself."""
        return {name: value for name, value in self.__dict__.items() if name not in ("_system", "_single")}

    @cached_property
    def folder(self) -> Path:
        """Folder to which files are written; its name depends on `dataset.json`, so that no two datasets share one."""
        head = self.read(DATASET)
        if head is None:
            raise InputError(f"{self.location()}: has no {DATASET}; it is no dataset; run its configuration again")
        return self._staging / f"{hashlib.sha256(head).hexdigest()[:12]}.{self._part}"

    @property
    def staging(self) -> Path:
        return self._staging

    def location(self, name: str = "") -> str:
        return "/".join(part for part in (f"s3://{self._root}", name) if part)

    def resolved(self) -> "Bucket":
        return self

    def check_writable(self) -> None:
        Store(self._staging).check_writable()
        try:
            self._list("", recursive=False, delays_s=())
        except StoreError as error:
            raise InputError(str(error)) from error

    def check_present(self) -> None:
        """Do nothing: each upload is complete by itself, and the last step of a run reads the dataset's identity."""

    def read(self, name: str) -> bytes | None:
        def read() -> bytes | None:
            try:
                with self._system.open_input_stream(self._path(name), compression=None) as stream:
                    return stream.read()
            except FileNotFoundError:
                return None

        return self._request("read", name, read)

    def read_all(self, names: Iterable[str], *, skip_unreadable: bool = False) -> dict[str, bytes]:
        names = list(names)
        if len(names) > MAX_SINGLE_LOOKUPS:
            tops = sorted({name.partition("/")[0] for name in names})
            existing = {name for top in tops for name in self._sizes(top)}
            names = [name for name in names if name in existing]
        with ThreadPoolExecutor(READ_THREADS) as pool:
            found = pool.map(self.read, names)
            return {name: data for name, data in zip(names, found, strict=True) if data is not None}

    def read_columns(self, name: str, columns: Sequence[str]) -> pa.Table:
        def read() -> pa.Table | Exception:
            try:
                with self._system.open_input_file(self._path(name)) as source, pq.ParquetFile(source) as file:
                    return file.read(columns=list(columns))
            except (pa.ArrowException, OSError) as error:
                if "AWS Error" in str(error):
                    raise
                return error  # the file is damaged or missing

        found = self._request("read", name, read)
        if isinstance(found, Exception):
            raise found
        return found

    def top_level_names(self) -> list[str]:
        return sorted(self._name(info) for info in self._list("", recursive=False))

    def names(self, folder: str = "") -> list[str]:
        return sorted(self._sizes(folder))

    def sizes(self, names: Collection[str]) -> dict[str, int]:
        if len(names) > MAX_SINGLE_LOOKUPS:
            found = self._sizes("")
            return {name: found[name] for name in names if name in found}
        paths = [self._path(name) for name in names]
        infos = self._request("looked at", "", lambda: self._system.get_file_info(paths)) if paths else []
        return {self._name(info): info.size for info in infos if info.type == pafs.FileType.File}

    def write_atomically(self, name: str, data: bytes) -> None:
        self._request("written", name, lambda: self._put(name, data))

    def remove(self, names: Iterable[str]) -> None:
        for name in names:
            path = self._path(name)
            kind = self._request("looked at", name, lambda path=path: self._system.get_file_info(path)).type
            if kind == pafs.FileType.Directory:
                self._request("removed", name, lambda path=path: self._system.delete_dir(path))
            elif kind == pafs.FileType.File:
                self._request("removed", name, lambda path=path: self._system.delete_file(path))

    def start_writing(self, head: bytes | None) -> None:
        head = head or self.read(DATASET)
        if head is not None:
            self.write_atomically(DATASET, head)  # unchanged if it exists: this tests early that the bucket is writable
            self._check_plain(DATASET)
        self.folder.mkdir(parents=True, exist_ok=True)
        is_whole = self._part == "0-of-1"  # then no other run uses this folder
        for other in self._staging.iterdir():
            named = re.fullmatch(r"[0-9a-f]{12}\.(\d+-of-\d+)", other.name)
            if named and other != self.folder and (is_whole or named[1] == self._part):
                shutil.rmtree(other, ignore_errors=True)

    def upload(self, names: Iterable[str], last: str, *, remove_local: bool = False) -> None:
        files = self._local_sizes(names)
        data = (self.folder / last).read_bytes()
        if self.read(last) != data or self._missing(files):
            for name in files:
                if name not in self._synchronized:
                    self.write_atomically(name, (self.folder / name).read_bytes())
            if wrong := self._missing(files):
                raise StoreError(self._message("written", wrong[0], "it is incomplete or missing after its upload"))
            self.write_atomically(last, data)
        if remove_local:
            for name in (*files, last):  # the marker last: without it the other files would be ignored
                (self.folder / name).unlink(missing_ok=True)
        else:
            self._synchronized.update(files)

    def download(self, names: Iterable[str], last: str) -> None:
        data = self.read(last)
        marker = self.folder / last
        if data is None or (marker.is_file() and marker.read_bytes() == data):
            return
        outdated = [name for name in self._expand(names) if name not in self._synchronized]
        self._download(outdated, self.folder)
        self._synchronized.update(outdated)
        write_bytes_atomically(marker, data)

    def remove_staging(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)

    @contextmanager
    def local_copy(self, *names: str) -> Iterator[Path]:
        with tempfile.TemporaryDirectory(prefix="mmw-") as folder:
            self._download(self._expand(names), Path(folder))
            yield Path(folder)

    def _check_plain(self, name: str) -> None:
        """Check that the server stored a text as it was uploaded, not as it was sent.

        Raises:
            StoreError: If not: nothing that is written there could be read.
        """
        if is_chunked(self.read(name) or b""):
            raise StoreError(
                f"{self.location(name)}: is stored with the framing of its upload: this server does not decode "
                f"aws-chunked uploads; set {CHECKSUMS}=when_required, or unset it and name the endpoint in the address "
                "(endpoint_override), and make the dataset again with --overwrite"
            )

    def _local_sizes(self, names: Iterable[str]) -> dict[str, int]:
        """Return the sizes [bytes] of files in `folder`; a folder is replaced by its files."""
        files: dict[str, int] = {}
        for name in names:
            path = self.folder / name
            for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
                if file.is_file() and not is_temporary(file):
                    files[file.relative_to(self.folder).as_posix()] = file.stat().st_size
        return files

    def _missing(self, files: dict[str, int]) -> list[str]:
        """Return the files that do not exist in the bucket with their sizes."""
        found = self.sizes(files.keys())
        return [name for name, size in files.items() if found.get(name) != size]

    def _expand(self, names: Iterable[str]) -> list[str]:
        """Return the names of existing files, with folders replaced by their files."""
        return [name for top in names for name in ([top] if self.sizes([top]) else self.names(top))]

    def _download(self, names: Sequence[str], folder: Path) -> None:
        def download(name: str) -> None:
            data = self.read(name)
            if data is not None:
                write_bytes_atomically(path_inside(folder, name), data)

        with ThreadPoolExecutor(READ_THREADS) as pool:
            list(pool.map(download, names))

    def _put(self, name: str, data: bytes) -> None:
        """Upload an object from complete data: closing a stream of Arrow commits what was written to it."""

        def put() -> None:
            system = self._single if len(data) <= MAX_SINGLE_PUT_BYTES else self._system
            stream = system.open_output_stream(self._path(name), compression=None)
            stream.write(data)
            stream.close()

        with ThreadPoolExecutor(1) as pool:  # where Ctrl-C cannot interrupt it
            pool.submit(put).result()

    def _sizes(self, folder: str) -> dict[str, int]:
        found = self._list(folder, recursive=True)
        return {self._name(info): info.size for info in found if info.type == pafs.FileType.File}

    def _list(self, folder: str, *, recursive: bool, delays_s: tuple[float, ...] | None = None) -> list[pafs.FileInfo]:
        selector = pafs.FileSelector(self._path(folder), recursive=recursive, allow_not_found=True)
        return self._request("listed", folder, lambda: self._system.get_file_info(selector), delays_s)

    def _path(self, name: str) -> str:
        return f"{self._root}/{name}" if name else self._root

    def _name(self, info: pafs.FileInfo) -> str:
        return info.path[len(self._root) + 1 :]

    @cached_property
    def _system(self) -> pafs.FileSystem:
        """File system of the bucket; objects are uploaded in parts."""
        return open_client(self.address)

    @cached_property
    def _single(self) -> pafs.FileSystem:
        """File system of the bucket; small objects are uploaded by one request."""
        return open_client(self.address, is_delayed=True)

    def _request(
        self, verb: str, name: str, send: Callable[[], Result], delays_s: tuple[float, ...] | None = None
    ) -> Result:
        """Send a request, and repeat it after a delay if the error may pass; else raise `StoreError`."""
        for delay_s in (*(RETRY_DELAYS_S if delays_s is None else delays_s), None):
            try:
                return send()
            except FileNotFoundError:
                raise
            except (pa.ArrowException, OSError) as error:
                reason = " ".join(str(error).split())
                is_permanent = isinstance(error, pa.ArrowInvalid) or any(re.search(c[0], reason) for c in CAUSES)
                if delay_s is None or is_permanent:
                    raise StoreError(self._message(verb, name, reason)) from error
            time.sleep(delay_s)
        raise AssertionError("unreachable")

    def _message(self, verb: str, name: str, reason: str) -> str:
        where = self.location(name)
        for pattern, cause, cure in (*CAUSES, UNREACHABLE):
            if re.search(pattern, reason):
                return f"{where}: cannot be {verb}: {cause} ({reason}); {cure}"
        return f"{where}: cannot be {verb} ({reason}); check the address and the state of the store"
