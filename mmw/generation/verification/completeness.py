"""Check that a dataset has all shards of its configuration, and a row for each expected key."""

import hashlib
import json
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa

from mmw.config import Config
from mmw.config.input_paths import input_places
from mmw.core.errors import InputError
from mmw.generation.provenance import stored_config
from mmw.generation.shards import shard_keys
from mmw.generation.verification.actor_counts import COUNTED, Counts, check_counts, expected_counts
from mmw.generation.verification.row_counts import COLUMNS, TEXTS, count_rows
from mmw.generation.verification.stage_files import CURE, check_stages
from mmw.storage.finding import Finding, one_line
from mmw.storage.identity import config_differences
from mmw.storage.manifest import CARD, CONFIG, DATASET, MANIFEST, named_markers, read_dataset
from mmw.storage.row_checks import SHARD, Chunk, Names
from mmw.storage.shard_writer import MARKERS, ShardKey, marker_path, table_path
from mmw.storage.store import Store

STATIC = {"sensors": ("agent", "sensor"), "objects": ("object_id",), "materials": ("weather", "material_id")}
"""Static table -> columns of which the shards of a scenario need values."""


def read_plan(store: Store) -> tuple[Config | None, list[Finding]]:
    """Return the configuration of a dataset, or why it is not that of its data.

    A configuration that cannot be read, as one with a sensor of a package that is not installed, is a finding.

    Raises:
        InputError: If the folder is not a dataset.
    """
    head = read_dataset(store)
    try:
        config = stored_config(store)
    except InputError as error:
        return None, [Finding("config", CONFIG, f"{one_line(error)}; no rows were counted")]
    findings = _check_config(config, head)
    return (None if findings else config), findings  # counts of another configuration have no meaning


class PlannedRows:
    """Compare the rows of shards with those that a configuration plans, while the files are read."""

    columns = COLUMNS
    """Table -> columns that it needs beside those of the key."""

    def __init__(self, store: Store, config: Config) -> None:
        """Read from the markers of static tables which actors are there in which frame."""
        self._config = config
        self._counts: dict[str, Counts] = {}
        self._agents: dict[str, set[tuple[str, str]]] = defaultdict(set)
        self._objects: dict[str, set[int]] = defaultdict(set)
        self._static: dict[str, dict[str, dict[str, list]]] = {}
        self.findings: list[Finding] = []
        for scenario in config.scenarios:
            name = marker_path(scenario.name).as_posix()
            marker = named_markers(store, [name], skip_unreadable=True).get(name, {})
            try:
                self._counts[scenario.name] = expected_counts(config, scenario, marker.get("actors"))
            except ValueError as error:
                self.findings.append(Finding("marker", name, f"its actors are not those of the scenario ({error})"))
            if marker.get("software") and "actors" not in marker:
                self.findings.append(Finding("marker", name, f"does not say which actors are there; {CURE}"))

    def __call__(self, chunk: Chunk, tables: Mapping[str, pa.Table]) -> Iterator[Finding]:
        """Yield tables whose keys differ from those of the frames, agents, sensors and links of their shard."""
        if chunk.scenario not in {scenario.name for scenario in self._config.scenarios}:
            return  # a finding already: the configuration has no such shard
        frames = []
        for index, key in enumerate(chunk.keys):
            is_counted = isinstance(key, ShardKey) and index not in chunk.wrong
            frames.append(range(key.frame_begin, key.frame_end) if is_counted else range(0))
            if isinstance(key, str) and index not in chunk.wrong:
                self._static[chunk.scenario] = {
                    table: {name: _values(tables, table, name, chunk.names) for name in columns}
                    for table, columns in STATIC.items() if table in tables
                }  # fmt: skip
        yield from self._check_actors(chunk, tables)
        for table, shard, text in count_rows(self._config, frames, tables, chunk.names):
            yield Finding("count", chunk.path(table, shard), text)
        if "poses" in tables:
            agents = {"poses": tables["poses"].group_by(["agent", "role"], use_threads=False).aggregate([])}
            columns = [_values(agents, "poses", name, chunk.names) for name in ("agent", "role")]
            self._agents[chunk.scenario] |= set(zip(*columns, strict=True))
        for table in tables.keys() & {"poses", "boxes"}:
            self._objects[chunk.scenario] |= set(tables[table]["object_id"].unique().to_pylist())

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

    def check_static(self) -> Iterator[Finding]:
        """Yield the static tables of scenarios that lack a row that a shard needs; all shards must have been read."""
        config = self._config
        for scenario, tables in self._static.items():
            agents = self._agents[scenario]
            mounted = {(agent, sensor.name) for agent, role in agents for sensor in config.sensors if role in sensor.on}
            antennas = {(agent, "antenna") for agent, _ in agents if config.channel.enabled}
            needed = {
                ("sensors", "agent", "sensor"): mounted | antennas,
                ("objects", "object_id"): {(number,) for number in self._objects[scenario]},
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


def _values(tables: Mapping[str, pa.Table], table: str, column: str, names: Names) -> list:
    """Return the values of a column, with the names for which numbers stand."""
    values = tables[table][column].to_pylist()
    return [names.texts[value] for value in values] if column in TEXTS else values


def check_plan(store: Store, config: Config) -> list[Finding]:
    """Return what a dataset lacks of its configuration: shards, static tables, stages, manifest and card.

    Files of shards that the configuration does not have are findings as well.
    """
    names = [scenario.name for scenario in config.scenarios]
    keys = [key for scenario in config.scenarios for key in shard_keys(config, scenario)]
    planned = {marker_path(key).as_posix(): key for key in [*names, *keys]}
    markers = {name for name in store.names(MARKERS) if name.endswith(".json")}
    missing = {name: key for name, key in planned.items() if name not in markers}
    findings = []
    for name, key in missing.items():
        what = f"static tables of {key} are" if isinstance(key, str) else f"shard {key} is"
        findings.append(Finding("missing", name, f"{what} not finished; run the same configuration again"))
    if all(isinstance(key, str) for key in missing.values()):
        findings += check_stages(store, config, read_dataset(store).get("inputs"))
        for name in (MANIFEST, CARD):
            if not store.sizes([name]):
                findings.append(Finding("missing", name, "the dataset is complete without it; run mmw finalize"))
    for name in sorted(markers - planned.keys()):
        findings.append(Finding("foreign", name, "the configuration has no such shard"))
    return findings


def _check_config(config: Config, head: dict[str, Any]) -> list[Finding]:
    text = json.dumps(head["config"], sort_keys=True, separators=(",", ":"))
    if hashlib.sha256(text.encode()).hexdigest() != head["config_sha256"]:
        return [Finding("config", DATASET, "its configuration does not have its config_sha256; the file was changed")]
    stored, current = json.loads(text), config.identity()
    before = {place.keys: place.value for place in input_places(stored, Config)}
    for place in list(input_places(current, Config)):  # absolute in `config.yaml`, as written in `dataset.json`
        if place.keys in before and Path(before[place.keys]).name == Path(place.value).name:
            place.replace(before[place.keys])
    differences = config_differences(stored, current)
    if differences:
        return [Finding("config", CONFIG, f"is not what made the data: {'; '.join(differences[:3])}")]
    recorded = {name for files in head.get("inputs", {}).values() for name in files}
    lacking = sorted(
        place.value
        for place in input_places(stored, Config)
        if place.is_declared and not any(name.partition("/")[0] == Path(place.value).name for name in recorded)
    )
    if "inputs" in head and lacking:
        return [Finding("inputs", DATASET, f"has no hash of {lacking[0]}, which the configuration names")]
    return []
