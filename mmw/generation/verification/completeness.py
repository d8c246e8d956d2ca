"""Does a dataset hold what its configuration asks for: every shard, and in it a row for every key?"""

import hashlib
import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import pyarrow as pa

from mmw.config import Config
from mmw.config.sensor_spec import spec_of
from mmw.generation.provenance import stored_config
from mmw.generation.shards import shard_keys
from mmw.storage.file_checks import Finding, one_line
from mmw.storage.manifest import CONFIG, DATASET, config_differences, pending_scenarios, pending_shards, read_dataset
from mmw.storage.shard_writer import ShardKey, marker_path, table_path
from mmw.storage.store import Root, Store, store_of

PATH_KEYS = ("town", "stage")
"""Keys of a scenario that hold a path: `config.yaml` has it absolute, `dataset.json` as it was written."""


def check_plan(root: Root) -> list[Finding]:
    """Compare a dataset with its configuration.

    Args:
        root: Dataset.

    Returns:
        Where `config.yaml` and `dataset.json` differ or do not have the hash that is stored, shards and scenarios
        that were not finished, files of shards that the configuration does not have, and tables of a shard whose keys
        are not those that frames, agents, sensors and links ask for.

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
        return findings  # counts of another configuration would say nothing
    names = [scenario.name for scenario in config.scenarios]
    for name in pending_scenarios(root, names):
        findings.append(Finding("missing", marker_path(name).as_posix(), f"static tables of {name} are not finished"))
    keys = [key for scenario in config.scenarios for key in shard_keys(config, scenario)]
    pending = set(pending_shards(root, keys))
    for key in keys:
        if key in pending:
            text = f"shard {key} is not finished; run the same configuration again"
            findings.append(Finding("missing", marker_path(key).as_posix(), text))
        else:
            findings += _check_shard(root, config, key)
    planned = {marker_path(key).name for key in [*keys, *names]}
    for name in root.names(marker_path("x").parent.as_posix()):
        if name.endswith(".json") and PurePosixPath(name).name not in planned:
            findings.append(Finding("foreign", name, "the configuration has no such shard"))
    return findings


def _check_config(config: Config, head: dict[str, Any]) -> list[Finding]:
    text = json.dumps(head["config"], sort_keys=True, separators=(",", ":"))
    if hashlib.sha256(text.encode()).hexdigest() != head["config_sha256"]:
        return [Finding("config", DATASET, "its configuration does not have its config_sha256; the file was changed")]
    stored, kept = json.loads(text), config.identity()
    if len(stored["scenarios"]) == len(kept["scenarios"]):
        for one, other in zip(stored["scenarios"], kept["scenarios"], strict=True):
            _align_paths(one, other)
    differences = config_differences(stored, kept)
    if differences:
        return [Finding("config", CONFIG, f"is not what made the data: {'; '.join(differences[:3])}")]
    return []


def _align_paths(stored: dict[str, Any], kept: dict[str, Any]) -> None:
    """Give a scenario the paths of the other where both name the same file."""
    pairs = [(stored, kept, key) for key in PATH_KEYS]
    if stored.get("traffic") and kept.get("traffic"):
        pairs.append((stored["traffic"], kept["traffic"], "trajectories"))
    for one, other, key in pairs:
        if one.get(key) and other.get(key) and Path(one[key]).name == Path(other[key]).name:
            other[key] = one[key]


def _check_shard(root: Store, config: Config, key: ShardKey) -> Iterator[Finding]:
    """Yield the tables of a shard whose keys are not the expected ones."""
    shard = _Shard(root, key)
    try:
        expected = dict(_expected(config, shard))
    except _UnreadableError as error:
        yield Finding("count", error.path, f"{error}; no rows of this shard were counted")
        return
    for table, wanted in expected.items():
        try:
            found = Counter(shard.keys(table, KEY_OF.get(table, SAMPLE_KEY)))
        except _UnreadableError as error:
            yield Finding("count", error.path, f"{error}; its rows were not counted")
            continue
        path = table_path(table, key).as_posix()
        if lost := wanted - found:
            yield Finding("count", path, f"{sum(lost.values())} rows are missing, the first {_name(table, lost)}")
        if more := found - wanted:
            yield Finding("count", path, f"{sum(more.values())} rows too many, the first {_name(table, more)}")


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
}
"""Table -> columns by which its rows are counted; those of sensors have `SAMPLE_KEY`."""

SAMPLE_KEY = ("frame", "agent", "sensor")
"""Columns that name one sample of a sensor."""


def _name(table: str, counts: Counter) -> str:
    first = min(counts, key=str)
    return ", ".join(f"{column} {value}" for column, value in zip(KEY_OF.get(table, SAMPLE_KEY), first, strict=True))


class _Shard:
    """The tables of a shard, as far as they are there."""

    def __init__(self, root: Store, key: ShardKey) -> None:
        self.root, self.key = root, key
        self.frames = range(key.frame_begin, key.frame_end)

    def keys(self, table: str, columns: tuple[str, ...]) -> list[tuple]:
        """Return some columns of every row; none if there is no file.

        Raises:
            _UnreadableError: If the file is damaged or lacks one of the columns.
        """
        name = table_path(table, self.key).as_posix()
        if not self.root.sizes([name]):
            return []
        try:
            rows = self.root.rows(name, columns)
        except (pa.ArrowException, OSError) as error:
            raise _UnreadableError(name, f"cannot be read: {one_line(error)}") from error
        if missing := [column for column in columns if column not in rows.column_names]:
            raise _UnreadableError(name, f"lacks the column {', '.join(missing)}")
        return list(zip(*(rows.column(column).to_pylist() for column in columns), strict=True))


def _expected(config: Config, shard: _Shard) -> Iterator[tuple[str, Counter]]:
    """Yield tables and how many rows of each key they must have, from frames, poses and links."""
    yield "frames", Counter((frame,) for frame in shard.frames)
    counts = shard.keys("frames", ("frame", "cav_count", "rsu_count", "vehicle_count", "pedestrian_count"))
    yield "poses", Counter({(row[0], role): row[i] for row in counts for i, role in ((1, "cav"), (2, "rsu")) if row[i]})
    yield "boxes", Counter({(row[0],): row[3] + row[4] for row in counts if row[3] + row[4]})
    poses = shard.keys("poses", ("frame", "agent", "role"))
    samples: dict[str, Counter] = {}
    for sensor in config.sensors:
        due = [(frame, agent, sensor.name) for frame, agent, role in poses if role in sensor.on]
        due = [row for row in due if row[0] % sensor.period_frames == 0]
        for table, each in spec_of(sensor).tables_of(sensor).items():
            samples.setdefault(table, Counter()).update(dict.fromkeys(due, each))
    yield from samples.items()
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
        links = shard.keys("links", (*KEY_OF["links"], "path_count"))
        yield "paths", Counter({row[:4]: row[4] for row in links if row[4]})
