"""Compare the rows of a dataset with those that its configuration plans."""

import hashlib
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pyarrow as pa

from mmw.channel.tables import LINKS
from mmw.config import Config
from mmw.generation.verification.actor_counts import Counts, actor_kinds, check_counts, expected_counts
from mmw.generation.verification.row_counts import COLUMNS, TEXTS, Kinds, count_rows
from mmw.scene.actor_counts import COUNTED
from mmw.scene.stage_digests import STAGES, parse_digests
from mmw.storage.finding import Finding
from mmw.storage.manifest import named_markers
from mmw.storage.row_checks import SHARD, Chunk, Names
from mmw.storage.shard_writer import ShardKey, marker_path, table_path
from mmw.storage.store import Store

STATIC = {"sensors": ("agent", "sensor"), "objects": ("object_id",), "materials": ("weather", "material_id")}
"""Static table -> columns of which the shards of a scenario need values."""


@dataclass
class Seen:
    """Needs that the rows of shards have of the static tables of their scenario, and of each other; by scenario."""

    agents: dict[str, set[tuple[str, str]]] = field(default_factory=lambda: defaultdict(set))
    """Names and roles of agents."""
    objects: dict[str, set[int]] = field(default_factory=lambda: defaultdict(set))
    path_counts: dict[tuple[str, int], dict[tuple[str, int], str]] = field(default_factory=lambda: defaultdict(dict))
    """Scenario and first frame of shards -> weather and carrier -> hash of the numbers of paths of all links."""
    static: dict[str, dict[str, dict[str, list]]] = field(default_factory=dict)
    """Values of the columns `STATIC` of each static table."""

    def add(self, other: "Seen") -> None:
        """Add what was seen in other shards."""
        for own, found in ((self.agents, other.agents), (self.objects, other.objects)):
            for scenario, values in found.items():
                own[scenario] = own.get(scenario, set()) | values
        for shards, hashes in other.path_counts.items():
            self.path_counts[shards] |= hashes
        self.static |= other.static


class PlannedRows:
    """Compare the rows of shards with those that a configuration plans, while the files are read."""

    columns = COLUMNS
    """Table -> columns that it needs beside those of the key."""

    def __init__(self, store: Store, config: Config) -> None:
        """Read from the markers of static tables which actors are there in which frame."""
        self._config = config
        self._counts: dict[str, Counts] = {}
        self._kinds: dict[str, Kinds] = {}
        self.seen = Seen()
        self.findings: list[Finding] = []
        for scenario in config.scenarios:
            name = marker_path(scenario.name).as_posix()
            marker = named_markers(store, [name], skip_unreadable=True).get(name, {})
            note = f"{STAGES}/{scenario.name}.json"
            digests = parse_digests(store.read_all([note], skip_unreadable=True).get(note)) or {}
            try:
                self._counts[scenario.name] = expected_counts(
                    config, scenario, marker.get("actors"), digests.get("absent")
                )
                self._kinds[scenario.name] = actor_kinds(marker.get("actors"))
            except ValueError as error:
                self.findings.append(Finding("marker", name, f"its actors are not those of the scenario ({error})"))
            if marker.get("software") and "actors" not in marker:
                self.findings.append(
                    Finding("marker", name, "does not say which actors are there; run the same configuration again")
                )

    def __call__(self, chunk: Chunk, tables: Mapping[str, pa.Table]) -> Iterator[Finding]:
        """Yield tables whose keys differ from those of the frames, agents, sensors and links of their shard."""
        if chunk.scenario not in {scenario.name for scenario in self._config.scenarios}:
            return  # a finding already: the configuration has no such shard
        frames, with_geometry = [], []
        for index, key in enumerate(chunk.keys):
            is_counted = isinstance(key, ShardKey) and index not in chunk.wrong
            frames.append(range(key.frame_begin, key.frame_end) if is_counted else range(0))
            with_geometry.append(isinstance(key, ShardKey) and key.weather == self._config.weathers[0])
            if isinstance(key, str) and index not in chunk.wrong:
                self.seen.static[chunk.scenario] = {
                    table: {name: _values(tables, table, name, chunk.names) for name in columns}
                    for table, columns in STATIC.items() if table in tables
                }  # fmt: skip
        yield from self._check_actors(chunk, tables)
        rate_hz = self._config.frame_rate_of(self._config.scenario(chunk.scenario))
        kinds = self._kinds.get(chunk.scenario, {})
        for table, shard, text in count_rows(self._config, frames, with_geometry, tables, chunk.names, rate_hz, kinds):
            yield Finding("count", chunk.path(table, shard), text)
        if "poses" in tables:
            agents = {"poses": tables["poses"].group_by(["agent", "role"], use_threads=False).aggregate([])}
            columns = [_values(agents, "poses", name, chunk.names) for name in ("agent", "role")]
            self.seen.agents[chunk.scenario] |= set(zip(*columns, strict=True))
        if "links" in tables:
            for shard, carrier, digest in _hash_path_counts(tables["links"], chunk.names):
                if (key := chunk.shard_key(shard)) is not None:
                    self.seen.path_counts[chunk.scenario, key.frame_begin][key.weather, carrier] = digest
        for table in tables.keys() & {"poses", "boxes"}:
            self.seen.objects[chunk.scenario] |= set(tables[table]["object_id"].unique().to_pylist())

    def _check_actors(self, chunk: Chunk, tables: Mapping[str, pa.Table]) -> Iterator[Finding]:
        """Yield shards whose frames have other numbers of actors than the stage."""
        expected = self._counts.get(chunk.scenario)
        if not expected or "frames" not in tables:
            return
        start = self._config.frames_of(self._config.scenario(chunk.scenario)).start
        rows: dict[int, list[tuple]] = defaultdict(list)
        for shard, *row in zip(
            *(tables["frames"][name].to_pylist() for name in (SHARD, "frame", *COUNTED)), strict=True
        ):
            rows[shard].append(tuple(row))
        for shard, each in rows.items():
            yield from check_counts(expected, start, each, chunk.path("frames", shard))

    def check_path_counts(self) -> Iterator[Finding]:
        """Yield shards whose links have other numbers of paths than those of the first weather and carrier.

        The geometry of paths is stored once for all of them; all shards must have been read.
        """
        first = self._config.weathers[0]
        for (scenario, frame), hashes in self.seen.path_counts.items():
            right = hashes.get((first, 0), next(iter(hashes.values())))
            for weather in sorted({weather for (weather, _), found in hashes.items() if found != right}):
                path = table_path("links", ShardKey(scenario, weather, frame, frame)).as_posix()
                text = f"links have other numbers of paths than those of {first} at the first carrier"
                yield Finding("count", path, f"{text}; all have the paths of path_geometry")

    def check_static(self) -> Iterator[Finding]:
        """Yield the static tables of scenarios that lack a row that a shard needs; all shards must have been read."""
        config = self._config
        for scenario, tables in self.seen.static.items():
            agents, kinds = self.seen.agents[scenario], self._kinds.get(scenario, {})
            own = config.channel.antennas if config.channel.enabled else ()
            carried = {
                (agent, one.name)
                for agent, role in agents
                for one in (*config.sensors, *own)
                if one.is_on(role, agent, *kinds.get(agent, ()))
            }
            needed = {
                ("sensors", "agent", "sensor"): carried,
                ("objects", "object_id"): {(number,) for number in self.seen.objects[scenario]},
                ("materials", "weather"): {(weather,) for weather in config.weathers},
            }
            for (table, *columns), wanted in needed.items():
                lists = [tables[table][name] for name in columns] if table in tables else []
                if missing := sorted(wanted - set(zip(*lists, strict=True))):
                    first = ", ".join(f"{column} {value}" for column, value in zip(columns, missing[0], strict=True))
                    text = f"{len(missing)} rows are missing, the first {first}"
                    yield Finding("count", table_path(table, scenario).as_posix(), text)
            for table, column in (("objects", "object_id"), ("materials", "material_id")):
                found = set(tables[table][column]) if table in tables else set()
                if found != set(range(len(found))):
                    text = f"{column} does not count from 0 to {max(found)}; rows are missing"
                    yield Finding("count", table_path(table, scenario).as_posix(), text)


def _hash_path_counts(links: pa.Table, names: Names) -> Iterator[tuple[int, int, str]]:
    """Yield index of a shard, number of a carrier, and a hash of the number of paths of every link."""
    texts = pa.array(names.texts, pa.string())
    columns = {name: links[name] for name in (SHARD, *LINKS.key, "path_count")}
    columns |= {name: texts.take(column) for name, column in columns.items() if name in TEXTS}
    rows = pa.table(columns).sort_by([(name, "ascending") for name in (SHARD, "carrier", *LINKS.key[:-1])])
    shard, carrier = (rows[name].to_numpy() for name in (SHARD, "carrier"))
    begins = np.flatnonzero((np.diff(shard, prepend=-1) != 0) | (np.diff(carrier, prepend=-1) != 0)).tolist()
    rows = rows.drop_columns([SHARD, "carrier"])
    for begin, end in pairwise([*begins, len(shard)]):
        text = repr(rows.slice(begin, end - begin).to_pydict())
        yield int(shard[begin]), int(carrier[begin]), hashlib.sha256(text.encode()).hexdigest()


def _values(tables: Mapping[str, pa.Table], table: str, column: str, names: Names) -> list:
    """Return the values of a column, with the names for which numbers stand."""
    values = tables[table][column].to_pylist()
    return [names.texts[value] for value in values] if column in TEXTS else values
