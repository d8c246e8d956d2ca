"""Read tables of frames from wherever they are: the files of a dataset, or memory."""

import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING, Any, Protocol

import pyarrow as pa
import pyarrow.dataset as pds

from mmw.channel.path_view import join_paths, split_columns
from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.storage.schemas import views, views_of
from mmw.storage.table_spec import ViewSpec

if TYPE_CHECKING:
    from mmw.dataset.dataset import Dataset


class TableReader(Protocol):
    """Source of a `Frame`: a `Dataset`, or `MemoryTables`."""

    @property
    def root(self) -> object:
        """Its place, as messages name it."""

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables that it has."""
        ...

    def frame_rate_hz(self, scenario: str) -> int:
        """Return the frames a second of a scenario [Hz]."""
        ...

    def read(
        self,
        table: str,
        *,
        columns: Sequence[str] | None = None,
        scenario: str | None = None,
        weather: str | None = None,
        frames: range | None = None,
        agent: str | None = None,
        sensor: str | None = None,
    ) -> pa.Table:
        """Return the rows of a table, see `Dataset.read`."""
        ...


@dataclass(frozen=True)
class MemoryTables:
    """Tables in memory, read like those of a `Dataset`."""

    root: str
    """Name of them in messages."""
    held: Mapping[str, pa.Table]
    """Table name -> rows, sorted by the table's key."""
    rate_hz: int = FRAME_RATE_HZ
    """Frames a second."""

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables."""
        return tuple(self.held)

    def frame_rate_hz(self, scenario: str) -> int:
        """Return the frames a second, the same for all scenarios [Hz]."""
        return self.rate_hz

    def read(
        self,
        table: str,
        *,
        columns: Sequence[str] | None = None,
        scenario: str | None = None,
        weather: str | None = None,
        frames: range | None = None,
        agent: str | None = None,
        sensor: str | None = None,
    ) -> pa.Table:
        """Return the rows of a table, see `Dataset.read`.

        Raises:
            InputError: If there is no such table or column.
        """
        if table in views_of(self.tables):
            return read_view(
                self, views()[table], columns=columns, scenario=scenario, weather=weather, frames=frames, agent=agent,
                sensor=sensor,
            )  # fmt: skip
        if table not in self.held:
            raise InputError(f"{self.root}: has no table {table!r}; it has {', '.join(self.held)}; name one of these")
        found = self.held[table]
        given = {"scenario": scenario, "weather": weather, "agent": agent, "sensor": sensor}
        given = {name: value for name, value in given.items() if value is not None}
        check_columns(self.root, table, found.column_names, [*(columns or ()), *given])
        expression = row_filter(given, frames)
        if expression is not None:
            found = found.filter(expression)
        return found.select(list(columns)) if columns else found


def read_view(
    reader: TableReader,
    view: ViewSpec,
    *,
    columns: Sequence[str] | None = None,
    agent: str | None = None,
    sensor: str | None = None,
    **where: Any,
) -> pa.Table:
    """Return the rows of the view `paths`; only the tables and columns are read that the wanted columns need.

    Args:
        reader: Source of the tables.
        view: The view.
        columns: Columns; None for all.
        agent: Only rows of this agent.
        sensor: No view has a column of this name.
        where: `scenario`, `weather` and `frames` of `Dataset.read`.

    Raises:
        InputError: If a column or a row is missing.
    """
    known = [field.name for field in view.columns]
    names = list(columns or known)
    check_columns(reader.root, view.name, known, [*names, *(["sensor"] if sensor is not None else [])])
    of_gains, of_geometry = split_columns(names)
    gains = reader.read("path_gains", columns=of_gains if columns else None, agent=agent, **where)
    where.pop("weather", None)
    geometry = None
    if of_geometry:
        geometry = reader.read("path_geometry", columns=of_geometry if columns else None, agent=agent, **where)
    try:
        return join_paths(gains, geometry, columns)
    except InputError as error:
        raise InputError(f"{reader.root}: {error}") from error


def path_columns(dataset: "Dataset") -> tuple[str, ...]:
    """Return the columns of `paths` that `CarrierPaths.from_table` reads; of an older schema those that it has."""
    from mmw.channel.path_table import NEEDED_COLUMNS, PATH_COLUMNS

    held = {*NEEDED_COLUMNS, *(dataset.arrow("path_geometry").schema.names if dataset.views else PATH_COLUMNS)}
    return tuple(name for name in PATH_COLUMNS if name in held)


def check_columns(root: object, table: str, known: Sequence[str], names: Sequence[str]) -> None:
    """Check that a table has columns.

    Raises:
        InputError: If one is missing.
    """
    missing = [name for name in names if name not in known]
    if missing:
        raise InputError(
            f"{root}: table {table!r}: has no column {', '.join(missing)}; it has {', '.join(known)}; name these"
        )


def row_filter(given: Mapping[str, str], frames: range | None) -> pds.Expression | None:
    """Return the condition of rows that have values in some columns and are of some frames; None for all rows."""
    conditions = [pds.field(name) == value for name, value in given.items()]
    if frames is not None:
        conditions += [pds.field("frame") >= min(frames, default=0), pds.field("frame") <= max(frames, default=-1)]
        if abs(frames.step) != 1:
            conditions.append(pds.field("frame").isin(list(frames)))
    return reduce(operator.and_, conditions) if conditions else None
