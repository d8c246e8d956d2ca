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
from mmw.storage.table_spec import TableSpec

SHARD = "shard"
"""Column that is added to the rows: the index of their shard in `Chunk.keys`."""

MAX_BYTES = 64 << 20
"""Size of the files of one chunk [byte]; their rows take up to a few times as much memory."""

MAX_SHARDS = 256
"""Shards of one chunk."""


class Names:
    """Number the names in all tables alike: numbers are compared faster than text."""

    def __init__(self) -> None:
        """Begin without any name."""
        self.texts: list[str | None] = []
        """Names by their numbers; None, which only damaged rows have where a name is needed, has one too."""
        self._numbers: dict[str | None, int] = {}

    def number(self, text: str | None) -> int:
        """Return the number of a name."""
        if text not in self._numbers:
            self._numbers[text] = len(self.texts)
            self.texts.append(text)
        return self._numbers[text]

    def numbers(self, texts: Sequence[str | None]) -> np.ndarray:
        """Return the numbers of names, int32 of shape [names]."""
        return np.array([self.number(text) for text in texts], np.int32)

    def ranks(self) -> np.ndarray:
        """Return the place of each number in the order of the names, int32 of shape [names]."""
        ranks = np.empty(len(self.texts), np.int32)
        ranks[sorted(range(len(self.texts)), key=lambda number: self.texts[number] or "")] = np.arange(len(ranks))
        return ranks


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
    names: Names = field(default_factory=Names)
    """Numbers that stand for text in the tables of `CountRows`."""

    def add(self, table: str, rows: pa.Table, nbytes: int) -> None:
        """Add the rows of a file of the last shard, and the size of the file."""
        self.rows.setdefault(table, []).append((len(self.keys) - 1, rows))
        self.nbytes += nbytes

    def path(self, table: str, shard: int) -> str:
        """Return the file of a table of a shard."""
        return table_path(table, self.keys[shard]).as_posix()

    def shard_key(self, shard: int) -> ShardKey | None:
        """Return the key of a shard; None if it is that of static tables."""
        key = self.keys[shard]
        return key if isinstance(key, ShardKey) else None

    @property
    def is_full(self) -> bool:
        """True once it is so large that the cost of a call does not matter."""
        return len(self.keys) >= MAX_SHARDS or self.nbytes >= MAX_BYTES


class CountRows(Protocol):
    """Function that compares the rows of shards with what a configuration says, and the columns that it needs."""

    columns: Mapping[str, Sequence[str]]
    """Table -> columns beside those of the key."""

    def __call__(self, chunk: Chunk, tables: Mapping[str, pa.Table]) -> Iterator[Finding]:
        """Yield what is wrong with the number of rows; `tables` has a column `SHARD`, and text as `chunk.names`."""
        ...


def check_chunk(chunk: Chunk, count_rows: CountRows | None) -> Iterator[Finding]:
    """Yield what is wrong with the rows of the files of a chunk, then with their number."""
    tables = {}
    for table, parts in chunk.rows.items():
        tables[table] = _concatenated(parts, chunk.names)
        if not any(True for _ in _check_rows(chunk, table, tables[table])):
            continue
        for part in parts:
            found = list(_check_rows(chunk, table, _concatenated([part], chunk.names)))
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


def _concatenated(parts: Sequence[tuple[int, pa.Table]], names: Names) -> pa.Table:
    """Return the rows of several files, with numbers in place of names, whose dictionaries differ from file to file."""
    tables = [rows for _, rows in parts]
    try:
        whole = pa.concat_tables(tables)
    except pa.ArrowInvalid:  # of several schema versions; slower
        whole = pa.concat_tables(tables, promote_options="permissive")
    whole = whole.unify_dictionaries().combine_chunks()
    columns = {
        item.name: _numbered(column, names) if _is_text(item.type) else column
        for item, column in zip(whole.schema, whole.columns, strict=True)
    }
    shard = np.repeat(*np.array([(index, rows.num_rows) for index, rows in parts], np.int32).T)
    return pa.table({**columns, SHARD: shard})


def _is_text(type_: pa.DataType) -> bool:
    return pa.types.is_dictionary(type_) or pa.types.is_string(type_) or pa.types.is_large_string(type_)


def _numbered(column: pa.ChunkedArray, names: Names) -> np.ndarray:
    """Return the numbers of the names of a column, int32 of shape [rows]."""
    array = column.combine_chunks() if pa.types.is_dictionary(column.type) else column.dictionary_encode()
    if isinstance(array, pa.ChunkedArray):
        array = array.unify_dictionaries().combine_chunks()
    if not len(array):
        return np.empty(0, np.int32)
    numbers = names.numbers([*array.dictionary.to_pylist(), None])
    indices = array.indices.fill_null(len(numbers) - 1) if array.null_count else array.indices
    return numbers[indices.to_numpy()]


def _check_rows(chunk: Chunk, table: str, rows: pa.Table) -> Iterator[Finding]:
    """Yield what is wrong with rows; the file that is named is that of the first."""
    if not rows.num_rows:
        return
    shards = rows.column(SHARD).to_numpy()
    spec, path = table_spec(table), chunk.path(table, shards[0])
    for name in rows.column_names:
        if count := _count_infinite(rows.column(name)):
            text = f"{count} values of {name} are NaN or infinite, which no run writes; run the configuration again"
            yield Finding("value", path, text)
    wanted = {"scenario": [chunk.scenario] * len(chunk.keys)}
    if spec.of_weather:
        wanted["weather"] = [key.weather if isinstance(key, ShardKey) else "" for key in chunk.keys]
    for name, values in wanted.items():
        found, right = rows.column(name).to_numpy(), chunk.names.numbers(values)[shards]
        others = np.flatnonzero(found != right)
        if len(others):
            texts = [chunk.names.texts[each[others[0]]] for each in (found, right)]
            yield Finding("key", path, f"rows of {name} {texts[0]}; the file is for {texts[1]}")
    if spec.framed:
        first = np.flatnonzero(np.diff(shards, prepend=-1))  # rows of a shard follow each other
        frames = rows.column("frame").to_numpy()
        least, most = np.minimum.reduceat(frames, first), np.maximum.reduceat(frames, first)
        for shard, low, high in zip(shards[first].tolist(), least.tolist(), most.tolist(), strict=True):
            key = chunk.shard_key(shard)
            if key is not None and not key.frame_begin <= low <= high < key.frame_end:
                own = f"{key.frame_begin} to {key.frame_end - 1}"
                yield Finding("key", path, f"frames {low} to {high}; the file is for {own}")
    if count := _count_repeated(spec, rows, chunk.names):
        yield Finding("duplicate", path, f"{count} rows repeat the key {', '.join(spec.key)} of another")
    if spec.unique and (count := _count_equal(spec.unique, rows)):
        yield Finding("duplicate", path, f"{count} rows repeat {', '.join(spec.unique)} of another")


def _count_infinite(values: pa.ChunkedArray) -> int:
    """Return how many numbers of a column, of whatever depth of lists, are NaN or infinite; null is neither."""
    while pa.types.is_list(values.type):
        values = pc.list_flatten(values)
    if not pa.types.is_floating(values.type):
        return 0
    return len(values) - values.null_count - (pc.sum(pc.is_finite(values)).as_py() or 0)


def _count_repeated(spec: TableSpec, rows: pa.Table, names: Names) -> int:
    """Return how many rows repeat the key of another; rows in the order of their keys need no comparison of all."""
    texts = {item.name for item in spec.columns if _is_text(item.type)}
    is_later = np.zeros(rows.num_rows - 1, bool)  # than the row before
    is_equal = ~is_later
    for name in (SHARD, *spec.key):
        values = rows.column(name).to_numpy()
        values = names.ranks()[values] if name in texts else values
        is_later |= is_equal & (values[1:] > values[:-1])
        is_equal &= values[1:] == values[:-1]
    if is_later.all():
        return 0
    return _count_equal(spec.key, rows)


def _count_equal(columns: Sequence[str], rows: pa.Table) -> int:
    """Return how many rows have the values of another of their shard in some columns."""
    return rows.num_rows - rows.group_by([SHARD, *columns], use_threads=False).aggregate([]).num_rows


def columns_to_read(schema: pa.Schema, spec: TableSpec, more: Sequence[str]) -> list[str]:
    """Return the columns of a table that the checks of rows need: those that name a row, numbers, and `more`."""
    wanted = {"scenario", "weather", *spec.key, *spec.unique, *more}
    return [item.name for item in schema if item.name in wanted or pa.types.is_floating(_element(item.type))]


def _element(type_: pa.DataType) -> pa.DataType:
    """Return the type of the elements of a list, of whatever depth; other types as they are."""
    while pa.types.is_list(type_):
        type_ = type_.value_type
    return type_
