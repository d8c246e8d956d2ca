"""Verify a dataset against its markers: their content, the files that they list, and files that none lists."""

from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from pathlib import PurePosixPath
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from mmw.core.temp_files import is_temporary
from mmw.storage.finding import Finding, one_line
from mmw.storage.identity import inputs_sha256, is_of, mixtures
from mmw.storage.manifest import DATASET, MANIFEST, manifest_rows, named_markers, read_dataset
from mmw.storage.schema_checks import check_version
from mmw.storage.schemas import TABLES
from mmw.storage.shard_files import check_shards
from mmw.storage.shard_writer import MARKERS, TABLE_FILE, key_of, marker_path, table_path
from mmw.storage.store import Root, Store, store_of

CheckFiles = Callable[[Store, list[dict]], Iterator[Finding]]
"""Function that yields what is wrong with the files of markers."""


def verify(root: Root, check_files: CheckFiles = check_shards) -> list[Finding]:
    """Return all problems of a dataset; none means that every file matches its marker.

    Args:
        root: Dataset.
        check_files: Checks the files of markers whose list is right; by default without counting rows.

    Raises:
        InputError: If it is not a dataset.
        StoreError: If a store cannot be reached.
    """
    return list(_find(store_of(root), check_files))


def _find(store: Store, check_files: CheckFiles) -> Iterator[Finding]:
    head = read_dataset(store)
    yield from check_version(DATASET, head["schema_version"])
    if "inputs" in head and inputs_sha256(head["inputs"]) != head["inputs_sha256"]:
        yield Finding("inputs", DATASET, "its inputs do not have its inputs_sha256; the file was changed")
    markers = named_markers(store, skip_unreadable=True)  # the others are findings
    for name in store.names(MARKERS):
        if name.endswith(".json") and name not in markers:
            yield Finding("marker", name, "cannot be read; run the configuration again")
    listed: dict[str, dict] = {}
    sound = []
    for name, marker in markers.items():
        if marker_path(key_of(marker)).as_posix() != name:  # its files are another shard's
            text = f"is the marker of {key_of(marker)}; put its own back, or run the configuration again"
            yield Finding("marker", name, text)
            continue
        found = [*check_version(name, marker["schema_version"]), *_check_listed(marker, head, listed)]
        listed.update((file["path"], file) for file in marker["files"])
        yield from found
        if not found:
            sound.append(marker)
    yield from check_files(store, sound)
    yield from check_makers(head, markers)
    yield from _check_overlaps(markers)
    yield from _check_others(store, listed)
    yield from check_manifest(store, markers)


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


def _check_listed(marker: dict, head: Mapping[str, Any], listed: Mapping[str, dict]) -> Iterator[Finding]:
    """Yield what is wrong with the list of files of a marker."""
    key = key_of(marker)
    is_config, is_inputs = marker["config_sha256"] == head["config_sha256"], is_of(marker, head)
    for file in marker["files"]:
        path = file["path"]
        if path != table_path(file["table"], key).as_posix():
            yield Finding("marker", marker_path(key).as_posix(), f"lists {path}, which is no file of {key}")
        elif path in listed:
            yield Finding("marker", path, "two markers list the file")
        elif not is_config:
            yield Finding("config", path, f"made by configuration {marker['config_sha256'][:12]}")
        elif not is_inputs:
            yield Finding("inputs", path, "made from other input files than the dataset was begun with")


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
