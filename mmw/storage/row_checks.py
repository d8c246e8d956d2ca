"""Check the rows of several files of one table at once: values, keys and repetitions."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from mmw.storage.finding import Finding
from mmw.storage.schemas import table_spec
from mmw.storage.shard_writer import ShardKey, table_path

SHARD = "shard"
"""Column that is added to the rows: the index of their shard in `Chunk.keys`."""

MAX_BYTES = 64 << 20
"""Size of the files of one chunk [byte]; their rows take up to a few times as much memory."""

MAX_SHARDS = 256
"""Shards of one chunk."""


@dataclass
class Chunk:
    """Rows of consecutive shards of one scenario, checked together: a call of Arrow costs as much as a small file."""

    scenario: str
    keys: list[ShardKey | str] = field(default_factory=list)
    """Shards; the name of the scenario for its static tables."""
    wrong: set[int] = field(default_factory=set)
    """Indices of shards with a finding; their rows are not counted."""
    rows: dict[str, list[tuple[int, pa.Table]]] = field(default_factory=dict)
    """Table -> index of the shard and rows of each file: keys, floating-point numbers, and what is counted."""
    nbytes: int = 0

    def add(self, table: str, rows: pa.Table, nbytes: int) -> None:
        """Add the rows of a file of the last shard, and the size of the file."""
        self.rows.setdefault(table, []).append((len(self.keys) - 1, rows))
        self.nbytes += nbytes

    def path(self, table: str, shard: int) -> str:
        """Return the file of a table of a shard."""
        return table_path(table, self.keys[shard]).as_posix()

    @property
    def is_full(self) -> bool:
        """True once it is so large that the cost of a call does not matter."""
        return len(self.keys) >= MAX_SHARDS or self.nbytes >= MAX_BYTES


class CountRows(Protocol):
    """Function that compares the rows of shards with what a configuration says, and the columns that it needs."""

    columns: Mapping[str, Sequence[str]]
    """Table -> columns beside those of the key."""

    def __call__(self, chunk: Chunk, tables: Mapping[str, pa.Table]) -> Iterator[Finding]:
        """Yield what is wrong with the number of rows; `tables` has a column `SHARD`, and text, not dictionaries."""
        ...


def check_chunk(chunk: Chunk, count_rows: CountRows | None) -> Iterator[Finding]:
    """Yield what is wrong with the rows of the files of a chunk, then with their number."""
    tables = {}
    for table, parts in chunk.rows.items():
        tables[table] = _concatenated(parts)
        if not any(True for _ in _check_rows(chunk, table, tables[table])):
            continue
        for part in parts:
            found = list(_check_rows(chunk, table, _concatenated([part])))
            chunk.wrong.update(part[0] for _ in found[:1])
            yield from found
    if count_rows is not None:
        if chunk.wrong:
            wrong = pa.array(sorted(chunk.wrong), pa.int32())
            tables = {
                table: rows.filter(pc.invert(pc.is_in(rows.column(SHARD), value_set=wrong)))
                for table, rows in tables.items()
            }
        yield from count_rows(chunk, tables)


def _concatenated(parts: Sequence[tuple[int, pa.Table]]) -> pa.Table:
    """Return the rows of several files, with text in place of dictionaries, which differ from file to file."""
    tables = [rows for _, rows in parts]
    try:
        whole = pa.concat_tables(tables)
    except pa.ArrowInvalid:  # of several schema versions; slower
        whole = pa.concat_tables(tables, promote_options="permissive")
    names = [item.with_type(pa.string()) if pa.types.is_dictionary(item.type) else item for item in whole.schema]
    shard = np.repeat(*np.array([(index, rows.num_rows) for index, rows in parts], np.int32).T)
    return whole.cast(pa.schema(names)).append_column(SHARD, pa.array(shard))


def _check_rows(chunk: Chunk, table: str, rows: pa.Table) -> Iterator[Finding]:
    """Yield what is wrong with rows; the file that is named is that of the first."""
    if not rows.num_rows:
        return
    spec, path = table_spec(table), chunk.path(table, rows.column(SHARD)[0].as_py())
    for name in rows.column_names:
        if count := _count_infinite(rows.column(name)):
            text = f"{count} values of {name} are NaN or infinite, which no run writes; run the configuration again"
            yield Finding("value", path, text)
    wanted = {"scenario": [chunk.scenario] * len(chunk.keys)}
    if spec.framed:
        wanted["weather"] = [key.weather if isinstance(key, ShardKey) else "" for key in chunk.keys]
    for name, values in wanted.items():
        right = pa.array(values, pa.string()).take(rows.column(SHARD))
        others = rows.column(name).filter(pc.not_equal(rows.column(name), right))
        if len(others):
            text = f"rows of {name} {others[0]}; the file is for {right[0]}"
            yield Finding("key", path, text)
    if spec.framed:
        limits = rows.group_by(SHARD, use_threads=False).aggregate([("frame", "min"), ("frame", "max")])
        for index, least, most in zip(*(column.to_pylist() for column in limits.columns), strict=True):
            shard = chunk.keys[index]
            if isinstance(shard, ShardKey) and not shard.frame_begin <= least <= most < shard.frame_end:
                frames = f"{shard.frame_begin} to {shard.frame_end - 1}"
                yield Finding("key", path, f"frames {least} to {most}; the file is for {frames}")
    count = rows.num_rows - rows.group_by([SHARD, *spec.key], use_threads=False).aggregate([]).num_rows
    if count:
        yield Finding("duplicate", path, f"{count} rows repeat the key {', '.join(spec.key)} of another")


def _count_infinite(values: pa.ChunkedArray) -> int:
    """Return how many numbers of a column, of whatever depth of lists, are NaN or infinite; null is neither."""
    while pa.types.is_list(values.type):
        values = pc.list_flatten(values)
    if not pa.types.is_floating(values.type):
        return 0
    return len(values) - values.null_count - (pc.sum(pc.is_finite(values)).as_py() or 0)


def columns_to_read(schema: pa.Schema, key: Sequence[str], more: Sequence[str]) -> list[str]:
    """Return the columns of a table that the checks of rows need: key, numbers, and `more`."""
    wanted = {"scenario", "weather", *key, *more}
    return [item.name for item in schema if item.name in wanted or pa.types.is_floating(_element(item.type))]


def _element(type_: pa.DataType) -> pa.DataType:
    """Return the type of the elements of a list, of whatever depth; other types as they are."""
    while pa.types.is_list(type_):
        type_ = type_.value_type
    return type_
