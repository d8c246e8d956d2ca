"""Verify the files of a dataset against its markers: read and hash each file, and check the keys of its rows."""

import hashlib
import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from pathlib import PurePosixPath
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from mmw.core.errors import InputError
from mmw.core.temp_files import is_temporary
from mmw.storage.finding import Finding, one_line
from mmw.storage.identity import inputs_sha256, is_of, mixtures
from mmw.storage.manifest import DATASET, MANIFEST, manifest_rows, named_markers, read_dataset
from mmw.storage.parquet_schema import arrow_schema
from mmw.storage.parquet_writer import ROWS
from mmw.storage.row_checks import Chunk, CountRows, check_chunk, columns_to_read
from mmw.storage.schema_checks import schema_problem
from mmw.storage.schemas import SCHEMA_VERSION, TABLES
from mmw.storage.shard_writer import FILE_META, MARKERS, TABLE_FILE, ShardKey, key_of, marker_path, table_path
from mmw.storage.store import Root, Store, store_of
from mmw.storage.table_spec import TableSpec

THREADS = min(os.cpu_count() or 1, 8)
"""Files that are read at once."""

MAX_AHEAD, AHEAD_BYTES = 8, 64 << 20
"""Shards, and size of their files [byte], that are read before they are needed."""


def verify(root: Root, count_rows: CountRows | None = None) -> list[Finding]:
    """Return all problems of a dataset; none means that every file matches its marker.

    Args:
        root: Dataset.
        count_rows: Compares the rows of files in which nothing is wrong with a configuration.

    Raises:
        InputError: If it is not a dataset.
        StoreError: If a store cannot be reached.
    """
    return list(_find(store_of(root), count_rows))


def _find(store: Store, count_rows: CountRows | None) -> Iterator[Finding]:
    head = read_dataset(store)
    yield from _check_version(DATASET, head["schema_version"])
    if "inputs" in head and inputs_sha256(head["inputs"]) != head["inputs_sha256"]:
        yield Finding("inputs", DATASET, "its inputs do not have its inputs_sha256; the file was changed")
    markers = named_markers(store, skip_unreadable=True)  # the others are findings
    for name in store.names(MARKERS):
        if name.endswith(".json") and name not in markers:
            yield Finding("marker", name, "cannot be read; run the configuration again")
    listed: dict[str, dict] = {}
    yield from _check_files(store, head, markers, listed, count_rows)
    yield from check_makers(head, markers)
    yield from _check_overlaps(markers)
    yield from _check_others(store, listed)
    yield from check_manifest(store, markers)


def _check_files(
    store: Store, head: Mapping[str, Any], markers: Mapping[str, dict], listed: dict[str, dict],
    count_rows: CountRows | None,
) -> Iterator[Finding]:  # fmt: skip
    """Yield what is wrong with markers, their files and the rows of these, and add the files to `listed`.

    The rows of a chunk are checked while the files of the next are read.
    """
    more = {} if count_rows is None else count_rows.columns
    tables = {name: _Layout(spec, more.get(name, ())) for name, spec in TABLES.items()}
    with ThreadPoolExecutor(THREADS) as pool, ThreadPoolExecutor(1) as checking:

        def begin(name: str, marker: dict) -> _Shard:
            found = list(_check_marker(name, marker, head, listed))
            reads = [] if found else [pool.submit(_read_file, store, file, marker, tables) for file in marker["files"]]
            if marker_path(key_of(marker)).as_posix() == name:  # else the files are another shard's
                listed.update((file["path"], file) for file in marker["files"])
            return _Shard(marker, found, reads)

        def check(chunk: Chunk) -> list[Finding]:
            return list(check_chunk(chunk, count_rows))

        chunk, checked = Chunk(""), checking.submit(check, Chunk(""))
        for shard in _ahead(begin, markers):
            if chunk.is_full or chunk.scenario != shard.marker["scenario"]:
                yield from checked.result()
                chunk, checked = Chunk(shard.marker["scenario"]), checking.submit(check, chunk)
            chunk.keys.append(key_of(shard.marker))
            for file, read in zip(shard.marker["files"], shard.reads, strict=False):  # no file of a wrong marker
                problems, rows = read.result()
                shard.found.extend(problems)
                if rows is not None:
                    chunk.add(file["table"], rows, file["bytes"])
            if shard.found:
                chunk.wrong.add(len(chunk.keys) - 1)
            yield from shard.found
        yield from checked.result()
        yield from check(chunk)


@dataclass
class _Shard:
    """A marker whose files are being read."""

    marker: dict
    found: list[Finding]
    reads: list[Future[tuple[list[Finding], pa.Table | None]]]

    @property
    def nbytes(self) -> int:
        """Size of its files [byte]."""
        return sum(file["bytes"] for file in self.marker["files"])


def _ahead(begin: Callable[[str, dict], _Shard], markers: Mapping[str, dict]) -> Iterator[_Shard]:
    """Yield shards in order, of which the next ones are begun, as many as are small."""
    begun: deque[_Shard] = deque()
    for name, marker in markers.items():
        begun.append(begin(name, marker))
        while len(begun) > MAX_AHEAD or sum(shard.nbytes for shard in begun) > AHEAD_BYTES:
            yield begun.popleft()
    yield from begun


def _check_marker(name: str, marker: dict, head: Mapping[str, Any], listed: Mapping[str, dict]) -> Iterator[Finding]:
    """Yield what is wrong with a marker and its list of files."""
    key = key_of(marker)
    if marker_path(key).as_posix() != name:
        yield Finding("marker", name, f"is the marker of {key}; put its own back, or run the configuration again")
        return
    yield from _check_version(name, marker["schema_version"])
    yield from _check_listed(marker, key, head, listed)


def check_makers(head: Mapping[str, Any], markers: Mapping[str, dict]) -> Iterator[Finding]:
    """Yield shards of other software or another machine than the dataset was begun with, and mixtures of them.

    A difference is an error if the run that made a shard was not told to accept it: someone has copied the shard.
    """
    for text in mixtures(markers.values()):
        yield Finding("mixed", MARKERS, text)
    for key, kind in (("software", "versions"), ("device", "machine")):
        first = head["versions"].get(key)
        wrong = [
            (name, marker[key])
            for name, marker in markers.items()
            if first and marker.get("software") and marker.get(key) and marker[key] != first
            and kind not in str(marker.get("accepted")).split()
        ]  # fmt: skip
        if wrong:
            name, made = wrong[0]
            more = f" and {len(wrong) - 1} more markers" if len(wrong) > 1 else ""
            yield Finding(
                "versions", name, f"{key} {made}{more}; the dataset was begun with {first}, and no run was told to "
                f"--accept {kind}; the shards are of another dataset; run the configuration again with --overwrite"
            )  # fmt: skip


def version_number(text: str) -> tuple[int, int]:
    """Return the major and minor number of a schema version.

    Raises:
        InputError: If the text is not a version.
    """
    major, dot, minor = str(text).partition(".")
    if not (dot and major.isdecimal() and minor.isdecimal() and len(text) < 20):
        raise InputError(f"schema version {text!r} is not MAJOR.MINOR; the file is damaged or of another program")
    return int(major), int(minor)


def _check_version(path: str, text: str) -> Iterator[Finding]:
    try:
        found, own = version_number(text), version_number(SCHEMA_VERSION)
    except InputError as error:
        yield Finding("schema", path, str(error))
        return
    if found > own:
        yield Finding("schema", path, f"schema {text} is newer than {SCHEMA_VERSION} of this mmw; update mmw")
    elif found[0] < own[0]:
        yield Finding("schema", path, f"schema {text} is older than {own[0]}.0; use the mmw that made it")


def _check_listed(
    marker: dict, key: ShardKey | str, head: Mapping[str, Any], listed: Mapping[str, dict]
) -> Iterator[Finding]:
    """Yield what is wrong with the list of files of a marker."""
    place = table_path("", key).as_posix()
    is_config, is_inputs = marker["config_sha256"] == head["config_sha256"], is_of(marker, head)
    for file in marker["files"]:
        path = file["path"]
        if path != f"{file['table']}/{place}":
            yield Finding("marker", marker_path(key).as_posix(), f"lists {path}, which is no file of {key}")
        elif path in listed:
            yield Finding("marker", path, "two markers list the file")
        elif not is_config:
            yield Finding("config", path, f"made by configuration {marker['config_sha256'][:12]}")
        elif not is_inputs:
            yield Finding("inputs", path, "made from other input files than the dataset was begun with")


class _Layout:
    """Columns of a table, worked out once for all its files."""

    def __init__(self, spec: TableSpec, more: Sequence[str]) -> None:
        self.spec, self.schema, self.more = spec, arrow_schema(spec), more
        self.to_read = columns_to_read(self.schema, spec.key, more)
        self.needed = ["scenario", *(["weather"] if spec.framed else []), *spec.key, *more]
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
                    needed = columns_to_read(schema, table.spec.key, table.more)
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
        yield from _check_version(name, version)
    if version == SCHEMA_VERSION:
        if not found.equals(own):
            yield Finding("schema", name, f"columns are not those of table {table.spec.name!r}")
    elif problem := schema_problem(found, table.spec, table.needed):
        yield Finding("schema", name, problem)
    elif any(field.name not in own.names or not own.field(field.name).equals(field) for field in found):
        yield Finding("schema", name, f"columns of schema {version} are not among those of table {table.spec.name!r}")


def _text(data: bytes) -> str:
    return data.decode(errors="replace")


def _check_overlaps(markers: Mapping[str, dict]) -> Iterator[Finding]:
    """Yield shards that share frames with another: their rows would be duplicated."""
    framed = sorted(
        (marker["scenario"], marker["weather"], marker["frame_begin"], marker["frame_end"], name)
        for name, marker in markers.items()
        if marker["weather"] is not None
    )
    for (*one, _, end, _), (*other, begin, _, name) in pairwise(framed):
        if one == other and begin < end:
            yield Finding("duplicate", name, f"frames {begin} to {end - 1} of {', '.join(one)} are in two shards")


def _check_others(store: Store, listed: dict[str, dict]) -> Iterator[Finding]:
    """Yield files that no marker lists."""
    tables = set(TABLES)
    for name in store.names():
        if name in listed:
            continue
        top = name.partition("/")[0]
        if is_temporary(PurePosixPath(name)):
            yield Finding("temporary", name, "left by a killed run")
        elif top in tables and TABLE_FILE.fullmatch(name) and store.sizes([name]):
            text = "no marker lists the file, but pandas and DuckDB take its rows; finish the run, or move it away"
            yield Finding("orphan", name, text)
        elif top in tables:
            yield Finding("foreign", name, "no file of a dataset has this name; move it away")
        elif top == MARKERS and not name.endswith(".json"):
            yield Finding("foreign", name, "no marker has this name; move it away")
    for name in store.top_level_names():
        if name.endswith(".parquet") and name != MANIFEST:
            yield Finding("foreign", name, "no file of a dataset has this name; move it away")


def check_manifest(store: Store, markers: Mapping[str, dict]) -> Iterator[Finding]:
    """Yield what is wrong with the manifest, if there is one: it has one row for each file that the markers list."""
    data = store.read(MANIFEST)
    if data is None:
        return
    try:
        manifest = pq.read_table(pa.BufferReader(data))
    except (pa.ArrowException, OSError) as error:
        yield Finding("manifest", MANIFEST, f"cannot be read: {one_line(error)}; run the configuration again")
        return
    expected = manifest_rows(markers.values())
    for name in set(expected.column_names) - set(manifest.column_names):
        if expected[name].null_count == expected.num_rows:  # of a newer mmw; the markers do not fill it
            expected = expected.drop_columns(name)
    is_same = manifest.schema.equals(expected.schema)
    if not is_same or not manifest.sort_by("path").equals(expected.sort_by("path")):  # the order is free
        yield Finding("manifest", MANIFEST, "does not list what the markers list; run the configuration again")
