"""Is the dataset what its markers say? Every file is read, hashed, and its rows are checked against their keys."""

import hashlib
import json
import re
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from mmw.core.errors import InputError
from mmw.core.temp_files import is_temporary
from mmw.storage.manifest import DATASET, MANIFEST, read_dataset, read_markers
from mmw.storage.parquet_schema import arrow_schema
from mmw.storage.schemas import SCHEMA_VERSION, TABLES, table_spec
from mmw.storage.shard_writer import MARKERS
from mmw.storage.store import Root, Store, store_of

LEFTOVERS = ("orphan", "temporary", "note")
"""Kinds of findings that are no error."""

SHARD_FILE = re.compile(r"[^/]+/scenario=[^/]+(/weather=[^/]+)?/part-\d{6,}\.parquet")
"""Path of a table's file, relative to the dataset folder."""


@dataclass(frozen=True)
class Finding:
    """Something that is not as it should be."""

    kind: str
    """missing, size, sha256, parquet, rows, schema, key, duplicate, foreign, config, marker, manifest, count, friis,
    sight, box, remade: the data is not whole or not right. orphan, temporary: a killed run's leftovers, harmless,
    replaced when it is run again. note: what could not be checked."""
    path: str
    """File, relative to the dataset folder."""
    text: str

    @property
    def is_error(self) -> bool:
        """True if data is missing or damaged; False for leftovers."""
        return self.kind not in LEFTOVERS

    def __str__(self) -> str:
        return f"{self.kind}: {self.path}: {self.text}"


def verify(root: Root) -> list[Finding]:
    """Return everything that is wrong with a dataset; an empty list means that every file is as its marker says.

    Raises:
        InputError: If it is not a dataset.
        StoreError: If a store cannot be reached.
    """
    store = store_of(root)
    head = read_dataset(store)
    sha256 = head["config_sha256"]
    findings = _check_version(DATASET, head["schema_version"])
    markers = read_markers(store)
    readable = {_marker_name(marker) for marker in markers}
    for name in store.names(MARKERS):
        if name.endswith(".json") and PurePosixPath(name).name not in readable:
            findings.append(Finding("marker", name, "cannot be read; run the configuration again"))
    listed: dict[str, dict] = {}
    for marker in markers:
        findings += _check_version(f"{MARKERS}/{_marker_name(marker)}", marker["schema_version"])
        for file in marker["files"]:
            if file["path"] in listed:
                findings.append(Finding("marker", file["path"], "two markers list the file"))
            listed[file["path"]] = file
            if marker["config_sha256"] != sha256:
                findings.append(
                    Finding("config", file["path"], f"made by configuration {marker['config_sha256'][:12]}")
                )
            findings += _check_file(store, file, marker)
    made_on = sorted({str(marker["device"]) for marker in markers if marker.get("device")})
    if len(made_on) > 1:
        text = f"made on {len(made_on)} kinds of machine, between which last bits may differ: {'; '.join(made_on)}"
        findings.append(Finding("note", MARKERS, text))
    return findings + _check_overlaps(markers) + _check_others(store, listed) + _check_manifest(store, listed)


def version_number(text: str) -> tuple[int, int]:
    """Return the major and minor number of a schema version.

    Raises:
        InputError: If it is none.
    """
    major, dot, minor = str(text).partition(".")
    if not (dot and major.isdigit() and minor.isdigit()):
        raise InputError(f"schema version {text!r} is not MAJOR.MINOR; the file is damaged or of another program")
    return int(major), int(minor)


def _check_version(path: str, text: str) -> list[Finding]:
    try:
        found, own = version_number(text), version_number(SCHEMA_VERSION)
    except InputError as error:
        return [Finding("schema", path, str(error))]
    if found > own:
        return [Finding("schema", path, f"schema {text} is newer than {SCHEMA_VERSION} of this mmw; update mmw")]
    if found[0] < own[0]:
        return [Finding("schema", path, f"schema {text} is older than {own[0]}.0; use the mmw that made it")]
    return []


def _marker_name(marker: dict[str, Any]) -> str:
    if marker["weather"] is None:
        return f"{marker['scenario']}.json"
    return f"{marker['scenario']}.{marker['weather']}.{marker['frame_begin']:06d}.json"


def _check_file(store: Store, file: dict, marker: dict) -> list[Finding]:
    name = file["path"]
    data = store.read(name)
    if data is None:
        return [Finding("missing", name, "the marker lists it, but it is not there")]
    if len(data) != file["bytes"]:
        return [Finding("size", name, f"{len(data)} bytes; the marker says {file['bytes']}")]
    if hashlib.sha256(data).hexdigest() != file["sha256"]:
        return [Finding("sha256", name, "the content is not what was written")]
    try:
        with pq.ParquetFile(pa.BufferReader(data)) as parquet:
            return list(_check_content(parquet, file, marker))
    except (pa.ArrowException, OSError) as error:
        return [Finding("parquet", name, f"cannot be read: {one_line(error)}")]


def one_line(error: BaseException) -> str:
    """Return what an error says, on one line."""
    return " ".join(str(error).split())


def _check_content(parquet: pq.ParquetFile, file: dict, marker: dict) -> Iterable[Finding]:
    name, table = file["path"], file["table"]
    if parquet.metadata.num_rows != file["rows"]:
        yield Finding("rows", name, f"{parquet.metadata.num_rows} rows; the marker says {file['rows']}")
    if table not in TABLES:
        yield Finding("schema", name, f"table {table!r} is not known to this mmw (schema {SCHEMA_VERSION})")
        return
    written = (parquet.metadata.metadata or {}).get(b"mmw.schema_version", b"none").decode()
    yield from _check_version(name, written)
    own, found = arrow_schema(table), parquet.schema_arrow
    if written == SCHEMA_VERSION:
        if not found.equals(own):
            yield Finding("schema", name, f"columns are not those of table {table!r}")
    elif any(field.name not in own.names or not own.field(field.name).equals(field) for field in found):
        yield Finding("schema", name, f"columns of schema {written} are not among those of table {table!r}")
    spec = table_spec(table)
    fixed = {"scenario": marker["scenario"], **({"weather": marker["weather"]} if spec.framed else {})}
    if not set(found.names) >= {*spec.key, *fixed}:
        return  # the schema was found wrong already
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


def _repeated(keys: pa.Table) -> int:
    """Return how many rows have the key of another row."""
    if not keys.num_rows:
        return 0
    code = np.zeros(keys.num_rows, dtype=np.int64)
    for column in keys.columns:
        if pa.types.is_dictionary(column.type):
            column = column.cast(pa.string())
        number = column.combine_chunks().dictionary_encode().indices.to_numpy()
        code = np.unique(code * (int(number.max()) + 1) + number, return_inverse=True)[1]
    return keys.num_rows - len(np.unique(code))


def _check_overlaps(markers: Iterable[dict]) -> list[Finding]:
    """Return shards that hold frames of another: their rows would be there twice."""
    findings, ranges = [], defaultdict(list)
    for marker in markers:
        if marker["weather"] is not None:
            ranges[marker["scenario"], marker["weather"]].append(marker)
    for (scenario, weather), some in ranges.items():
        some.sort(key=lambda marker: marker["frame_begin"])
        for one, other in pairwise(some):
            if other["frame_begin"] < one["frame_end"]:
                text = f"frames {other['frame_begin']} to {one['frame_end'] - 1} of {scenario}, {weather} are in two"
                findings.append(Finding("duplicate", f"{MARKERS}/{_marker_name(other)}", f"{text} shards"))
    return findings


def _check_others(store: Store, listed: dict[str, dict]) -> list[Finding]:
    """Return files that no marker lists."""
    findings = []
    names = [(name, PurePosixPath(name)) for name in store.names()]
    for name, path in names:
        if path.parts[0] not in TABLES or name in listed or is_temporary(path):
            continue
        if SHARD_FILE.fullmatch(name) and store.sizes([name]):
            findings.append(Finding("orphan", name, "no marker lists the file; its shard was not finished"))
        else:
            findings.append(Finding("foreign", name, "no file of a dataset has this name; move it away"))
    for name in store.top():
        if name.endswith(".parquet") and name != MANIFEST:
            findings.append(Finding("foreign", name, "no file of a dataset has this name; move it away"))
    for name, path in names:
        if path.parts[0] == MARKERS and path.suffix != ".json" and not is_temporary(path):
            findings.append(Finding("foreign", name, "no marker has this name; move it away"))
    for name, path in names:
        if is_temporary(path):
            findings.append(Finding("temporary", name, "left by a killed run"))
    return findings


def _check_manifest(store: Store, listed: dict[str, dict]) -> list[Finding]:
    data = store.read(MANIFEST)
    if data is None:
        return []
    try:
        manifest = pq.read_table(pa.BufferReader(data), columns=["path", "sha256"]).to_pylist()
    except (pa.ArrowException, OSError, json.JSONDecodeError) as error:
        return [Finding("manifest", MANIFEST, f"cannot be read: {one_line(error)}; run the configuration again")]
    if {row["path"]: row["sha256"] for row in manifest} != {path: file["sha256"] for path, file in listed.items()}:
        return [Finding("manifest", MANIFEST, "does not list what the markers list; run the configuration again")]
    return []
