"""Verify the files of a dataset against its markers: read and hash each file, and check the keys of its rows."""

import hashlib
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import PurePosixPath

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from mmw.core.errors import InputError
from mmw.core.temp_files import is_temporary
from mmw.storage.manifest import DATASET, MANIFEST, manifest_rows, named_markers, read_dataset
from mmw.storage.parquet_schema import arrow_schema
from mmw.storage.parquet_writer import ROWS
from mmw.storage.schemas import SCHEMA_VERSION, TABLES, table_spec
from mmw.storage.shard_writer import MARKERS, key_of, marker_path, table_path
from mmw.storage.store import Root, Store, store_of

HARMLESS = ("temporary", "note")
"""Kinds of findings that are no error."""

SHARD_FILE = re.compile(r"[^/]+/scenario=[^/]+(/weather=[^/]+)?/part-\d{6,}\.parquet")
"""Path of a table's file, relative to the dataset folder."""


@dataclass(frozen=True)
class Finding:
    """Problem of a dataset, or a note."""

    kind: str
    """missing, size, sha256, parquet, rows, schema, key, duplicate, value, orphan, foreign, config, marker, manifest,
    count, friis, sight, box, regenerated: the data is incomplete or wrong. temporary: a file of a killed run that no
    reader takes and a rerun removes. note: anything that could not be checked."""
    path: str
    """File, relative to the dataset folder."""
    text: str

    @property
    def is_error(self) -> bool:
        """True if data is missing or damaged; False for harmless files and notes."""
        return self.kind not in HARMLESS

    def __str__(self) -> str:
        return f"{self.kind}: {self.path}: {self.text}"


def verify(root: Root) -> list[Finding]:
    """Return all problems of a dataset; none means that every file matches its marker.

    Raises:
        InputError: If it is not a dataset.
        StoreError: If a store cannot be reached.
    """
    return list(_find(store_of(root)))


def _find(store: Store) -> Iterator[Finding]:
    head = read_dataset(store)
    yield from _check_version(DATASET, head["schema_version"])
    markers = named_markers(store, skip_unreadable=True)  # the others are findings
    for name in store.names(MARKERS):
        if name.endswith(".json") and name not in markers:
            yield Finding("marker", name, "cannot be read; run the configuration again")
    listed: dict[str, dict] = {}
    for name, marker in markers.items():
        yield from _check_version(name, marker["schema_version"])
        key = key_of(marker)
        if marker_path(key).as_posix() != name:
            yield Finding("marker", name, f"is the marker of {key}; put its own back, or run the configuration again")
            continue
        for file in marker["files"]:
            if file["path"] != table_path(file["table"], key).as_posix():
                yield Finding("marker", name, f"lists {file['path']}, which is no file of {key}")
                continue
            if file["path"] in listed:
                yield Finding("marker", file["path"], "two markers list the file")
            listed[file["path"]] = file
            if marker["config_sha256"] != head["config_sha256"]:
                yield Finding("config", file["path"], f"made by configuration {marker['config_sha256'][:12]}")
            yield from _check_file(store, file, marker)
    made_on = sorted({str(marker["device"]) for marker in markers.values() if marker.get("device")})
    if len(made_on) > 1:
        text = f"made on {len(made_on)} kinds of machine, between which last bits may differ: {'; '.join(made_on)}"
        yield Finding("note", MARKERS, text)
    yield from _check_overlaps(markers)
    yield from _check_others(store, listed)
    yield from check_manifest(store, markers)


def version_number(text: str) -> tuple[int, int]:
    """Return the major and minor number of a schema version.

    Raises:
        InputError: If the text is not a version.
    """
    major, dot, minor = str(text).partition(".")
    if not (dot and major.isdigit() and minor.isdigit()):
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


def _check_file(store: Store, file: dict, marker: dict) -> Iterator[Finding]:
    name = file["path"]
    try:
        data = store.read(name)
    except OSError as error:
        yield Finding("unreadable", name, one_line(error))
        return
    if data is None:
        yield Finding("missing", name, "the marker lists it, but it does not exist")
    elif len(data) != file["bytes"]:
        yield Finding("size", name, f"{len(data)} bytes; the marker has {file['bytes']}")
    elif hashlib.sha256(data).hexdigest() != file["sha256"]:
        yield Finding("sha256", name, "the content is not what was written")
    else:
        try:
            with pq.ParquetFile(pa.BufferReader(data)) as parquet:
                yield from _check_content(parquet, file, marker)
        except (pa.ArrowException, OSError) as error:
            yield Finding("parquet", name, f"cannot be read: {one_line(error)}")


def one_line(error: BaseException) -> str:
    """Return the message of an error on one line."""
    return " ".join(str(error).split())


def _check_content(parquet: pq.ParquetFile, file: dict, marker: dict) -> Iterator[Finding]:
    name, table = file["path"], file["table"]
    if parquet.metadata.num_rows != file["rows"]:
        yield Finding("rows", name, f"{parquet.metadata.num_rows} rows; the marker has {file['rows']}")
    meta = parquet.metadata.metadata or {}
    written = meta.get(ROWS.encode(), b"").decode()
    if written and written != str(parquet.metadata.num_rows):
        yield Finding("rows", name, f"{parquet.metadata.num_rows} rows; {written} were written; it was changed since")
    if table not in TABLES:
        yield Finding("schema", name, f"table {table!r} is not known to this mmw (schema {SCHEMA_VERSION})")
        return
    version = meta.get(b"mmw.schema_version", b"none").decode()
    yield from _check_version(name, version)
    own, found = arrow_schema(table), parquet.schema_arrow
    if version == SCHEMA_VERSION:
        if not found.equals(own):
            yield Finding("schema", name, f"columns are not those of table {table!r}")
    elif any(field.name not in own.names or not own.field(field.name).equals(field) for field in found):
        yield Finding("schema", name, f"columns of schema {version} are not among those of table {table!r}")
    spec = table_spec(table)
    fixed = {"scenario": marker["scenario"], **({"weather": marker["weather"]} if spec.framed else {})}
    if not set(found.names) >= {*spec.key, *fixed}:
        return  # the schema was found wrong already
    yield from _check_values(parquet, name)
    rows = parquet.read(columns=[*fixed, *spec.key])
    for column, value in fixed.items():
        others = [text for text in rows.column(column).cast(pa.string()).unique().to_pylist() if text != value]
        if others:
            yield Finding("key", name, f"rows of {column} {others[0]}; the file is for {value}")
    if spec.framed and rows.num_rows:
        frame = rows.column("frame").to_numpy()
        if frame.min() < marker["frame_begin"] or frame.max() >= marker["frame_end"]:
            frames = f"{marker['frame_begin']} to {marker['frame_end'] - 1}"
            yield Finding("key", name, f"frames {frame.min()} to {frame.max()}; the file is for {frames}")
    count = _repeated(rows.select(list(spec.key)))
    if count:
        yield Finding("duplicate", name, f"{count} rows repeat the key {', '.join(spec.key)} of another")


def _check_values(parquet: pq.ParquetFile, name: str) -> Iterator[Finding]:
    """Yield the columns that hold NaN or infinity, which no run writes: a missing value is null."""
    numbers = [field.name for field in parquet.schema_arrow if pa.types.is_floating(_element(field.type))]
    if not numbers:
        return
    wrong: Counter[str] = Counter()
    for batch in parquet.iter_batches(columns=numbers):
        for field, values in zip(batch.schema, batch.columns, strict=True):
            while pa.types.is_nested(values.type):
                values = values.flatten()
            wrong[field.name] += len(values) - values.null_count - (pc.sum(pc.is_finite(values)).as_py() or 0)
    for column, count in sorted(wrong.items()):
        if count:
            yield Finding("value", name, f"{count} values of {column} are NaN or infinite; run the configuration again")


def _element(type_: pa.DataType) -> pa.DataType:
    """Return the type of the elements of a list, of whatever depth; other types as they are."""
    while pa.types.is_list(type_):
        type_ = type_.value_type
    return type_


def _repeated(keys: pa.Table) -> int:
    """Return how many rows repeat the key of another row."""
    names = [field.with_type(pa.string()) if pa.types.is_dictionary(field.type) else field for field in keys.schema]
    return keys.num_rows - keys.cast(pa.schema(names)).group_by(keys.column_names).aggregate([]).num_rows


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
    for name in store.names():
        path = PurePosixPath(name)
        if is_temporary(path):
            yield Finding("temporary", name, "left by a killed run")
        elif path.parts[0] in TABLES and name not in listed:
            if SHARD_FILE.fullmatch(name) and store.sizes([name]):
                text = "no marker lists the file, but readers take its rows; finish the run, or move it away"
                yield Finding("orphan", name, text)
            else:
                yield Finding("foreign", name, "no file of a dataset has this name; move it away")
        elif path.parts[0] == MARKERS and path.suffix != ".json":
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
        manifest = pq.read_table(pa.BufferReader(data)).to_pylist()
    except (pa.ArrowException, OSError) as error:
        yield Finding("manifest", MANIFEST, f"cannot be read: {one_line(error)}; run the configuration again")
        return
    if manifest != manifest_rows(markers.values()).to_pylist():
        yield Finding("manifest", MANIFEST, "does not list what the markers list; run the configuration again")
