"""Hold rows of a table as the columns that were traced, of one frame or of several worlds, until they are asked for."""

from collections import defaultdict
from collections.abc import Mapping
from concurrent.futures import Executor
from functools import cached_property, partial
from typing import Any

import numpy as np
import pyarrow as pa

from mmw.core.later import Later, Waiting
from mmw.dataset.camera_geometry import POSE_COLUMNS, poses_of_columns
from mmw.dataset.frame import PosedAgent
from mmw.dataset.sample_rows import ColumnRows, Row, sorted_arrays
from mmw.storage.list_column import ListColumn
from mmw.storage.name_column import NameColumn
from mmw.storage.table_spec import TableSpec


class RowPart:
    """Rows of a table that were made at once.

    Column `frame` has the number of the frame, or counts worlds where there are several, which is told apart here: all
    methods take a world, and the number of its frame.

    Attributes:
        source: The columns, or the future of them.
        worlds: Worlds that were traced for it; None for the rows of one frame.
    """

    def __init__(
        self,
        spec: TableSpec,
        fixed: Mapping[str, str],
        source: Any,
        worlds: range | None = None,
        pool: Executor | None = None,
    ) -> None:
        """Take columns as `TableRows` has them.

        Args:
            spec: The table.
            fixed: Scenario and weather.
            source: The columns, or the future of them.
            worlds: Worlds that were traced for it; None for the rows of one frame.
            pool: Threads that part the rows of the worlds.
        """
        self._spec = spec
        self._fixed = fixed
        self._pool = pool
        self.source = source
        self.worlds = worlds

    @cached_property
    def _columns(self) -> Mapping[str, Any]:
        return self.source.result() if isinstance(self.source, Waiting) else self.source

    @cached_property
    def _cells(self) -> ColumnRows:
        return ColumnRows(self._spec, {**self._fixed, **self._columns})

    def row(self, world: int, number: int, agent: str, sensor: str) -> Row | None:
        """Return the row of a sensor in a frame; None if there is none. Its frame gets its number."""
        index = self._cells.by_sensor.get((self._key(world, number), agent, sensor))
        return None if index is None else self._row(index, number)

    def rows(self, world: int, number: int) -> list[Row]:
        """Return the rows of a frame, which get its number."""
        own = self._cells.by_frame.get(self._key(world, number), ())
        return [self._row(index, number) for index in own]

    def _key(self, world: int, number: int) -> int:
        return number if self.worlds is None else world

    def _row(self, index: int, number: int) -> Row:
        row = self._cells[index]
        row["frame"] = number
        return row

    @cached_property
    def _agents(self) -> dict[int, list[tuple[str, str, int]]]:
        """Name, role and row of the agents of each frame, by their names; of table `poses`."""
        columns = self._columns
        found = defaultdict(list)
        of = columns["frame"].tolist(), columns["agent"].to_list(), columns["role"].to_list()
        for index, (frame, name, role) in enumerate(zip(*of, strict=True)):
            found[frame].append((name, role, index))
        return {frame: sorted(own) for frame, own in found.items()}

    @cached_property
    def _poses(self) -> np.ndarray:
        """Pose of each row, shape [N, 7]."""
        return poses_of_columns([self._columns[name] for name in POSE_COLUMNS])

    def agents(self, world: int, number: int) -> list[PosedAgent]:
        """Return the agents of a frame by their names, of table `poses`."""
        poses, own = self._poses, self._agents.get(self._key(world, number), ())
        return [(name, role, poses[k].copy(), partial(self._row, k, number)) for name, role, k in own]

    def arrays(self, world: int, number: int) -> dict[str, np.ndarray] | None:
        """Return the rows of a frame as `sorted_arrays` does."""
        return sorted_arrays(self._spec, {**self._fixed, **self.columns(world, number)})

    @cached_property
    def _by_world(self) -> tuple[Mapping[str, Any], list[int]]:
        """Columns with the rows in the order of the worlds; the first row of every world, and the number of rows."""
        assert self.worlds is not None
        columns, frame = self._columns, np.asarray(self._columns["frame"])
        if not (frame[1:] >= frame[:-1]).all():
            order = np.argsort(frame, kind="stable")
            columns = {name: _taken(values, order) for name, values in columns.items()}
        ends = range(self.worlds.start, self.worlds.stop + 1)
        return columns, np.searchsorted(columns["frame"], ends).tolist()

    def columns(self, world: int, number: int) -> Mapping[str, Any]:
        """Return the columns of a frame, which get its number."""
        if self.worlds is None:
            return self._columns
        columns, starts = self._by_world
        place = world - self.worlds.start
        rows = slice(*starts[place : place + 2])
        own = {name: values if _is_scalar(values) else values[rows] for name, values in columns.items()}
        own["frame"] = np.full(rows.stop - rows.start, number, dtype=np.int32)
        return own

    def source_of(self, world: int, number: int) -> Any:
        """Return the rows of a frame as `TableRows` has them; a future stays one."""
        if self.worlds is None:
            return self.source
        if self._pool is not None and isinstance(self.source, Waiting):
            return Later(self._pool, self.columns, world, number)
        return self.columns(world, number)


def _is_scalar(values: Any) -> bool:
    return not isinstance(values, (np.ndarray, pa.Array, ListColumn, NameColumn, list))


def _taken(values: Any, order: np.ndarray) -> Any:
    if isinstance(values, list):
        return [values[index] for index in order.tolist()]
    if isinstance(values, pa.Array):
        return values.take(pa.array(order))
    if isinstance(values, ListColumn):
        return values.take(order)
    return values[order] if isinstance(values, (np.ndarray, NameColumn)) else values
