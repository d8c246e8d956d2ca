"""Compute how many rows of each key the tables of shards must have, and compare them with those that are there."""

import functools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from mmw.config import Config
from mmw.config.sensor_spec import spec_of
from mmw.scene.actor_counts import BODY_COLUMNS, COUNTED, ROLE_COLUMNS
from mmw.storage.row_checks import SHARD, Names

Tables = Mapping[str, pa.Table]
"""Rows of some shards by table, with the index of the shard in the column `SHARD`."""

Kinds = Mapping[str, tuple[str, str]]
"""Name of an actor -> its model and its class."""

COUNT = "count"

SAMPLE_KEY = ("frame", "agent", "sensor")
"""Columns that name one sample of a sensor."""

KEY_OF = {
    "frames": ("frame",),
    "poses": ("frame", "role"),
    "boxes": ("frame",),
    "links": ("frame", "agent", "peer", "carrier_hz"),
    "paths": ("frame", "agent", "peer", "carrier_hz"),
    "box_visibility": ("frame", "agent", "sensor", "object_id"),
}
"""Table -> columns by which its rows are counted; those of sensors have `SAMPLE_KEY`."""

COLUMNS = {
    "frames": COUNTED,
    "poses": ("role", "object_id"),
    "lidar": ("object_id",),
    "radar": ("object_id",),
    "boxes_2d": ("pixels",),
    "links": ("path_count",),
}
"""Table -> columns beside those of its key from which rows of other tables follow."""

TYPES = {
    SHARD: pa.int32(), "frame": pa.int32(), "agent": pa.int32(), "peer": pa.int32(), "sensor": pa.int32(),
    "role": pa.int32(), "object_id": pa.int32(), "carrier_hz": pa.float64(), "pixels": pa.int64(),
    "path_count": pa.int64(), **dict.fromkeys(COUNTED, pa.int64()), COUNT: pa.int64(),
}  # fmt: skip
"""Column -> type in which it is compared; names are numbers, see `Names`."""

TEXTS = ("agent", "peer", "sensor", "role", "weather")
"""Columns of names."""


def count_rows(
    config: Config, frames: Sequence[range], tables: Tables, names: Names, rate_hz: int, kinds: Kinds
) -> Iterator[tuple[str, int, str]]:
    """Compare the number of rows of each key with what frames, poses, links and the configuration say.

    Args:
        config: Configuration of the dataset.
        frames: Frames of each shard; none for a shard that is not to be compared.
        tables: Their rows.
        names: Names whose numbers they hold.
        rate_hz: Frames a second.
        kinds: Model and class of actors; an actor that is left out has a name and a role only.

    Yields:
        Table, index of a shard, and what is wrong with it.
    """
    for table, expected in _expected(config, frames, tables, names, rate_hz, kinds):
        key = KEY_OF.get(table, SAMPLE_KEY)
        for shard, text in _differences(expected, _select(tables, table, (SHARD, *key)), names):
            yield table, shard, text


def _select(tables: Tables, table: str, columns: Sequence[str]) -> pa.Table:
    """Return columns of a table in the types of `TYPES`; no rows if no shard has it."""
    schema = pa.schema([(name, TYPES[name]) for name in columns])
    return tables[table].select(list(columns)).cast(schema) if table in tables else schema.empty_table()


def _differences(expected: pa.Table, found: pa.Table, names: Names) -> Iterator[tuple[int, str]]:
    """Yield shards whose rows are not the expected ones: how many are missing or too many, and the first of them."""
    key = [name for name in expected.column_names if name != COUNT]
    lacking = pa.array(np.full(found.num_rows, -1))
    both = pa.concat_tables([expected, found.append_column(COUNT, lacking).select(expected.column_names)])
    sums = both.group_by(key, use_threads=False).aggregate([(COUNT, "sum")])
    rows: dict[tuple[int, bool], list[tuple[str, int]]] = {}
    for row in sums.filter(pc.not_equal(sums[f"{COUNT}_sum"], 0)).to_pylist():
        shard, missing = row.pop(SHARD), row.pop(f"{COUNT}_sum")
        texts = {column: names.texts[value] if column in TEXTS else value for column, value in row.items()}
        name = ", ".join(f"{column} {value}" for column, value in texts.items())
        rows.setdefault((shard, missing < 0), []).append((name, abs(missing)))
    for (shard, is_more), places in sorted(rows.items()):
        what = "rows too many" if is_more else "rows are missing"
        yield shard, f"{sum(count for _, count in places)} {what}, the first {min(places)[0]}"


def _expected(
    config: Config, frames: Sequence[range], tables: Tables, names: Names, rate_hz: int, kinds: Kinds
) -> Iterator[tuple[str, pa.Table]]:
    """Yield tables, and how many rows of each key they must have."""
    shards = np.repeat(np.arange(len(frames)), [len(each) for each in frames])
    numbers = np.concatenate([np.asarray(each) for each in frames]) if frames else []
    yield "frames", _counted({SHARD: shards, "frame": numbers}, 1)
    counts = _select(tables, "frames", (SHARD, "frame", *COLUMNS["frames"]))
    place = {SHARD: counts[SHARD], "frame": counts["frame"]}
    roles = {role: {**place, "role": np.full(len(counts), names.number(role))} for role in ROLE_COLUMNS}
    yield "poses", pa.concat_tables(_counted(roles[role], counts[column]) for role, column in ROLE_COLUMNS.items())
    yield "boxes", _counted(place, functools.reduce(pc.add, (counts[column] for column in BODY_COLUMNS)))
    poses = _select(tables, "poses", (SHARD, "frame", "agent", "role", "object_id"))
    yield from _samples(config, poses, names, rate_hz, kinds)
    boxes = _select(tables, "boxes", (SHARD, "frame", "object_id"))
    traced = poses.filter(pa.array(config.channel.is_due(poses["frame"].to_numpy(), rate_hz)))
    yield "box_visibility", _visibility(config, tables, traced, boxes, names)
    if config.channel.enabled:
        yield "links", _links(config, traced, names)
        links = _select(tables, "links", (SHARD, *KEY_OF["links"], "path_count"))
        yield "paths", _counted({name: links[name] for name in (SHARD, *KEY_OF["paths"])}, links["path_count"])


def _counted(columns: Mapping[str, Any], count: Any) -> pa.Table:
    """Return keys with the number of their rows, one for all or one for each; keys with no row are left out."""
    size = len(next(iter(columns.values())))
    counts = np.full(size, count) if isinstance(count, int) else count
    schema = pa.schema([(name, TYPES[name]) for name in (*columns, COUNT)])
    table = pa.table({**columns, COUNT: counts}).cast(schema)
    return table.filter(pc.greater(table[COUNT], 0))


def _with(table: pa.Table, name: str, value: Any) -> pa.Table:
    """Return a table with a column of one value."""
    return table.append_column(name, pa.array(np.full(table.num_rows, value)).cast(TYPES[name]))


def _samples(
    config: Config, poses: pa.Table, names: Names, rate_hz: int, kinds: Kinds
) -> Iterator[tuple[str, pa.Table]]:
    """Yield the tables of sensors with a number of rows for each sample, and that number."""
    found: dict[str, list[pa.Table]] = {}
    frame = poses["frame"].to_numpy()
    agents = poses.group_by(["role", "agent"], use_threads=False).aggregate([]).to_pylist()
    numbers = {row["agent"]: (names.texts[row["role"]], names.texts[row["agent"]]) for row in agents}
    for sensor in config.sensors:
        carriers = [number for number, agent in numbers.items() if sensor.is_on(*agent, *kinds.get(agent[1], ()))]
        is_on = pc.is_in(poses["agent"], pa.array(carriers, TYPES["agent"]))
        is_due = pc.and_(is_on, pa.array(sensor.is_due(frame, rate_hz)))
        due = poses.select([SHARD, "frame", "agent"]).filter(is_due)
        for table, each in spec_of(sensor).tables_of(sensor).items():
            found.setdefault(table, []).append(_with(_with(due, "sensor", names.number(sensor.name)), COUNT, each))
    for table, parts in found.items():
        yield table, pa.concat_tables(parts)


def _visibility(config: Config, tables: Tables, traced: pa.Table, boxes: pa.Table, names: Names) -> pa.Table:
    """Return the rows of `box_visibility`: boxes on which a sensor has a return, a point or a pixel; all for antennas
    in the frames of the channel, whose poses are `traced`.

    Objects without a box, such as buildings, have no row.
    """
    key = [SHARD, *KEY_OF["box_visibility"]]
    used = {table for sensor in config.sensors for table in spec_of(sensor).tables_of(sensor)}
    parts = []
    for table in sorted(used & {"lidar", "radar"} & set(tables)):
        rows = tables[table].select([SHARD, *SAMPLE_KEY, "object_id"]).combine_chunks()
        lists = rows["object_id"].combine_chunks()
        row, object_id = (part.to_numpy() for part in (pc.list_parent_indices(lists), pc.list_flatten(lists)))
        pairs = pc.unique(pa.array(row.astype(np.int64) << 32 | object_id.astype(np.uint32))).to_numpy()
        found = rows.drop_columns("object_id").take(pa.array(pairs >> 32))
        parts.append(found.append_column("object_id", pa.array(pairs.astype(np.int32))))
    seen = _select({"all": pa.concat_tables(parts)} if parts else {}, "all", key)
    seen = seen.join(boxes, keys=[SHARD, "frame", "object_id"], join_type="left semi", use_threads=False)
    pixels = _select(tables, "boxes_2d", (*key, "pixels"))
    parts = [seen, pixels.filter(pc.greater(pixels["pixels"], 0)).select(key)]
    if config.channel.enabled:
        own = traced.select([SHARD, "frame", "agent", "object_id"]).rename_columns([SHARD, "frame", "agent", "own"])
        pairs = own.join(boxes, keys=[SHARD, "frame"], join_type="inner", use_threads=False)
        pairs = pairs.filter(pc.not_equal(pairs["object_id"], pairs["own"]))
        parts.append(_with(pairs, "sensor", names.number("antenna")))
    return _with(pa.concat_tables([part.select(key) for part in parts]), COUNT, 1)


def _links(config: Config, traced: pa.Table, names: Names) -> pa.Table:
    """Return the rows of `links`: from each peer to each CAV, for each carrier."""
    agents = traced.select([SHARD, "frame", "agent", "role"])
    peers = agents.rename_columns([SHARD, "frame", "peer", "kind"])
    cavs = agents.filter(pc.equal(agents["role"], names.number("cav")))
    pairs = cavs.join(peers, keys=[SHARD, "frame"], join_type="inner", use_threads=False)
    pairs = pairs.filter(pc.not_equal(pairs["agent"], pairs["peer"]))
    kinds = pc.if_else(pc.equal(pairs["kind"], names.number("rsu")), "v2i", "v2v")
    pairs = pairs.filter(pc.is_in(kinds, pa.array(config.channel.links, pa.string())))
    columns = [SHARD, *KEY_OF["links"], COUNT]
    carriers = config.channel.carriers_hz
    return pa.concat_tables(_with(_with(pairs, "carrier_hz", each), COUNT, 1).select(columns) for each in carriers)
