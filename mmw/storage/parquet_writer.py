"""Write a Parquet file in memory, batch by batch, with row groups of whole frames.

The content of a file does not depend on the sizes of the batches.
"""

import pyarrow as pa
import pyarrow.parquet as pq

from mmw.storage.arrow_tables import normalize_names, sort_rows
from mmw.storage.parquet_schema import arrow_schema, write_options
from mmw.storage.schemas import table_spec

ROWS_PER_GROUP = 65_536
"""Rows of a row group in tables without `frames_per_group`. Design value."""


ROWS = "mmw.rows"
"""File-level key: number of rows as written. Tools that filter a file keep the key, so that `mmw verify` sees it."""


class ParquetFileBuilder:
    """File of one table of a shard. Complete row groups are encoded at once; other rows wait for their frames."""

    def __init__(self, name: str, frame_begin: int, file_meta: dict[str, str]):
        """Start an empty file."""
        self._spec = table_spec(name)
        self._schema = arrow_schema(name, file_meta)
        self._sink = pa.BufferOutputStream()
        self._writer = pq.ParquetWriter(self._sink, self._schema, **write_options(name))
        self._next_frame = frame_begin
        self._waiting: list[pa.Table] = []
        self.rows = 0

    def add(self, table: pa.Table, frame_end: int) -> None:
        """Add the rows of the next frames, sorted by the table's key."""
        self.rows += table.num_rows
        self._waiting.append(table)
        step = self._spec.frames_per_group
        if step and frame_end - self._next_frame >= step:
            self._write_groups(frame_end - (frame_end - self._next_frame) % step)

    def close(self) -> memoryview:
        """Encode the waiting rows and return the file.

        Raises:
            ValueError: If two rows have the same key.
        """
        if self._waiting:
            rest = self._pop_waiting()
            if rest.num_rows or not self.rows:
                rest = sort_rows(self._spec, rest)
                self._write(rest, max(rest.num_rows, 1) if self._spec.frames_per_group else ROWS_PER_GROUP)
        self._writer.add_key_value_metadata({ROWS: str(self.rows)})
        self._writer.close()
        return memoryview(self._sink.getvalue())

    def _write_groups(self, frame_end: int) -> None:
        """Encode the row groups before a frame, each of `frames_per_group` frames."""
        table = self._pop_waiting()
        frame = table.column("frame").to_numpy()
        begin = 0
        for first in range(self._next_frame, frame_end, self._spec.frames_per_group):
            end = int(frame.searchsorted(first + self._spec.frames_per_group))
            if end > begin:
                self._write(normalize_names(table.slice(begin, end - begin)), end - begin)
            begin = end
        self._next_frame = frame_end
        if begin < table.num_rows:
            self._waiting = [table.slice(begin)]

    def _pop_waiting(self) -> pa.Table:
        """Remove and return all waiting rows as one table."""
        waiting, self._waiting = self._waiting, []
        return waiting[0] if len(waiting) == 1 else pa.concat_tables(waiting).unify_dictionaries().combine_chunks()

    def _write(self, table: pa.Table, group: int) -> None:
        self._writer.write_table(table.replace_schema_metadata(self._schema.metadata), row_group_size=group)
