"""Tables of a live frame: what they hold is traced when it is looked at first, and never again."""

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from functools import cached_property
from operator import itemgetter
from typing import Any

import numpy as np
import pyarrow as pa

from mmw.channel.frame_paths import FramePaths
from mmw.channel.links import Links
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.channel.path_table import CarrierPaths
from mmw.channel.paths import PathSet
from mmw.channel.tables import LINKS
from mmw.config import Config
from mmw.config.sensor_spec import SENSORS
from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.core.later import start_all
from mmw.core.remember import remembered
from mmw.dataset.frame import Boxes, Frame, PosedAgent
from mmw.dataset.sample_rows import Row
from mmw.dataset.table_reader import MemoryTables
from mmw.generation.capture import (
    capture_boxes,
    capture_poses,
    channel_links,
    channel_rows,
    started_sensors,
    started_sight,
    trace_channel,
)
from mmw.generation.live.row_parts import RowPart
from mmw.generation.pipeline import join_batches
from mmw.scene.table_rows import actor_names
from mmw.sensors.batch import Batch, TableRows
from mmw.storage.parquet_schema import arrow_schema
from mmw.storage.schemas import table_spec, views_of
from mmw.storage.table_spec import TableSpec

POSES = ("frames", "poses")
BOXES = ("boxes",)
SIGHT = ("box_visibility",)
CHANNEL = (LINKS.name, "path_gains", "path_geometry")

Maker = tuple[str, ...]
"""Source of the rows of tables: `poses`, `boxes`, `sight`, `channel`, or `sensor` and its name."""

Rows = Mapping[str, list[RowPart]]
"""Table -> parts of its rows."""

Solve = Callable[[Batch, SurfaceTable], tuple[Links, PathSet]]
"""Returns the links of a frame on the device, and their paths."""

Load = Callable[[str | None], AbstractContextManager[Batch]]
"""Puts the frame on the device and keeps it there; takes the only agent whose sensors count, or None for all."""


def table_makers(config: Config) -> dict[str, list[Maker]]:
    """Return what fills each table that frames of a configuration change."""
    makers: dict[str, list[Maker]] = defaultdict(list)
    for maker, names in (("poses", POSES), ("boxes", BOXES)):
        for name in names:
            makers[name].append((maker,))
    for sensor in config.sensors:
        spec = SENSORS[sensor.type]
        counts = spec.rows_per_sample(sensor) if spec.rows_per_sample else {}
        own = [table.name for table in spec.tables if counts.get(table.name, 1)]
        for name in (*own, *spec.shared_tables):
            makers[name].append(("sensor", sensor.name))
    if config.channel.enabled:
        for name in SIGHT:
            makers[name].append(("sight",))
        for name in CHANNEL:
            makers[name].append(("channel",))
    return dict(makers)


def capture_makers(
    batch: Batch, makers: Collection[Maker], frames: Sequence[int], rows: TableRows, solve: Solve | None = None
) -> None:
    """Add the rows of some loaded frames that some makers make, sensors together.

    Args:
        batch: The scenario.
        makers: The makers; `channel` needs `solve`.
        frames: The frames.
        rows: Where the rows go.
        solve: Returns links of the frames and their paths.
    """
    sensors = [sensor for sensor in batch.config.sensors if ("sensor", sensor.name) in makers]
    with (
        started_sensors(batch, frames, rows, sensors),
        started_sight(batch, frames, rows) if ("sight",) in makers else nullcontext(),
    ):
        if ("poses",) in makers:
            capture_poses(batch, frames, rows)
        if ("boxes",) in makers:
            capture_boxes(batch, frames, rows)
        if solve is not None and ("channel",) in makers and batch.surfaces is not None:
            channel_rows(batch, *solve(batch, batch.surfaces), rows)


class FrameTables:
    """Tables of one frame in one weather; a `TableReader`.

    What was traced is kept as columns; they become Arrow tables when a table is read.
    """

    def __init__(
        self,
        root: str,
        scenario: str,
        weather: str,
        frame: int,
        static: Mapping[str, pa.Table],
        load: Load,
        makers: Mapping[str, list[Maker]],
    ) -> None:
        """Hold nothing yet but the tables that no frame changes.

        Args:
            root: Name of the simulation in messages.
            scenario: Its scenario.
            weather: Its weather.
            frame: The frame.
            static: Tables that no frame changes.
            load: Puts the frame on the device.
            makers: From `table_makers`.
        """
        self.root = root
        self._where = scenario, weather, frame
        self._world = 0
        self._load = load
        self.static = static
        self._held: dict[str, pa.Table] = dict(static)
        self._makers = makers
        self._rows: dict[str, list[RowPart]] = defaultdict(list)
        self._done: set[Maker] = set()
        self._samples: dict[tuple[str, Maker], Rows] = {}
        self._channel: tuple[Links, PathSet] | None = None
        self._paths: FramePaths | None = None
        self._names: tuple[tuple[str, ...], tuple[str, ...]] = (), ()  # of actors and antennas

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables."""
        return tuple(dict.fromkeys((*self._held, *self._makers)))

    def changes(self, table: str) -> bool:
        """Return whether frames change a table."""
        return table in self._makers

    def frame_rate_hz(self, scenario: str) -> int:
        """Return the frames a second [Hz]."""
        return FRAME_RATE_HZ

    def read(self, table: str, **where: Any) -> pa.Table:
        """Return the rows of a table, see `Dataset.read`.

        Raises:
            InputError: If there is no such table or column, or the simulation is closed.
        """
        needed = ("path_gains", "path_geometry") if table in views_of(self.tables) else (table,)
        wanted = [name for name in needed if name in self._makers and name not in self._held]
        self.trace(wanted)
        for name in wanted:
            self._held[name] = self._table(name)
        if needed == (table,) and table not in self._held:
            raise InputError(f"{self.root}: has no table {table!r}; it has {', '.join(self.tables)}; name one of these")
        where = {name: value for name, value in where.items() if not self._is_met(table, name, value)}
        return MemoryTables(self.root, self._held, FRAME_RATE_HZ).read(table, **where)

    def _is_met(self, table: str, condition: str, value: Any) -> bool:
        """Return whether all rows of a table meet a condition of `Dataset.read`: a filter costs a millisecond."""
        scenario, weather, frame = self._where
        if value is None or table in self.static:
            return False
        if condition == "frames":
            return frame in value
        told = {"scenario": scenario}
        if table not in self._makers or _specs(self._makers)[table].by_weather:
            told["weather"] = weather
        return told.get(condition) == value

    def rows(self, table: str) -> list[Row]:
        """Return the rows of a table that frames change, by its key; none of another table, or of one that was read."""
        if table not in self._makers or table in self._held:
            return []
        self.trace([table])
        number = self._where[2]
        found = [row for part in self._rows[table] for row in part.rows(self._world, number)]
        return sorted(found, key=itemgetter(*_specs(self._makers)[table].key))

    def agents(self) -> list[PosedAgent] | None:
        """Return the agents that are there, by their names; None where table `poses` was read."""
        if "poses" in self._held:
            return None
        self.trace(["poses"])
        (part,) = self._rows["poses"]
        return part.agents(self._world, self._where[2])

    def arrays(self, table: str) -> dict[str, np.ndarray] | None:
        """Return the columns of a table in the order of its key; None where the table has to be made for it."""
        if table not in self._makers or table in self._held:
            return None
        self.trace([table])
        parts = self._rows[table]
        return parts[0].arrays(self._world, self._where[2]) if len(parts) == 1 else None

    def trace(self, tables: Iterable[str] | None = None) -> None:
        """Trace what some tables hold, or all tables for None, at once: cameras share their rays.

        Raises:
            InputError: If there is no such table, or the simulation is closed.
        """
        for name in tables or ():
            if name not in self._makers and name not in self.static:
                raise InputError(f"{self.root}: has no table {name!r}; it has {', '.join(self.tables)}; name one")
        wanted = self._makers if tables is None else [name for name in tables if name in self._makers]
        done = self._done
        makers = list(dict.fromkeys(one for name in wanted for one in self._makers[name] if one not in done))
        if makers:
            for name, parts in self._capture(makers, None).items():
                self._rows[name] += parts
            done.update(makers)

    def sample(self, table: str, agent: str, sensor: str) -> Row | None:
        """Return the row of one sensor of one agent; other agents' sensors are not traced for it."""
        maker = ("sensor", sensor)
        if maker not in self._makers.get(table, ()):
            return None
        if maker not in self._done:
            self.trace_samples(agent, [sensor])
        parts = self._rows[table] if maker in self._done else self._samples[agent, maker].get(table, [])
        for part in parts:
            row = part.row(self._world, self._where[2], agent, sensor)
            if row is not None:
                return row
        return None

    def trace_samples(self, agent: str, sensors: Collection[str]) -> None:
        """Trace some sensors of one agent at once."""
        wanted = [maker for sensor in sensors if (maker := ("sensor", sensor)) not in self._done]
        wanted = [maker for maker in wanted if (agent, maker) not in self._samples]
        if wanted:
            found = self._capture(wanted, agent)
            for maker in wanted:
                self._samples[agent, maker] = found

    def _capture(self, makers: Collection[Maker], agent: str | None) -> Rows:
        scenario, weather, frame = self._where
        rows: TableRows = {weather: defaultdict(list)}
        with self._load(agent) as batch:
            capture_makers(batch, makers, [frame], rows, self._channel_of)
        return parts_of(rows[weather], self._makers, {"scenario": scenario, "weather": weather})

    def paths(self, carrier_hz: float) -> CarrierPaths | None:
        """Return the paths at a carrier without making tables; None if there are none."""
        if "path_gains" not in self._makers:
            return None
        if self._channel is None:
            with self._load(None) as batch:
                if batch.surfaces is None:
                    return None
                self._channel_of(batch, batch.surfaces)
        assert self._channel is not None
        (links, paths), (scenario, weather, _) = self._channel, self._where
        carriers_hz = paths.carriers_hz.tolist()
        if not len(paths) or carrier_hz not in carriers_hz:
            return None
        if self._paths is None:
            self._paths = FramePaths(links, paths, weather, *self._names, scenario)
        return self._paths.at(carriers_hz.index(carrier_hz))

    def _channel_of(self, batch: Batch, surfaces: SurfaceTable) -> tuple[Links, PathSet]:
        """Return the links and their paths, traced once."""
        if self._channel is None:
            _, weather, frame = self._where
            links = channel_links(batch, [frame])
            self._channel = links, trace_channel(batch, surfaces, links, [weather])
            self._names = actor_names(batch.arrays.actors), antenna_names(batch.config)
        return self._channel

    def _table(self, name: str) -> pa.Table:
        scenario, weather, number = self._where
        sources = [part.source_of(self._world, number) for part in self._rows.get(name, [])]
        if not sources:
            return arrow_schema(name).empty_table()
        start_all(sources)
        return join_batches(name, scenario, weather, sources)


def parts_of(
    rows: Mapping[str, list[Any]],
    makers: Mapping[str, list[Maker]],
    fixed: Mapping[str, str],
    worlds: range | None = None,
    pool: Executor | None = None,
) -> dict[str, list[RowPart]]:
    """Return traced columns of tables as parts of their rows.

    Args:
        rows: Table -> columns.
        makers: From `table_makers`.
        fixed: As of `RowPart`, as are the others.
        worlds: Worlds that were traced.
        pool: Threads.
    """
    specs = _specs(makers)
    return {
        name: [RowPart(specs[name], fixed, source, worlds, pool) for source in sources]
        for name, sources in rows.items()
    }


@remembered(size=8)
def _specs(makers: Mapping[str, list[Maker]]) -> dict[str, TableSpec]:
    return {name: table_spec(name) for name in makers}


@remembered(size=8)
def antenna_names(config: Config) -> tuple[str, ...]:
    """Return the names of the antennas of a configuration."""
    return config.channel.antenna_names


@remembered(size=8)
def static_table_rows(static: Mapping[str, pa.Table], table: str) -> list[Row]:
    """Return the rows of a table that no frame changes."""
    return static[table].to_pylist()


class LiveFrame(Frame):
    """A frame of a live simulation, traced when it is looked at: a sensor of an agent by itself."""

    def trace(self, *tables: str) -> None:
        """Trace what some tables hold, or all for none, at once."""
        assert isinstance(self.data, FrameTables)
        self.data.trace(tables or None)

    def rows(self, table: str) -> list[Row]:
        """Return the rows of a table as mappings, by its key; lists of numbers are arrays."""
        assert isinstance(self.data, FrameTables)
        return super().rows(table) if table in self._tables else self.data.rows(table) or super().rows(table)

    def posed_agents(self) -> list[PosedAgent]:
        """Return the agents that are there, by their names."""
        assert isinstance(self.data, FrameTables)
        found = None if "poses" in self._tables else self.data.agents()
        return super().posed_agents() if found is None else found

    @cached_property
    def boxes(self) -> Boxes:
        """Boxes of all vehicles and people."""
        assert isinstance(self.data, FrameTables)
        found = None if "boxes" in self._tables else self.data.arrays("boxes")
        return super().boxes if found is None else Boxes(found)

    @cached_property
    def sensor_rows(self) -> list[Row]:
        """Rows of table `sensors` of the scenario."""
        assert isinstance(self.data, FrameTables)
        return static_table_rows(self.data.static, "sensors")

    def row_of(self, table: str, agent: str, sensor: str) -> Row | None:
        """Return the row of one sensor in a table; None if there is none."""
        assert isinstance(self.data, FrameTables)
        if table in self._tables or not self.data.changes(table):
            return super().row_of(table, agent, sensor)
        return self.data.sample(table, agent, sensor)

    def paths(self, carrier_hz: float) -> CarrierPaths:
        """Return the paths of all links of this frame at a carrier [Hz].

        Arrays that are the same at every carrier are one, which is read-only.

        Raises:
            InputError: If the frame has no paths at this carrier.
        """
        assert isinstance(self.data, FrameTables)
        found = self.data.paths(carrier_hz)
        return super().paths(carrier_hz) if found is None else found

    def prepare_samples(self, agent: str, sensors: Collection[str]) -> None:
        """Trace some sensors of one agent at once."""
        assert isinstance(self.data, FrameTables)
        self.data.trace_samples(agent, sensors)
