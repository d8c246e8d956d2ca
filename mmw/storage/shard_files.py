"""Read and hash the files of shards, compare them with their markers, and check the rows of several shards at once."""

import hashlib
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from mmw.storage.finding import Finding, one_line
from mmw.storage.parquet_schema import arrow_schema
from mmw.storage.parquet_writer import ROWS
from mmw.storage.row_checks import Chunk, CountRows, check_chunk, columns_to_read
from mmw.storage.schema_checks import check_version, schema_problem
from mmw.storage.schemas import SCHEMA_VERSION, TABLES
from mmw.storage.shard_writer import FILE_META, key_of
from mmw.storage.store import Store
from mmw.storage.table_spec import TableSpec

THREADS = min(os.cpu_count() or 1, 8)
"""Files that a process reads at once."""

MAX_AHEAD, AHEAD_BYTES = 8, 64 << 20
"""Shards, and size of their files [byte], that are read before they are needed."""


def check_shards(
    store: Store, markers: Iterable[dict], count_rows: CountRows | None = None, threads: int = THREADS
) -> Iterator[Finding]:
    """Yield what is wrong with the files that markers list, and with their rows.

    The rows of a chunk are checked while the files of the next are read.

    Args:
        store: Dataset.
        markers: Markers whose list of files is right.
        count_rows: Compares the rows of files in which nothing is wrong with a configuration.
        threads: Files that are read at once; 1 starts no thread.
    """
    more = {} if count_rows is None else count_rows.columns
    tables = {name: _Layout(spec, more.get(name, ())) for name, spec in TABLES.items()}
    is_alone = threads == 1
    with (
        _Inline() if is_alone else ThreadPoolExecutor(threads) as pool,
        _Inline() if is_alone else ThreadPoolExecutor(1) as checking,
    ):

        def begin(marker: dict) -> _Shard:
            return _Shard(marker, [pool.submit(_read_file, store, file, marker, tables) for file in marker["files"]])

        def check(chunk: Chunk) -> list[Finding]:
            return list(check_chunk(chunk, count_rows))

        chunk, checked = Chunk(""), checking.submit(check, Chunk(""))
        for shard in _ahead(begin, markers):
            if chunk.is_full or chunk.scenario != shard.marker["scenario"]:
                yield from checked.result()
                chunk, checked = Chunk(shard.marker["scenario"]), checking.submit(check, chunk)
            chunk.keys.append(key_of(shard.marker))
            found: list[Finding] = []
            for file, read in zip(shard.marker["files"], shard.reads, strict=True):
                problems, rows = read.result()
                found += problems
                if rows is not None:
                    chunk.add(file["table"], rows, file["bytes"])
            if found:
                chunk.wrong.add(len(chunk.keys) - 1)
            yield from found
        yield from checked.result()
        yield from check(chunk)


class _Inline(Executor):
    """Executor without threads, whose hand-overs take longer than small files."""

    def submit(self, fn: Callable, /, *args: Any, **kwargs: Any) -> Future:
        done: Future = Future()
        done.set_result(fn(*args, **kwargs))
        return done


@dataclass
class _Shard:
    """A marker whose files are being read."""

    marker: dict
    reads: list[Future[tuple[list[Finding], pa.Table | None]]]

    @property
    def nbytes(self) -> int:
        """Size of its files [byte]."""
        return sum(file["bytes"] for file in self.marker["files"])


def _ahead(begin: Callable[[dict], _Shard], markers: Iterable[dict]) -> Iterator[_Shard]:
    """Yield shards in order, of which the next ones are begun, as many as are small."""
    begun: deque[_Shard] = deque()
    for marker in markers:
        begun.append(begin(marker))
        while len(begun) > MAX_AHEAD or sum(shard.nbytes for shard in begun) > AHEAD_BYTES:
            yield begun.popleft()
    yield from begun


class _Layout:
    """Columns of a table, worked out once for all its files."""

    def __init__(self, spec: TableSpec, more: Sequence[str]) -> None:
        self.spec, self.schema, self.more = spec, arrow_schema(spec), more
        self.to_read = columns_to_read(self.schema, spec, more)
        self.needed = ["scenario", *(["weather"] if spec.of_weather else []), *spec.key, *spec.unique, *more]
        self._known: dict[bytes, pq.ParquetSchema] = {}

    def is_known(self, metadata: pq.FileMetaData, stored: bytes) -> bool:
        """Return whether another file with the same schemas, of Arrow and of Parquet, was found to be right."""
        return stored in self._known and metadata.schema.equals(self._known[stored])

    def remember(self, metadata: pq.FileMetaData, stored: bytes) -> None:
        """Remember the schemas of a file in which nothing is wrong."""
        self._known[stored] = metadata.schema


def _read_file(
    store: Store, file: dict, marker: dict, tables: Mapping[str, _Layout]
) -> tuple[list[Finding], pa.Table | None]:
    """Return what is wrong with a file, and the rows to check if nothing is."""
    name, table = file["path"], tables.get(file["table"])
    try:
        data = store.read(name)
    except OSError as error:
        return [Finding("unreadable", name, one_line(error))], None
    if data is None:
        return [Finding("missing", name, "the marker lists it, but it does not exist")], None
    if len(data) != file["bytes"]:
        return [Finding("size", name, f"{len(data)} bytes; the marker has {file['bytes']}")], None
    if hashlib.sha256(data).hexdigest() != file["sha256"]:
        return [Finding("sha256", name, "the content is not what was written")], None
    if table is None:
        text = f"table {file['table']!r} is not known to this mmw (schema {SCHEMA_VERSION})"
        return [Finding("schema", name, text)], None
    try:
        with pq.ParquetFile(pa.BufferReader(data)) as parquet:
            metadata = parquet.metadata
            meta = metadata.metadata or {}
            found = list(_check_footer(metadata.num_rows, meta, file, marker))
            version = meta.get(b"mmw.schema_version", b"none")
            needed, stored = table.to_read, meta.get(b"ARROW:schema", b"") + version
            if not table.is_known(metadata, stored):
                schema = parquet.schema_arrow
                found += _check_schema(schema, _text(version), name, table)
                if len(schema) != len(table.schema):  # of an older schema version
                    needed = columns_to_read(schema, table.spec, table.more)
                elif not found:
                    table.remember(metadata, stored)
            if found:
                return found, None
            return [], parquet.read(columns=needed, use_threads=False)
    except (pa.ArrowException, OSError) as error:
        return [Finding("parquet", name, f"cannot be read: {one_line(error)}")], None


def _check_footer(count: int, meta: Mapping[bytes, bytes], file: dict, marker: dict) -> Iterator[Finding]:
    """Yield what is wrong with the number of rows and the file-level keys of a file."""
    name = file["path"]
    if count != file["rows"]:
        yield Finding("rows", name, f"{count} rows; the marker has {file['rows']}")
    written = meta.get(ROWS.encode())
    if written and written != str(count).encode():
        yield Finding("rows", name, f"{count} rows; {_text(written)} were written; it was changed since")
    for key, label in FILE_META.items():
        text = meta.get(label.encode())
        if text is not None and text != str(marker.get(key)).encode():
            yield Finding("marker", name, f"{key} is {_text(text)[:80]}; the marker has another")


def _check_schema(found: pa.Schema, version: str, name: str, table: _Layout) -> Iterator[Finding]:
    """Yield what is wrong with the columns of a file."""
    own = table.schema
    if version != SCHEMA_VERSION:
        yield from check_version(name, version)
    if version == SCHEMA_VERSION:
        if not found.equals(own):
            yield Finding("schema", name, f"columns are not those of table {table.spec.name!r}")
    elif problem := schema_problem(found, table.spec, table.needed):
        yield Finding("schema", name, problem)
    elif any(field.name not in own.names or not own.field(field.name).equals(field) for field in found):
        yield Finding("schema", name, f"columns of schema {version} are not among those of table {table.spec.name!r}")


def _text(data: bytes) -> str:
    return data.decode(errors="replace")
