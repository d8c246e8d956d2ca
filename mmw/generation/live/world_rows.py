"""Take columns of a table that hold the rows of several worlds apart, without making tables."""

from collections.abc import Mapping
from concurrent.futures import Executor, Future
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa

from mmw.core.later import Later
from mmw.storage.list_column import ListColumn


class WorldRows:
    """Part of the rows of a table, in which column `frame` counts worlds.

    Attributes:
        part: Its columns, or the future of them.
        worlds: Worlds that were traced for it.
    """

    def __init__(self, part: Any, worlds: range) -> None:
        """Take columns as `TableRows` has them."""
        self.part = part
        self.worlds = worlds

    @cached_property
    def _columns(self) -> Mapping[str, Any]:
        """Columns with the rows in the order of the worlds."""
        columns = self.part.result() if isinstance(self.part, Future) else self.part
        frame = np.asarray(columns["frame"])
        if (frame[1:] >= frame[:-1]).all():
            return columns
        order = np.argsort(frame, kind="stable")
        return {name: _taken(values, order) for name, values in columns.items()}

    @cached_property
    def _starts(self) -> list[int]:
        """First row of every world, and the number of rows."""
        ends = range(self.worlds.start, self.worlds.stop + 1)
        return np.searchsorted(self._columns["frame"], ends).tolist()

    def of(self, world: int, number: int) -> dict[str, Any]:
        """Return the rows of a world; their frame gets its number."""
        place = world - self.worlds.start
        rows = slice(*self._starts[place : place + 2])
        own = {name: values if _is_scalar(values) else values[rows] for name, values in self._columns.items()}
        own["frame"] = np.full(rows.stop - rows.start, number, dtype=np.int32)
        return own

    def part_of(self, world: int, number: int, pool: Executor) -> Any:
        """Return the rows of a world as `TableRows` has them; a future stays one."""
        return Later(pool, self.of, world, number) if isinstance(self.part, Future) else self.of(world, number)


def _is_scalar(values: Any) -> bool:
    return not isinstance(values, (np.ndarray, pa.Array, ListColumn, list))


def _taken(values: Any, order: np.ndarray) -> Any:
    if isinstance(values, list):
        return [values[index] for index in order.tolist()]
    if isinstance(values, pa.Array):
        return values.take(pa.array(order))
    if isinstance(values, ListColumn):
        return values.take(order)
    return values[order] if isinstance(values, np.ndarray) else values
