"""Write shards: one file for each table of a range of frames, written atomically, then the marker of the shard.

Every file under its final name is complete; a marker (`_shards/*.json`, written last) states that all files of its
shard exist. A killed run may leave files without a marker: they are valid, and the next run writes the same again.
"""

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa

from mmw.core.constants import FRAME_RATE_HZ
from mmw.storage.arrow_tables import check_table, table_from_columns
from mmw.storage.atomic_files import write_bytes_atomically
from mmw.storage.parquet_schema import RATE, arrow_schema
from mmw.storage.parquet_writer import ParquetFileBuilder
from mmw.storage.schemas import SCHEMA_VERSION, TABLES, table_spec
from mmw.storage.store import Root, Store, store_of

MARKERS = "_shards"
"""Folder of the markers; readers skip folders with an underscore."""

META_KEYS = (
    "config_sha256", "inputs_sha256", "mmw_version", "git_sha", "software", "device", "accepted", "seconds",
    "frame_rate_hz",
)  # fmt: skip
"""Metadata of a marker, besides the list of its files. `software` and `device` name what made the shard; `accepted`,
which differences from the rest of the dataset its run was told to accept (`versions`, `machine`). A shard without
`frame_rate_hz`, of an mmw that had one rate, has frames at 100 Hz."""

FILE_META = {
    "config_sha256": "mmw.config_sha256", "inputs_sha256": "mmw.inputs_sha256", "mmw_version": "mmw.version",
    "git_sha": "mmw.git", "software": "mmw.software", "frame_rate_hz": RATE,
}  # fmt: skip
"""Marker key -> file-level key; only values that are equal in two runs of a configuration, so that files are equal."""

Columns = Mapping[str, Any] | pa.Table


@dataclass(frozen=True)
class ShardKey:
    """Unit of writing and resuming: a range of frames of one scenario in one weather."""

    scenario: str
    weather: str
    frame_begin: int
    """First frame; also the number in the file names."""
    frame_end: int
    """One past the last frame."""

    def __str__(self) -> str:
        return f"{self.scenario}/{self.weather}/{self.frame_begin}-{self.frame_end - 1}"


def table_path(table: str, key: ShardKey | str) -> Path:
    """Return the path of a shard's table in the dataset; of a static table if `key` is the name of a scenario.

    The folder of a table whose rows are the same in every weather, see `TableSpec.by_weather`, names none.
    """
    if isinstance(key, str):
        return Path(table, f"scenario={key}", "part-000000.parquet")
    is_of_weather = table not in TABLES or TABLES[table].by_weather
    weather = (f"weather={key.weather}",) if is_of_weather else ()
    return Path(table, f"scenario={key.scenario}", *weather, f"part-{key.frame_begin:06d}.parquet")


TABLE_FILE = re.compile(
    r"(?P<table>[^/]+)/(?P<folder>scenario=(?P<scenario>[^/]+)(?:/weather=(?P<weather>[^/]+))?)"
    r"/part-(?P<number>\d{6,})\.parquet$"
)
"""Path that `table_path` returns; `search` finds it at the end of an absolute path. Static tables and those
that are the same in every weather have no weather."""


def _fixed_columns(table: str, key: ShardKey | str) -> dict[str, str]:
    """Return the columns that have one value in all rows of a file, and these values."""
    if isinstance(key, str):
        return {"scenario": key}
    return {"scenario": key.scenario, **({"weather": key.weather} if table_spec(table).of_weather else {})}


def marker_path(key: ShardKey | str) -> Path:
    """Return the path of the marker of a shard, or of a scenario's static tables, in the dataset."""
    if isinstance(key, str):
        return Path(MARKERS, f"{key}.json")
    return Path(MARKERS, f"{key.scenario}.{key.weather}.{key.frame_begin:06d}.json")


SHARD_DOTS = 3
"""Dots in the name of a shard's marker; that of static tables has one."""


def key_of(marker: Mapping[str, Any]) -> ShardKey | str:
    """Return the shard of a marker; the name of the scenario if the marker is of static tables."""
    if marker["weather"] is None:
        return marker["scenario"]
    return ShardKey(*(marker[field.name] for field in fields(ShardKey)))


class ShardWriter:
    """Shard that grows in memory batch by batch; `close` writes its files."""

    def __init__(self, root: Root, key: ShardKey | str, meta: Mapping[str, Any]):
        """Start an empty shard; `meta` has `config_sha256`, and `mmw_version`, `git_sha` and `device` if known.

        With the name of a scenario as key, it takes the static tables instead.

        Raises:
            ValueError: If `meta` has no or unknown keys.
        """
        self._root, self.key, self._meta = store_of(root), key, meta
        self._file_meta = _file_meta(meta)
        self._files: dict[str, ParquetFileBuilder] = {}

    def add(self, tables: Mapping[str, Columns], frame_end: int) -> None:
        """Add the rows of the next frames.

        Args:
            tables: Tables by name, as columns (see `table_from_columns`; `scenario` and `weather` may be left out) or
                as Arrow tables.
            frame_end: One past the last of these frames.

        Raises:
            ValueError: If a table does not fit its schema or holds a row of another shard.
        """
        for name, columns in tables.items():
            is_shard = isinstance(self.key, ShardKey)
            if table_spec(name).framed != is_shard:
                text = (
                    "is static; write it with write_scenario" if is_shard else "has frames; write it with write_shard"
                )
                raise ValueError(f"table {name!r} {text}")
            fixed = _fixed_columns(name, self.key)
            table = _to_table(name, columns, fixed)
            self._check(name, table, fixed)
            if name not in self._files:
                self._files[name] = ParquetFileBuilder(name, self.key.frame_begin if is_shard else 0, self._file_meta)
            self._files[name].add(table, frame_end)

    def close(self, seconds: float | None = None, more: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Write every table, then the marker; an existing shard of the same key is replaced.

        Args:
            seconds: Duration [s].
            more: Further content of the marker.

        Returns:
            The marker: the key, `meta`, `seconds`, `schema_version`, `created_utc` and `files` with path, rows, bytes
            and SHA-256.

        Raises:
            ValueError: If two rows of a table have the same key.
            OutOfSpaceError: If the disk is full; finished files are not touched.
            StoreError: If the store cannot be reached or refuses; the shard stays in its staging folder.
        """
        encoded = ((name, file.rows, file.close()) for name, file in self._files.items())
        return _write_files(self._root, self.key, encoded, {**self._meta, "seconds": seconds}, more or {})

    def _check(self, name: str, table: pa.Table, fixed: Mapping[str, str]) -> None:
        """Check that a table holds no row of another shard."""
        for column, value in fixed.items():
            found = table.column(column).cast(pa.string()).unique().to_pylist()
            if found not in ([], [value]):
                raise ValueError(f"table {name!r}: {column} = {found}; this file is for {value!r}; give each its rows")
        if isinstance(self.key, ShardKey) and table.num_rows:
            frame = table.column("frame").to_numpy()
            if frame.min() < self.key.frame_begin or frame.max() >= self.key.frame_end:
                raise ValueError(
                    f"table {name!r}: frames {frame.min()} to {frame.max()}; shard {self.key} has only its own; "
                    "give each shard its rows"
                )


def write_shard(root: Root, key: ShardKey, tables: Mapping[str, Columns], meta: Mapping[str, Any]) -> dict[str, Any]:
    """Write a complete shard and return its marker; see `ShardWriter`.

    Threads may write different shards of one folder at the same time.
    """
    shard = ShardWriter(root, key, meta)
    shard.add(tables, key.frame_end)
    return shard.close()


def write_scenario(
    root: Root,
    scenario: str,
    tables: Mapping[str, Columns],
    meta: Mapping[str, Any],
    actors: Mapping[str, Any] | None = None,
    notes: Sequence[str] = (),
) -> dict[str, Any]:
    """Write the static tables of a scenario (`objects`, `sensors`, `materials`), then their marker.

    Arguments, result and errors are those of `write_shard`; the marker has no weather and no frames. `actors` says who
    is there when, see `mmw.scene.rows.actor_presence`; `mmw verify` takes its counts from it. `notes` is what
    users should know of the scenario, such as extrapolated materials, one line each; the dataset card lists it.
    """
    shard = ShardWriter(root, scenario, meta)
    shard.add(tables, 0)
    more = {**({} if actors is None else {"actors": actors}), **({"notes": list(notes)} if notes else {})}
    return shard.close(meta.get("seconds"), more or None)


def _to_table(name: str, columns: Any, key: dict[str, str]) -> pa.Table:
    if isinstance(columns, pa.Table):
        if columns.schema.equals(arrow_schema(name), check_metadata=True):
            return columns  # a result of table_from_columns
        return check_table(name, columns)
    return table_from_columns(name, {**key, **columns})


def _file_meta(meta: Mapping[str, Any]) -> dict[str, str]:
    """Return the file-level keys of the metadata of a shard."""
    unknown = sorted(set(meta) - set(META_KEYS))
    if unknown or "config_sha256" not in meta:
        raise ValueError(f"meta has unknown keys {unknown}; give config_sha256 and any of {', '.join(META_KEYS[1:])}")
    given = {text: str(meta[name]) for name, text in FILE_META.items() if meta.get(name) is not None}
    if given.get(RATE) == str(FRAME_RATE_HZ):
        del given[RATE]  # the schema says so
    return given


def _write_files(
    root: Store,
    key: ShardKey | str,
    encoded: Iterable[tuple[str, int, memoryview]],
    meta: Mapping[str, Any],
    more: Mapping[str, Any],
) -> dict[str, Any]:
    """Write files given by table, number of rows and content, then their marker."""
    files = []
    for name, rows, data in encoded:
        path = table_path(name, key)
        _write(root, path, data)
        digest = hashlib.sha256(data).hexdigest()
        files.append({"table": name, "path": path.as_posix(), "rows": rows, "bytes": data.nbytes, "sha256": digest})
    static = {"scenario": key, "weather": None, "frame_begin": None, "frame_end": None}
    marker = {
        **(asdict(key) if isinstance(key, ShardKey) else static),
        "schema_version": SCHEMA_VERSION,
        **{name: meta.get(name) for name in META_KEYS},
        "created_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        **more,
        "files": files,
    }
    last = marker_path(key)
    _write(root, last, json.dumps(marker, indent=1).encode())
    root.upload([file["path"] for file in files], last.as_posix(), remove_local=isinstance(key, ShardKey))
    return marker


def _write(root: Store, path: Path, data: bytes | memoryview) -> None:
    root.check_present()
    try:
        write_bytes_atomically(root.folder / path, data)
    except FileNotFoundError:
        root.check_present()  # it says more
        raise
