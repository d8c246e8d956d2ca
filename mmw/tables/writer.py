"""Shards on disk: every table of a piece of a scenario, each published whole, then the marker that makes it count.

A reader that finds a file may trust it; a marker (`_shards/*.json`, written last) says that all files of its shard are
there. At worst a killed run leaves files without a marker: they are valid, and the next run replaces them by equals.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from mmw.tables.columns import check_table, frame_rows, table_from_columns
from mmw.tables.parquet import arrow_schema, write_options
from mmw.tables.publish import OutOfSpaceError, publish_bytes
from mmw.tables.schemas import SCHEMA_VERSION, table_spec
from mmw.tables.store import Root, Store, store_of

__all__ = ["OutOfSpaceError", "ShardKey", "marker_path", "table_path", "write_scenario", "write_shard"]

MARKERS = "_shards"
"""Folder of the markers; the underscore hides it from readers."""

META_KEYS = ("config_sha256", "mmw_version", "git_sha", "device", "seconds")
"""What a marker says about the making of its files, besides their list."""

_FILE_META = {"config_sha256": "mmw.config_sha256", "mmw_version": "mmw.version", "git_sha": "mmw.git"}
"""Marker key -> file-level key; nothing that differs between two equal runs, so that their files are equal too."""

Columns = Mapping[str, Any] | pa.Table


@dataclass(frozen=True)
class ShardKey:
    """The unit of writing and resuming: some frames of one scenario in one weather."""

    scenario: str
    weather: str
    frame_begin: int
    """First frame; also the number in the file names."""
    frame_end: int
    """One past the last frame."""

    def __str__(self) -> str:
        return f"{self.scenario}/{self.weather}/{self.frame_begin}-{self.frame_end - 1}"


def table_path(table: str, key: ShardKey | str) -> Path:
    """Return where a shard's table is, relative to the dataset folder; a static table takes the scenario's name."""
    if isinstance(key, str):
        return Path(table, f"scenario={key}", "part-000000.parquet")
    return Path(table, f"scenario={key.scenario}", f"weather={key.weather}", f"part-{key.frame_begin:06d}.parquet")


def marker_path(key: ShardKey | str) -> Path:
    """Return where the marker of a shard, or of a scenario's static tables, is, relative to the dataset folder."""
    if isinstance(key, str):
        return Path(MARKERS, f"{key}.json")
    return Path(MARKERS, f"{key.scenario}.{key.weather}.{key.frame_begin:06d}.json")


def write_shard(root: Root, key: ShardKey, tables: Mapping[str, Columns], meta: Mapping[str, Any]) -> dict[str, Any]:
    """Publish every table of a shard, then its marker; an existing shard of the same name is replaced.

    Threads may write different shards of one folder at the same time.

    Args:
        root: Dataset.
        key: Which shard.
        tables: Framed tables by name, as columns (see `table_from_columns`; `scenario` and `weather` may be left out)
            or as Arrow tables.
        meta: `config_sha256`, and of the making what is known: `mmw_version`, `git_sha`, `device`, `seconds`.

    Returns:
        The marker: the key, `meta`, `schema_version`, `created_utc` and `files` with path, rows, bytes and SHA-256.

    Raises:
        ValueError: If a table does not fit its schema or holds a row of another shard.
        OutOfSpaceError: If the disk is full; what was published before is not touched.
        StoreError: If the store cannot be reached or refuses; the shard stays in its staging folder.
    """
    ready: dict[str, pa.Table] = {}
    for name, columns in tables.items():
        if not table_spec(name).framed:
            raise ValueError(f"table {name!r} is static; write it with write_scenario, once a scenario")
        ready[name] = _to_table(name, columns, {"scenario": key.scenario, "weather": key.weather})
        _check_key(name, ready[name], key)
    identity = {
        "scenario": key.scenario,
        "weather": key.weather,
        "frame_begin": key.frame_begin,
        "frame_end": key.frame_end,
    }
    return _publish(store_of(root), key, identity, ready, meta)


def write_scenario(root: Root, scenario: str, tables: Mapping[str, Columns], meta: Mapping[str, Any]) -> dict[str, Any]:
    """Publish the static tables of a scenario (`objects`, `sensors`, `materials`), then their marker.

    Arguments, result and errors are those of `write_shard`; the marker has no weather and no frames.
    """
    ready: dict[str, pa.Table] = {}
    for name, columns in tables.items():
        if table_spec(name).framed:
            raise ValueError(f"table {name!r} has frames; write it with write_shard")
        ready[name] = _to_table(name, columns, {"scenario": scenario})
        _check_names(name, ready[name], "scenario", scenario)
    identity = {"scenario": scenario, "weather": None, "frame_begin": None, "frame_end": None}
    return _publish(store_of(root), scenario, identity, ready, meta)


def _to_table(name: str, columns: Any, key: dict[str, str]) -> pa.Table:
    if isinstance(columns, pa.Table):
        if columns.schema.equals(arrow_schema(name), check_metadata=True):
            return columns  # made by table_from_columns
        return check_table(name, columns)
    return table_from_columns(name, {**key, **columns})


def _check_key(name: str, table: pa.Table, key: ShardKey) -> None:
    _check_names(name, table, "scenario", key.scenario)
    _check_names(name, table, "weather", key.weather)
    if table.num_rows:
        frame = table.column("frame").to_numpy()
        if frame.min() < key.frame_begin or frame.max() >= key.frame_end:
            raise ValueError(
                f"table {name!r}: frames {frame.min()} to {frame.max()}; shard {key} holds only its own; "
                "give each shard its rows"
            )


def _check_names(name: str, table: pa.Table, column: str, value: str) -> None:
    found = table.column(column).cast(pa.string()).unique().to_pylist()
    if found not in ([], [value]):
        raise ValueError(f"table {name!r}: {column} = {found}; this file is for {value!r}; give each shard its rows")


def _publish(
    root: Store, key: ShardKey | str, identity: dict[str, Any], tables: dict[str, pa.Table], meta: Mapping[str, Any]
) -> dict[str, Any]:
    unknown = sorted(set(meta) - set(META_KEYS))
    if unknown or "config_sha256" not in meta:
        raise ValueError(f"meta has unknown keys {unknown}; give config_sha256 and any of {', '.join(META_KEYS[1:])}")
    file_meta = {text: str(meta[name]) for name, text in _FILE_META.items() if name in meta}
    files = []
    for name, table in tables.items():
        data = _parquet_bytes(name, table, file_meta)
        path = table_path(name, key)
        publish_bytes(root.folder / path, data)
        digest = hashlib.sha256(data).hexdigest()
        files.append(
            {"table": name, "path": path.as_posix(), "rows": table.num_rows, "bytes": data.nbytes, "sha256": digest}
        )
    marker = {
        **identity,
        "schema_version": SCHEMA_VERSION,
        **{name: meta.get(name) for name in META_KEYS},
        "created_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "files": files,
    }
    last = marker_path(key)
    publish_bytes(root.folder / last, json.dumps(marker, indent=1).encode())
    root.keep([file["path"] for file in files], last.as_posix(), drop=isinstance(key, ShardKey))
    return marker


def _parquet_bytes(name: str, table: pa.Table, file_meta: dict[str, str]) -> memoryview:
    """Return a table as a Parquet file in memory: one encoding gives size, hash and content."""
    spec = table_spec(name)
    group = max(spec.frames_per_group * frame_rows(table), 1) if spec.frames_per_group else 65_536
    table = table.replace_schema_metadata(arrow_schema(name, file_meta).metadata)
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, row_group_size=group, **write_options(name))
    return memoryview(sink.getvalue())
