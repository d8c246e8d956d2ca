"""Check that a dataset has all shards of its configuration, and a row for each expected key."""

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from mmw.config import Config
from mmw.config.sensor_spec import spec_of
from mmw.generation.provenance import stored_config
from mmw.generation.shards import shard_keys
from mmw.generation.verification.stage_files import check_stages
from mmw.storage.file_checks import Finding, one_line
from mmw.storage.manifest import (
    CARD,
    CONFIG,
    DATASET,
    MANIFEST,
    config_differences,
    pending_scenarios,
    pending_shards,
    read_dataset,
)
from mmw.storage.shard_writer import ShardKey, marker_path, table_path
from mmw.storage.store import Root, Store, store_of

PATH_KEYS = ("town", "stage")
"""Keys of a scenario with a path: absolute in `config.yaml`, as it was written in `dataset.json`."""


def check_plan(root: Root) -> list[Finding]:
    """Compare a dataset with its configuration.

    Returns:
        Where `config.yaml` and `dataset.json` differ or do not have the hash that is stored, shards and scenarios
        that were not finished, files of shards that the configuration does not have, and tables of a shard whose keys
        differ from those of its frames, agents, sensors and links.

    Raises:
        InputError: If the folder is not a dataset or its configuration cannot be read.
    """
    root = store_of(root)
    head = read_dataset(root)
    if not root.sizes([CONFIG]):
        return [Finding("config", CONFIG, "is missing; counts cannot be compared; run the same configuration again")]
    config = stored_config(root)
    findings = _check_config(config, head)
    if findings:
        return findings  # counts of another configuration have no meaning
    names = [scenario.name for scenario in config.scenarios]
    for name in pending_scenarios(root, names, skip_unreadable=True):
        findings.append(Finding("missing", marker_path(name).as_posix(), f"static tables of {name} are not finished"))
    keys = [key for scenario in config.scenarios for key in shard_keys(config, scenario)]
    pending = set(pending_shards(root, keys, skip_unreadable=True))
    for key in keys:
        name = marker_path(key).as_posix()
        if key not in pending:
            findings += _check_shard(root, config, key)
        elif not root.sizes([name]):  # else a file of the shard is wrong, which the check of files says
            findings.append(Finding("missing", name, f"shard {key} is not finished; run the same configuration again"))
    for name in config.scenarios:
        findings += _check_static(root, config, name.name, [key for key in keys if key.scenario == name.name])
    if not pending:
        findings += check_stages(root, config)
    for name in (MANIFEST, CARD):
        if not pending and not root.sizes([name]):
            findings.append(Finding("missing", name, "the dataset is complete without it; run mmw finalize"))
    planned = {marker_path(key).name for key in [*keys, *names]}
    for name in root.names(marker_path("x").parent.as_posix()):
        if name.endswith(".json") and PurePosixPath(name).name not in planned:
            findings.append(Finding("foreign", name, "the configuration has no such shard"))
    return findings


def _check_config(config: Config, head: dict[str, Any]) -> list[Finding]:
    text = json.dumps(head["config"], sort_keys=True, separators=(",", ":"))
    if hashlib.sha256(text.encode()).hexdigest() != head["config_sha256"]:
        return [Finding("config", DATASET, "its configuration does not have its config_sha256; the file was changed")]
    stored, current = json.loads(text), config.identity()
    if len(stored["scenarios"]) == len(current["scenarios"]):
        for one, other in zip(stored["scenarios"], current["scenarios"], strict=True):
            _align_paths(one, other)
    differences = config_differences(stored, current)
    if differences:
        return [Finding("config", CONFIG, f"is not what made the data: {'; '.join(differences[:3])}")]
    return []


def _align_paths(stored: dict[str, Any], current: dict[str, Any]) -> None:
    """Give a scenario the paths of the other where both name the same file."""
    pairs = [(stored, current, key) for key in PATH_KEYS]
    if stored.get("traffic") and current.get("traffic"):
        pairs.append((stored["traffic"], current["traffic"], "trajectories"))
    for one, other, key in pairs:
        if one.get(key) and other.get(key) and Path(one[key]).name == Path(other[key]).name:
            other[key] = one[key]


def _check_shard(root: Store, config: Config, key: ShardKey) -> Iterator[Finding]:
    """Yield the tables of a shard whose keys are not the expected ones."""

    def keys(table: str, columns: tuple[str, ...]) -> list[tuple]:
        return _keys(root, table_path(table, key).as_posix(), columns)

    def objects(table: str) -> list[tuple]:
        return _objects(root, table_path(table, key).as_posix())

    try:
        expected = dict(_expected(config, range(key.frame_begin, key.frame_end), keys, objects))
    except _UnreadableError as error:
        yield Finding("count", error.path, f"{error}; no rows of this shard were counted")
        return
    for table, wanted in expected.items():
        try:
            found = Counter(keys(table, KEY_OF.get(table, SAMPLE_KEY)))
        except _UnreadableError as error:
            yield Finding("count", error.path, f"{error}; its rows were not counted")
            continue
        path = table_path(table, key).as_posix()
        if missing := wanted - found:
            yield Finding("count", path, f"{missing.total()} rows are missing, the first {_name(table, missing)}")
        if extra := found - wanted:
            yield Finding("count", path, f"{extra.total()} rows too many, the first {_name(table, extra)}")


def _check_static(root: Store, config: Config, scenario: str, shards: Sequence[ShardKey]) -> Iterator[Finding]:
    """Yield the static tables of a scenario that lack a row that its shards need."""

    def values(table: str, column: str) -> set[Any]:
        found: set[Any] = set()
        for key in shards:
            found |= {row[0] for row in _keys(root, table_path(table, key).as_posix(), (column,))}
        return found

    try:
        agents: set[tuple[str, str]] = set()
        for key in shards:
            agents |= set(_keys(root, table_path("poses", key).as_posix(), ("agent", "role")))
        wanted: dict[str, tuple[tuple[str, ...], set[tuple]]] = {
            "sensors": (
                ("agent", "sensor"),
                {(agent, sensor.name) for agent, role in agents for sensor in config.sensors if role in sensor.on}
                | {(agent, "antenna") for agent, _ in agents if config.channel.enabled},
            ),
            "objects": (
                ("object_id",),
                {(value,) for table in ("poses", "boxes") for value in values(table, "object_id")},
            ),
            "materials": (("weather",), {(weather,) for weather in config.weathers}),
        }
        for table, (columns, needed) in wanted.items():
            path = table_path(table, scenario).as_posix()
            found = _keys(root, path, columns)
            if missing := sorted(needed - set(found)):
                first = ", ".join(f"{column} {value}" for column, value in zip(columns, missing[0], strict=True))
                yield Finding("count", path, f"{len(missing)} rows are missing, the first {first}")
        for table, column in (("objects", "object_id"), ("materials", "material_id")):
            path = table_path(table, scenario).as_posix()
            found = {row[0] for row in _keys(root, path, (column,))}
            if found != set(range(len(found))):
                yield Finding("count", path, f"{column} does not count from 0 to {max(found)}; rows are missing")
    except _UnreadableError as error:
        yield Finding("count", error.path, f"{error}; the static tables of {scenario} were not counted")


class _UnreadableError(Exception):
    """Report a table that is damaged or lacks a column."""

    def __init__(self, path: str, reason: str) -> None:
        super().__init__(reason)
        self.path = path


KEY_OF = {
    "frames": ("frame",),
    "poses": ("frame", "role"),
    "boxes": ("frame",),
    "links": ("frame", "agent", "peer", "carrier_hz"),
    "paths": ("frame", "agent", "peer", "carrier_hz"),
    "box_visibility": ("frame", "agent", "sensor", "object_id"),
}
"""Table -> columns by which its rows are counted; those of sensors have `SAMPLE_KEY`."""

SAMPLE_KEY = ("frame", "agent", "sensor")
"""Columns that name one sample of a sensor."""


def _name(table: str, counts: Counter) -> str:
    first = min(counts, key=str)
    return ", ".join(f"{column} {value}" for column, value in zip(KEY_OF.get(table, SAMPLE_KEY), first, strict=True))


def _keys(root: Store, path: str, columns: tuple[str, ...]) -> list[tuple]:
    """Return some columns of every row of a file; none if it does not exist."""
    rows = _read(root, path, columns)
    return [] if rows is None else list(zip(*(rows.column(column).to_pylist() for column in columns), strict=True))


def _objects(root: Store, path: str) -> list[tuple]:
    """Return (frame, agent, sensor, object_id) once for each object that a row of a file has points on."""
    rows = _read(root, path, (*SAMPLE_KEY, "object_id"))
    if rows is None:
        return []
    rows = rows.combine_chunks()
    lists = rows.column("object_id").combine_chunks()
    points = pa.table({"row": pc.list_parent_indices(lists), "object_id": pc.list_flatten(lists)})
    pairs = points.group_by(["row", "object_id"]).aggregate([])
    samples = rows.select(SAMPLE_KEY).take(pairs.column("row"))
    return list(zip(*(column.to_pylist() for column in (*samples.columns, pairs.column("object_id"))), strict=True))


def _read(root: Store, path: str, columns: tuple[str, ...]) -> pa.Table | None:
    """Return some columns of a file; None if it does not exist."""
    if not root.sizes([path]):
        return None
    try:
        rows = root.read_columns(path, columns)
    except (pa.ArrowException, OSError) as error:
        raise _UnreadableError(path, f"cannot be read: {one_line(error)}") from error
    if missing := [column for column in columns if column not in rows.column_names]:
        raise _UnreadableError(path, f"lacks the column {', '.join(missing)}")
    return rows


def _expected(
    config: Config,
    frames: range,
    keys: Callable[[str, tuple[str, ...]], list[tuple]],
    objects: Callable[[str], list[tuple]],
) -> Iterator[tuple[str, Counter]]:
    """Yield tables and how many rows of each key they must have, from frames, poses and links."""
    yield "frames", Counter((frame,) for frame in frames)
    counts = keys("frames", ("frame", "cav_count", "rsu_count", "vehicle_count", "pedestrian_count"))
    yield "poses", Counter({(row[0], role): row[i] for row in counts for i, role in ((1, "cav"), (2, "rsu")) if row[i]})
    yield "boxes", Counter({(row[0],): row[3] + row[4] for row in counts if row[3] + row[4]})
    poses = keys("poses", ("frame", "agent", "role"))
    samples: dict[str, Counter] = {}
    for sensor in config.sensors:
        due = [(frame, agent, sensor.name) for frame, agent, role in poses if role in sensor.on]
        due = [row for row in due if row[0] % sensor.period_frames == 0]
        for table, each in spec_of(sensor).tables_of(sensor).items():
            samples.setdefault(table, Counter()).update(dict.fromkeys(due, each))
    yield from samples.items()
    boxes = keys("boxes", ("frame", "object_id"))
    counted = _visible(keys, objects, config, set(boxes))
    if config.channel.enabled:
        own = {(frame, agent): object_id for frame, agent, object_id in keys("poses", ("frame", "agent", "object_id"))}
        by_frame: dict[int, list[int]] = {}
        for frame, object_id in boxes:
            by_frame.setdefault(frame, []).append(object_id)
        counted.update(
            (frame, agent, "antenna", object_id)
            for (frame, agent), mine in own.items()
            for object_id in by_frame.get(frame, ())
            if object_id != mine
        )
    yield "box_visibility", counted
    if config.channel.enabled:
        yield (
            "links",
            Counter(
                (frame, agent, peer, carrier)
                for frame, agent, role in poses
                if role == "cav"
                for other, peer, kind in poses
                if other == frame and peer != agent and ("v2i" if kind == "rsu" else "v2v") in config.channel.links
                for carrier in config.channel.carriers_hz
            ),
        )
        links = keys("links", (*KEY_OF["links"], "path_count"))
        yield "paths", Counter({row[:4]: row[4] for row in links if row[4]})


def _visible(
    keys: Callable[[str, tuple[str, ...]], list[tuple]],
    objects: Callable[[str], list[tuple]],
    config: Config,
    boxes: set[tuple[int, int]],
) -> Counter:
    """Return the keys of `box_visibility` of sensors: actors on which one has a return, a point or a pixel."""
    tables = {table for sensor in config.sensors for table in spec_of(sensor).tables_of(sensor)}
    rows = [row for table in sorted(tables & {"lidar", "radar"}) for row in objects(table)]
    found = Counter(row for row in rows if (row[0], row[3]) in boxes)
    found.update(row[:4] for row in keys("boxes_2d", (*SAMPLE_KEY, "object_id", "pixels")) if row[4])
    return found
