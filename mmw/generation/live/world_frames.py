"""Frames of several worlds at one moment: what is looked at in one is traced for all in one launch."""

from collections import defaultdict
from collections.abc import Callable, Collection, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
import pyarrow as pa

from mmw.channel.frame_paths import FramePaths
from mmw.channel.links import Links
from mmw.channel.path_table import CarrierPaths
from mmw.channel.path_view import join_paths
from mmw.channel.paths import PathSet
from mmw.channel.paths_by_frame import PathsByFrame
from mmw.core.errors import InputError
from mmw.core.later import start_all
from mmw.generation.capture import channel_links, channel_rows, trace_channel
from mmw.generation.live.episode import BEFORE, Episode, poses_around
from mmw.generation.live.frame_tables import (
    FrameTables,
    LiveFrame,
    Maker,
    Rows,
    antenna_names,
    capture_makers,
    parts_of,
)
from mmw.generation.live.live_run import World
from mmw.generation.live.row_parts import RowPart
from mmw.generation.pipeline import join_batches, launch_in_parts
from mmw.scene.table_rows import actor_names
from mmw.scene.world_batch import NEIGHBORS, WorldBatch
from mmw.sensors.batch import Batch, TableRows
from mmw.storage.parquet_schema import arrow_schema

TOGETHER = frozenset({"lidar", "depth", "rgb", "radar"})
"""Types of sensors that are traced for all worlds at once. The samples of others may depend on earlier frames, such as
those of an IMU; they are made world by world."""

T = TypeVar("T")


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
        self._made: dict[tuple[frozenset[Maker], str | None], Rows] = {}
        self._tables: dict[str, pa.Table] = {}
        self._carriers: dict[float, CarrierPaths | None] = {}
        self._parted: dict[float, PathsByFrame | None] = {}
        self._found: dict[tuple[tuple[Maker, ...], str | None], tuple[Rows, bool]] = {}  # and if all have all worlds

    def frames(self) -> list[LiveFrame]:
        """Return the frame of every world; they refer to this, and this not to them, so that it ends with the last."""
        return [self._frame(index) for index in range(len(self._moments))]

    def _frame(self, index: int) -> LiveFrame:
        worlds, (episode, number) = self._worlds, self._moments[index]

        def load(agent: str | None) -> AbstractContextManager[Batch]:
            return worlds.world.showing(episode, number, agent, f"{worlds.name}, world {index}")

        tables = WorldTables(
            f"{worlds.name}, world {index}", worlds.scenario, worlds.weather, number, worlds.world.static, load,
            worlds.world.makers,
        )  # fmt: skip
        tables.share(self, index)
        return LiveFrame(tables, worlds.scenario, worlds.weather, number)

    def can_make(self, makers: Collection[Maker]) -> bool:
        """Return whether makers of rows work for all worlds at once."""
        return self._worlds.together.issuperset(makers)

    def rows_of(self, index: int, makers: Collection[Maker], agent: str | None) -> Rows:
        """Return the rows with one world that some makers make, of one agent's sensors or of all."""
        asked = tuple(makers), agent
        if asked not in self._found:
            found: dict[str, list[RowPart]] = defaultdict(list)
            for made in self._rows(makers, agent):
                for name, parts in made.items():
                    found[name] += parts
            worlds = [part.worlds or () for parts in found.values() for part in parts]
            self._found[asked] = dict(found), all(len(some) == len(self._moments) for some in worlds)
        every, are_whole = self._found[asked]
        if are_whole:
            return every
        return {name: [part for part in parts if index in (part.worlds or ())] for name, parts in every.items()}

    def table(self, name: str) -> pa.Table:
        """Return the rows of a table of all worlds; column `frame` counts the worlds.

        Raises:
            InputError: If there is no such table, or it is made world by world.
        """
        if name not in self._tables:
            makers = self._worlds.world.makers.get(name, [])
            if not makers:
                raise InputError(f"{self._worlds.name}: has no table {name!r} of frames")
            for maker in makers:
                if not self.can_make([maker]):
                    raise InputError(
                        f"{self._worlds.name}: table {name!r} has sensor {maker[1]!r}, which is made world by world; "
                        "read it from the frames"
                    )
            parts = [part.source for made in self._rows(makers, None) for part in made.get(name, [])]
            start_all(parts)
            worlds = self._worlds
            whole = join_batches(name, worlds.scenario, worlds.weather, parts) if parts else _empty(name)
            self._tables[name] = whole
        return self._tables[name]

    def paths(self, carrier_hz: float) -> CarrierPaths:
        """Return the paths of the links of all worlds at a carrier [Hz]; `frame` of their keys counts the worlds.

        Raises:
            InputError: If there are no paths at this carrier.
        """
        found = self._carrier(carrier_hz)
        if found is not None:
            return found
        has_channel = "path_gains" in self._worlds.world.makers
        names = ("links", "path_gains", "path_geometry")
        links, gains, geometry = (self.table(name) if has_channel else _empty(name) for name in names)
        return CarrierPaths.from_table(join_paths(gains, geometry), carrier_hz, links)

    def paths_of(self, index: int, carrier_hz: float) -> CarrierPaths | None:
        """Return the paths of one world at a carrier [Hz] without making tables; None if there are none."""
        if carrier_hz not in self._parted:
            whole = self._carrier(carrier_hz)
            numbers = [number for _, number in self._moments]
            carriers = len(self._channel[0][1][1].carriers_hz) if whole is not None else 0
            self._parted[carrier_hz] = None if whole is None else PathsByFrame(whole, numbers, carriers)
        parted = self._parted[carrier_hz]
        found = None if parted is None else parted.of(index)
        return found if found is not None and len(found) else None

    def _carrier(self, carrier_hz: float) -> CarrierPaths | None:
        """Return the paths of all worlds at a carrier [Hz]; None if there are none or memory has parted the worlds."""
        if carrier_hz not in self._carriers:
            own, found = self._solved, None
            if own is not None:
                paths, in_order = own
                carrier = np.flatnonzero(paths.carriers_hz == carrier_hz)
                found = in_order.at(int(carrier[0])) if len(carrier) else None
            self._carriers[carrier_hz] = found
        return self._carriers[carrier_hz]

    @cached_property
    def _solved(self) -> tuple[PathSet, FramePaths] | None:
        """The paths of all worlds, as solved and in the order of tables; None if there are none in one launch."""
        worlds = self._worlds
        solved = self._channel if "path_gains" in worlds.world.makers else []
        if len(solved) != 1 or not len(solved[0][1][1]):
            return None
        names = actor_names(worlds.world.batch.arrays.actors), antenna_names(worlds.world.config)
        links, paths = solved[0][1]
        return paths, FramePaths(links, paths, worlds.weather, *names, worlds.scenario)

    @cached_property
    def _channel(self) -> list[tuple[range, tuple[Links, PathSet]]]:
        """The worlds of every launch, their links, and the paths of these."""
        surfaces = self._worlds.world.batch.surfaces
        if surfaces is None:
            return []

        def solve(batch: Batch, some: range) -> tuple[Links, PathSet]:
            links = channel_links(batch, some)
            return links, trace_channel(batch, surfaces, links, [self._worlds.weather])

        return self._launches(solve, None)

    def _rows(self, makers: Collection[Maker], agent: str | None) -> list[Rows]:
        """Return what some makers make, traced once: sensors together, since cameras share their rays."""
        sensors = frozenset(maker for maker in makers if maker[0] == "sensor")
        others = [frozenset([maker]) for maker in dict.fromkeys(makers) if maker[0] != "sensor"]
        return [self._once(some, agent) for some in (*others, *([sensors] if sensors else []))]

    def _once(self, makers: frozenset[Maker], agent: str | None) -> Rows:
        for (others, whose), made in tuple(self._made.items()):
            # Rows of other sensors and agents do no harm where those of one are looked for.
            if whose in (None, agent) and (makers == others or (agent is not None and makers < others)):
                return made
        self._made[makers, agent] = self._trace(makers, agent)
        return self._made[makers, agent]

    def _trace(self, makers: Collection[Maker], agent: str | None) -> Rows:
        """Return the rows of all worlds; their `frame` counts the worlds."""
        weather = self._worlds.weather

        def capture(batch: Batch, some: range) -> TableRows:
            found: TableRows = {weather: defaultdict(list)}
            capture_makers(batch, makers, some, found)
            return found

        if ("channel",) in makers:
            launches = [(some, self._channel_rows(*solved)) for some, solved in self._channel]
        else:
            launches = self._launches(capture, agent)
        world, fixed = self._worlds.world, {"scenario": self._worlds.scenario, "weather": weather}
        rows: dict[str, list[RowPart]] = defaultdict(list)
        for some, found in launches:
            for name, parts in parts_of(found[weather], world.makers, fixed, some, world.batch.pool).items():
                rows[name] += parts
        return rows

    def _channel_rows(self, links: Links, paths: PathSet) -> TableRows:
        found: TableRows = {self._worlds.weather: defaultdict(list)}
        channel_rows(self._whole, links, paths, found)
        return found

    def _launches(self, make: Callable[[Batch, range], T], agent: str | None) -> list[tuple[range, T]]:
        """Return what `make` makes of all worlds, in one launch if the memory is enough, and the worlds of each."""
        world, count = self._worlds.world, len(self._moments)
        made: list[tuple[range, T]] = []

        def report(full: int, step: int) -> None:
            self._worlds.report(f"memory is full with {full} worlds a launch; going on with {step}")

        with world.lock:
            world.check_open(self._worlds.name)
            batch = self._batch(agent)

            def launch(some: range) -> T:
                self._load(batch, some)
                return make(batch, some)

            launch_in_parts(range(count), count, launch, lambda *part: made.append(part), report)
        return made

    @cached_property
    def _arrays(self) -> WorldBatch:
        data = self._worlds.world.batch.arrays
        poses, before = poses_around(self._moments, NEIGHBORS), NEIGHBORS
        is_there = np.isfinite(poses[..., 0]).reshape(len(self._moments), 2 * NEIGHBORS + 1, -1)
        if (is_there != is_there[:, NEIGHBORS, None]).any():  # motion begins or ends there, and looks farther
            poses, before = np.concatenate([episode.poses_apart(number) for episode, number in self._moments]), BEFORE
        numbers, seeds = zip(*((number, episode.seed) for episode, number in self._moments), strict=True)
        return WorldBatch.of(data, poses, numbers, seeds, before)

    @cached_property
    def _whole(self) -> Batch:
        arrays = self._arrays
        return replace(self._worlds.world.batch, arrays=arrays, motion=arrays.motion())

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
                scene.replace_arrays(self._arrays, batch.motion)
            scene.load_batch(some)
            world.shown = self, some.start, some.stop


class WorldTables(FrameTables):
    """Tables of the frame of one of several worlds; a `TableReader`."""

    _frames: WorldFrames

    def share(self, frames: WorldFrames, world: int) -> None:
        """Take rows of `frames`, where this is the frame of a world."""
        self._frames, self._world = frames, world

    def paths(self, carrier_hz: float) -> CarrierPaths | None:
        """Return the paths at a carrier without making tables; None if there are none."""
        return self._frames.paths_of(self._world, carrier_hz)

    def _capture(self, makers: Collection[Maker], agent: str | None) -> Rows:
        if self._frames.can_make(makers):
            return self._frames.rows_of(self._world, makers, agent)
        alone = [maker for maker in makers if not self._frames.can_make([maker])]
        found = dict(self._frames.rows_of(self._world, [maker for maker in makers if maker not in alone], agent))
        for name, parts in super()._capture(alone, agent).items():
            found[name] = [*found.get(name, ()), *parts]
        return found


def _empty(name: str) -> pa.Table:
    return arrow_schema(name).empty_table()
