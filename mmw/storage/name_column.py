"""Hold a column of texts as indices into a few of them, which becomes an Arrow array when a table is made of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pyarrow as pa


@dataclass(frozen=True)
class Names:
    """Texts without repetition."""

    dictionary: pa.StringArray
    """The texts."""

    @cached_property
    def texts(self) -> tuple[str | None, ...]:
        """The texts, and None after the last, where index -1 finds it."""
        return (*self.dictionary.to_pylist(), None)

    @cached_property
    def objects(self) -> np.ndarray:
        """`texts` as an array of objects."""
        return np.array(self.texts, dtype=object)


@dataclass(frozen=True)
class NameColumn:
    """Texts of rows, given by their indices."""

    code: np.ndarray
    """Index of the text of each row, -1 for none, shape [rows], int32; not to be written to."""
    names: Names
    """The texts."""
    can_be_null: bool = False
    """True if a row may have none."""

    def __len__(self) -> int:
        return len(self.code)

    def __getitem__(self, rows: slice | np.ndarray) -> "NameColumn":
        """Return some rows."""
        return NameColumn(self.code[rows], self.names, self.can_be_null)

    @property
    def has_null(self) -> bool:
        """Whether a row has no text."""
        return self.can_be_null and bool((self.code < 0).any())

    def to_list(self) -> list[str | None]:
        """Return the text of each row."""
        texts = self.names.texts
        return [texts[index] for index in self.code.tolist()]

    def to_array(self) -> np.ndarray:
        """Return the text of each row as an array of objects."""
        return self.names.objects[self.code]

    def to_arrow(self) -> pa.DictionaryArray:
        """Return the column as an Arrow array."""
        index = pa.array(self.code, mask=self.code < 0) if self.can_be_null else pa.array(self.code)
        return pa.DictionaryArray.from_arrays(index, self.names.dictionary)

    def __arrow_array__(self, type: pa.DataType | None = None) -> pa.Array:
        """Return the column for `pyarrow.array` and `pyarrow.table`."""
        return self.to_arrow() if type is None else self.to_arrow().cast(type)


def name_column(texts: Sequence[str | None]) -> NameColumn:
    """Return texts as a column, None for none; they are numbered in the order of their first appearance."""
    array = pa.array(texts, pa.string()).dictionary_encode()
    code = array.indices.fill_null(-1).to_numpy().astype(np.int32)
    return NameColumn(code, Names(array.dictionary), array.null_count > 0)
