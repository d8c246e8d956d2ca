"""Hold a list column as NumPy arrays, which become an Arrow array when a table is made of it."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pyarrow as pa


@dataclass(frozen=True)
class ListColumn:
    """Lists of numbers without nulls: row a holds `values[offsets[a]:offsets[a + 1]]`."""

    offsets: np.ndarray
    """First value of every row, and their number, shape [rows + 1], int32."""
    values: np.ndarray
    """Values of all rows, one after the other; not to be written to."""

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def __getitem__(self, rows: slice) -> "ListColumn":
        """Return consecutive rows."""
        first, last, _ = rows.indices(len(self))
        offsets = self.offsets[first : max(last, first) + 1]
        return ListColumn(offsets - offsets[0], self.values[offsets[0] : offsets[-1]])

    def take(self, order: np.ndarray) -> "ListColumn":
        """Return rows by their numbers."""
        every = self.rows()
        chosen = [every[index] for index in order.tolist()]
        offsets = np.zeros(len(chosen) + 1, dtype=np.int32)
        np.cumsum([len(row) for row in chosen], out=offsets[1:])
        return ListColumn(offsets, np.concatenate([self.values[:0], *chosen]))

    def rows(self) -> list[np.ndarray]:
        """Return the lists, which cannot be written to: a table may be made of them later."""
        values = self.values.view()
        values.flags.writeable = False
        ends = self.offsets.tolist()
        return [values[first:last] for first, last in pairwise(ends)]

    def to_arrow(self) -> pa.ListArray:
        """Return the column as an Arrow array."""
        flat = pa.array(np.ascontiguousarray(self.values))
        type_ = pa.list_(pa.field("element", flat.type, nullable=False))
        return pa.ListArray.from_arrays(pa.array(self.offsets), flat, type=type_)
