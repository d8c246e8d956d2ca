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
