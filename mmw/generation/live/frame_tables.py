"""Tables of a live frame, each traced when it is read first, and never again."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any

import pyarrow as pa

from mmw.channel.tables import LINKS
from mmw.config import Config
from mmw.config.sensor_spec import SENSORS
from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.dataset.frame import Frame
from mmw.dataset.sample_rows import Row, rows_of_table
from mmw.dataset.table_reader import MemoryTables
from mmw.generation.capture import (
    capture_boxes,
    capture_channel,
    capture_poses,
    capture_sensors,
    capture_sight,
    channel_links,
)
from mmw.generation.pipeline import join_batches
from mmw.sensors.batch import Batch, TableRows
from mmw.storage.arrow_tables import normalize_names, sort_rows
from mmw.storage.parquet_schema import arrow_schema
from mmw.storage.schemas import table_spec, views_of

POSES = ("frames", "poses")
BOXES = ("boxes",)
SIGHT = ("box_visibility",)
CHANNEL = (LINKS.name, "path_gains", "path_geometry")

Load = Callable[[str | None], AbstractContextManager[Batch]]
"""Puts the frame on the device and keeps it there; takes the only agent whose sensors count, or None for all."""


class FrameTables:
    """Tables of one frame in one weather; a `TableReader`."""

    def __init__(
        self,
        root: str,
        scenario: str,
        weather: str,
        frame: int,
        static: Mapping[str, pa.Table],
        load: Load,
        config: Config,
    ) -> None:
        """Hold nothing yet but the tables that no frame changes.

        Args:
            root: Name of the simulation in messages.
            scenario: Its scenario.
            weather: Its weather.
            frame: The frame.
            static: Tables that no frame changes.
            load: Puts the frame on the device.
            config: The configuration.
        """
        self.root = root
        self._where = scenario, weather, frame
        self._load = load
        self._held: dict[str, pa.Table] = dict(static)
        self._samples: dict[tuple[str, str], dict[str, pa.Table]] = {}
        self._makers: dict[str, list[tuple[str, ...]]] = defaultdict(list)
        for maker, names in (("poses", POSES), ("boxes", BOXES)):
            for name in names:
                self._makers[name].append((maker,))
        for sensor in config.sensors:
            spec = SENSORS[sensor.type]
            counts = spec.rows_per_sample(sensor) if spec.rows_per_sample else {}
            own = [table.name for table in spec.tables if counts.get(table.name, 1)]
            for name in (*own, *spec.shared_tables):
                self._makers[name].append(("sensor", sensor.name))
        if config.channel.enabled:
            for name in SIGHT:
                self._makers[name].append(("sight",))
            for name in CHANNEL:
                self._makers[name].append(("channel",))
        self._done: dict[tuple[str, ...], dict[str, pa.Table]] = {}

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables."""
        return (*self._held, *self._makers)

    def frame_rate_hz(self, scenario: str) -> int:
        """Return the frames a second [Hz]."""
        return FRAME_RATE_HZ

    def read(self, table: str, **where: Any) -> pa.Table:
        """Return the rows of a table, see `Dataset.read`.

        Raises:
            InputError: If there is no such table or column, or the simulation is closed.
        """
        needed = ("path_gains", "path_geometry") if table in views_of(self.tables) else (table,)
        for name in needed:
            if name in self._makers and name not in self._held:
                parts = [self._trace(maker)[name] for maker in self._makers[name]]
                whole = pa.concat_tables(parts).unify_dictionaries().combine_chunks()
                self._held[name] = parts[0] if len(parts) == 1 else sort_rows(table_spec(name), whole)
        if needed == (table,) and table not in self._held:
            raise InputError(f"{self.root}: has no table {table!r}; it has {', '.join(self.tables)}; name one of these")
        return MemoryTables(self.root, self._held, FRAME_RATE_HZ).read(table, **where)

    def sample(self, table: str, agent: str, sensor: str) -> pa.Table:
        """Return the rows of a table of one sensor of one agent; other agents' sensors are not traced for it."""
        makers = self._makers.get(table, [])
        own = ("sensor", sensor)
        if table in self._held or own not in makers or own in self._done:
            return self.read(table, agent=agent, sensor=sensor)
        key = agent, sensor
        if key not in self._samples:
            self._samples[key] = self._rows_of(own, agent)
        return self._samples[key][table]

    def _trace(self, maker: tuple[str, ...]) -> dict[str, pa.Table]:
        if maker not in self._done:
            self._done[maker] = self._rows_of(maker, None)
        return self._done[maker]

    def _rows_of(self, maker: tuple[str, ...], agent: str | None) -> dict[str, pa.Table]:
        scenario, weather, frame = self._where
        rows: TableRows = {weather: defaultdict(list)}
        with self._load(agent) as batch:
            self._capture(batch, maker, [frame], rows)
            made = {
                name: normalize_names(join_batches(name, scenario, weather, batches))
                for name, batches in rows[weather].items()
            }
        missing = [name for name, makers in self._makers.items() if maker in makers and name not in made]
        return {**made, **{name: arrow_schema(name).empty_table() for name in missing}}

    @staticmethod
    def _capture(batch: Batch, maker: tuple[str, ...], frames: Sequence[int], rows: TableRows) -> None:
        kind = maker[0]
        if kind == "poses":
            capture_poses(batch, frames, rows)
        elif kind == "boxes":
            capture_boxes(batch, frames, rows)
        elif kind == "sight":
            capture_sight(batch, frames, rows)
        elif kind == "sensor":
            sensors = [sensor for sensor in batch.config.sensors if sensor.name == maker[1]]
            capture_sensors(batch, frames, rows, sensors)
        elif batch.surfaces is not None:
            capture_channel(batch, batch.surfaces, channel_links(batch, frames), rows)


class LiveFrame(Frame):
    """A frame of a live simulation, traced when it is looked at: a sensor of an agent by itself."""

    def row_of(self, table: str, agent: str, sensor: str) -> Row | None:
        """Return the row of one sensor in a table; None if there is none."""
        assert isinstance(self.data, FrameTables)
        if table in self._tables or table not in self.data.tables:
            return super().row_of(table, agent, sensor)
        found = self.data.sample(table, agent, sensor)
        return rows_of_table(found)[0] if found.num_rows else None
