"""Frames of several worlds at one moment: what is looked at in one is traced for all in one launch."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pyarrow as pa

from mmw.channel.path_table import CarrierPaths
from mmw.channel.path_view import join_paths
from mmw.core.errors import InputError, is_out_of_memory
from mmw.core.kinematics import differentiate
from mmw.generation.live.episode import Episode, catch_up
from mmw.generation.live.frame_tables import FrameTables, LiveFrame
from mmw.generation.live.live_run import World
from mmw.generation.pipeline import join_batches
from mmw.scene.world_batch import NEIGHBORS, WorldBatch
from mmw.sensors.batch import Batch, TableRows
from mmw.storage.arrow_tables import normalize_names, sort_rows
from mmw.storage.parquet_schema import arrow_schema
from mmw.storage.schemas import table_spec

TOGETHER = frozenset({"lidar", "depth", "rgb", "radar"})
"""Types of sensors that are traced for all worlds at once. The samples of others may depend on earlier frames, such as
those of an IMU; they are made world by world."""

Maker = tuple[str, ...]
Rows = dict[str, pa.Table]


@dataclass(frozen=True)
class Worlds:
    """Town, weather and names that the worlds of a simulation have in common."""

    world: World
    weather: str
    scenario: str
    name: str
    """Of the simulation, in messages."""
    report: Callable[[str], None]
    """Takes a note for the user."""

    @cached_property
    def together(self) -> frozenset[Maker]:
        """Makers of rows that work for all worlds at once."""
        sensors = [("sensor", one.name) for one in self.world.config.sensors if one.type in TOGETHER]
        return frozenset([*sensors, ("poses",), ("boxes",), ("sight",), ("channel",)])


class WorldFrames:
    """The frames of all worlds at one moment, in which a table is traced once, when it is read first."""

    def __init__(self, worlds: Worlds, episodes: Sequence[Episode]) -> None:
        """Hold nothing yet.

        Args:
            worlds: What the worlds share.
            episodes: Their episodes, which may go on later.
        """
        self._worlds = worlds
        self._moments = [(episode, episode.frame) for episode in episodes]
        self._made: dict[tuple[Maker, str | None], Rows] = {}
        self.frames: list[LiveFrame] = [self._frame(index) for index in range(len(episodes))]
        """The frame of every world."""

    def _frame(self, index: int) -> LiveFrame:
        worlds, (episode, number) = self._worlds, self._moments[index]

        def load(agent: str | None) -> AbstractContextManager[Batch]:
            return worlds.world.showing(episode, number, agent, f"{worlds.name}, world {index}")

        tables = WorldTables(
            f"{worlds.name}, world {index}", worlds.scenario, worlds.weather, number, worlds.world.static, load,
            worlds.world.config,
        )  # fmt: skip
        tables.share(self, index)
        return LiveFrame(tables, worlds.scenario, worlds.weather, number)

    def can_make(self, maker: Maker) -> bool:
        """Return whether a maker of rows works for all worlds at once."""
        return maker in self._worlds.together

    def rows_of(self, index: int, maker: Maker, agent: str | None) -> Rows:
        """Return the rows of one world that a maker makes, of one agent's sensors or of all."""
        number = self._moments[index][1]
        return {name: _of_world(table, index, number) for name, table in self._rows(maker, agent).items()}

    def table(self, name: str) -> pa.Table:
        """Return the rows of a table of all worlds; column `frame` counts the worlds.

        Raises:
            InputError: If there is no such table, or it is made world by world.
        """
        tables = self.frames[0].data
        makers = tables.makers_of(name) if isinstance(tables, WorldTables) else []
        if not makers:
            raise InputError(f"{self._worlds.name}: has no table {name!r} of frames")
        for maker in makers:
            if not self.can_make(maker):
                raise InputError(
                    f"{self._worlds.name}: table {name!r} has sensor {maker[1]!r}, which is made world by world; read "
                    "it from the frames"
                )
        parts = [self._rows(maker, None)[name] for maker in makers if name in self._rows(maker, None)]
        if not parts:
            return arrow_schema(name).empty_table()
        whole = pa.concat_tables(parts).unify_dictionaries().combine_chunks()
        return parts[0] if len(parts) == 1 else sort_rows(table_spec(name), whole)

    def paths(self, carrier_hz: float) -> CarrierPaths:
        """Return the paths of the links of all worlds at a carrier [Hz]; `frame` of their keys counts the worlds.

        Raises:
            InputError: If there are no paths at this carrier.
        """
        made = self._rows(("channel",), None)
        names = ("links", "path_gains", "path_geometry")
        links, gains, geometry = (made.get(name, arrow_schema(name).empty_table()) for name in names)
        return CarrierPaths.from_table(join_paths(gains, geometry), carrier_hz, links)

    def _rows(self, maker: Maker, agent: str | None) -> Rows:
        key = maker, agent
        if key not in self._made:
            self._made[key] = self._made[maker, None] if (maker, None) in self._made else self._trace(maker, agent)
        return self._made[key]

    def _trace(self, maker: Maker, agent: str | None) -> Rows:
        """Trace all worlds, in one launch if the memory is enough; `frame` of the rows counts the worlds."""
        world, step = self._worlds.world, len(self._moments)
        rows: TableRows = {self._worlds.weather: defaultdict(list)}
        with world.lock:
            world.check_open(self._worlds.name)
            batch, first = self._batch(agent), 0
            while first < len(self._moments):
                some = range(first, min(first + step, len(self._moments)))
                found: TableRows = {self._worlds.weather: defaultdict(list)}
                try:
                    self._load(batch, some)
                    FrameTables.capture(batch, maker, some, found)
                    made = {
                        name: _joined(name, self._worlds, parts) for name, parts in found[self._worlds.weather].items()
                    }
                except (MemoryError, RuntimeError) as error:
                    if len(some) == 1 or not is_out_of_memory(error):
                        raise
                    step = len(some) // 2
                    self._worlds.report(f"memory is full with {len(some)} worlds a launch; going on with {step}")
                    continue
                for name, table in made.items():
                    rows[self._worlds.weather][name].append(table)
                first = some.stop
        return {
            name: pa.concat_tables(parts).unify_dictionaries().combine_chunks() if len(parts) > 1 else parts[0]
            for name, parts in rows[self._worlds.weather].items()
        }

    @cached_property
    def _arrays(self) -> WorldBatch:
        catch_up(self._moments)
        numbers = [number for _, number in self._moments]
        around = [episode.poses_around(number, NEIGHBORS) for episode, number in self._moments]
        data = self._worlds.world.batch.arrays
        return WorldBatch.of(data, around, numbers, [episode.seed for episode, _ in self._moments])

    @cached_property
    def _whole(self) -> Batch:
        arrays = self._arrays
        return replace(self._worlds.world.batch, arrays=arrays, motion=differentiate(arrays.poses, arrays.pose_dt))

    def _batch(self, agent: str | None) -> Batch:
        if agent is None:
            return self._whole
        return replace(self._whole, arrays=replace(self._arrays, sensing=frozenset([agent])))

    def _load(self, batch: Batch, some: range) -> None:
        """Put the frames of some worlds on the device, if they are not there; the lock is held."""
        world, scene = self._worlds.world, batch.scene
        if world.shown != (self, some.start, some.stop):
            world.shown = None
            if scene.arrays is not self._arrays:
                scene.replace_arrays(self._arrays)
            scene.load_batch(some)
            world.shown = self, some.start, some.stop


class WorldTables(FrameTables):
    """Tables of the frame of one of several worlds; a `TableReader`."""

    _frames: WorldFrames
    _index: int

    def share(self, frames: WorldFrames, index: int) -> None:
        """Take rows of `frames`, where this is the frame of world `index`."""
        self._frames, self._index = frames, index

    def makers_of(self, table: str) -> Sequence[Maker]:
        """Return what makes the rows of a table."""
        return self._makers.get(table, [])

    def _rows_of(self, maker: Maker, agent: str | None) -> Rows:
        if not self._frames.can_make(maker):
            return super()._rows_of(maker, agent)
        made = self._frames.rows_of(self._index, maker, agent)
        return {**self._missing(maker, made), **made}


def _joined(name: str, worlds: Worlds, parts: Sequence[object]) -> pa.Table:
    return normalize_names(join_batches(name, worlds.scenario, worlds.weather, parts))


def _of_world(table: pa.Table, index: int, number: int) -> pa.Table:
    """Return the rows of a world with the number of its frame, from rows that are sorted by world."""
    column = table.column_names.index("frame")
    worlds = table.column(column).to_numpy()
    start, stop = np.searchsorted(worlds, [index, index + 1])
    own = table.slice(start, stop - start)
    numbers = pa.array(np.full(stop - start, number), type=table.schema.field(column).type)
    return normalize_names(own.set_column(column, table.schema.field(column), numbers))
