"""Compute how many rows of each key the tables of shards must have, and compare them with those that are there."""

import functools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from mmw.channel.tables import LINKS, PATH_GAINS, PATH_GEOMETRY
from mmw.config import Config
from mmw.config.agent_keys import AgentIdentity
from mmw.config.sensor import Mounted
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
    "links": LINKS.key,
    "path_geometry": PATH_GEOMETRY.key,
    "path_gains": PATH_GAINS.key,
    "box_visibility": ("frame", "agent", "sensor", "object_id"),
}
"""Table -> columns by which its rows are counted; those of sensors have `SAMPLE_KEY`."""

COLUMNS = {
    "frames": COUNTED,
    "poses": ("role", "object_id"),
    "lidar": ("object_id",),
    "radar": ("object_id", "path_type"),
    "boxes_2d": ("pixels",),
    "links": ("path_count",),
}
"""Table -> columns beside those of its key from which rows of other tables follow."""

TYPES = {
    SHARD: pa.int32(), "frame": pa.int32(), "agent": pa.int32(), "peer": pa.int32(), "sensor": pa.int32(),
    "antenna": pa.int32(), "peer_antenna": pa.int32(), "role": pa.int32(), "object_id": pa.int32(),
    "carrier": pa.int32(), "path": pa.int32(), "pixels": pa.int64(), "path_count": pa.int64(),
    **dict.fromkeys(COUNTED, pa.int64()), COUNT: pa.int64(),
}  # fmt: skip
"""Column -> type in which it is compared; names are numbers, see `Names`."""

TEXTS = ("agent", "peer", "antenna", "peer_antenna", "sensor", "role", "weather")
"""Columns of names."""


def count_rows(
    config: Config, frames: Sequence[range], with_geometry: Sequence[bool], tables: Tables, names: Names, rate_hz: int,
    kinds: Kinds,
) -> Iterator[tuple[str, int, str]]:  # fmt: skip
    """Compare the number of rows of each key with what frames, poses, links and the configuration say.

    Args:
        config: Configuration of the dataset.
        frames: Frames of each shard; none for a shard that is not to be compared.
        with_geometry: Whether each shard has the tables that are the same in every weather.
        tables: Their rows.
        names: Names whose numbers they hold.
        rate_hz: Frames a second.
        kinds: Model and class of actors; an actor that is left out has a name and a role only.

    Yields:
        Table, index of a shard, and what is wrong with it.
    """
    for table, expected in _expected(config, frames, with_geometry, tables, names, rate_hz, kinds):
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
    config: Config, frames: Sequence[range], with_geometry: Sequence[bool], tables: Tables, names: Names, rate_hz: int,
    kinds: Kinds,
) -> Iterator[tuple[str, pa.Table]]:  # fmt: skip
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
    yield from _samples(config, tables, poses, names, rate_hz, kinds)
    boxes = _select(tables, "boxes", (SHARD, "frame", "object_id"))
    traced = poses.filter(pa.array(config.channel.is_due(poses["frame"].to_numpy(), rate_hz)))
    yield "box_visibility", _visibility(config, tables, traced, boxes, names, kinds)
    if config.channel.enabled:
        yield "links", _links(config, traced, names, kinds)
        links = _select(tables, "links", (SHARD, *KEY_OF["links"], "path_count"))
        yield "path_gains", _paths(links, "path_gains")
        is_first = pc.equal(links["carrier"], 0)
        has = pc.is_in(links[SHARD], pa.array(np.flatnonzero(with_geometry), TYPES[SHARD]))
        yield "path_geometry", _paths(links.filter(pc.and_(is_first, has)), "path_geometry")


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
    config: Config, tables: Tables, poses: pa.Table, names: Names, rate_hz: int, kinds: Kinds
) -> Iterator[tuple[str, pa.Table]]:
    """Yield the tables of sensors with a number of rows for each sample, and that number.

    Where a sample may have any number of rows, it is that of the rows which are there.
    """
    found: dict[str, list[pa.Table]] = {}
    frame = poses["frame"].to_numpy()
    agents = _agents(poses, names, kinds)
    for sensor in config.sensors:
        is_due = pc.and_(_is_on(sensor, poses, agents, names), pa.array(sensor.is_due(frame, rate_hz)))
        due = poses.select([SHARD, "frame", "agent"]).filter(is_due)
        for table, each in spec_of(sensor).tables_of(sensor).items():
            found.setdefault(table, []).append(_with(_with(due, "sensor", names.number(sensor.name)), COUNT, each))
        for table in spec_of(sensor).variable_rows(sensor):
            samples, key = _with(due, "sensor", names.number(sensor.name)), [SHARD, *SAMPLE_KEY]
            own = _select(tables, table, key).join(samples, keys=key, join_type="left semi", use_threads=False)
            found.setdefault(table, []).append(_with(own, COUNT, 1))
    for table, parts in found.items():
        yield table, pa.concat_tables(parts)


def _visibility(
    config: Config, tables: Tables, traced: pa.Table, boxes: pa.Table, names: Names, kinds: Kinds
) -> pa.Table:
    """Return the rows of `box_visibility`: boxes on which a sensor has a return, a point or a pixel; all for antennas
    in the frames of the channel, whose poses are `traced`.

    Objects without a box, such as buildings, have no row.
    """
    key = [SHARD, *KEY_OF["box_visibility"]]
    used = {table for sensor in config.sensors for table in spec_of(sensor).tables_of(sensor)}
    parts = []
    for table in sorted(used & {"lidar", "radar"} & set(tables)):
        rows = tables[table].combine_chunks()
        row, object_id = _points_on_objects(rows)
        pairs = pc.unique(pa.array(row.astype(np.int64) << 32 | object_id.astype(np.uint32))).to_numpy()
        found = rows.select([SHARD, *SAMPLE_KEY]).take(pa.array(pairs >> 32))
        parts.append(found.append_column("object_id", pa.array(pairs.astype(np.int32))))
    seen = _select({"all": pa.concat_tables(parts)} if parts else {}, "all", key)
    seen = seen.join(boxes, keys=[SHARD, "frame", "object_id"], join_type="left semi", use_threads=False)
    pixels = _select(tables, "boxes_2d", (*key, "pixels"))
    parts = [seen, pixels.filter(pc.greater(pixels["pixels"], 0)).select(key)]
    if config.channel.enabled:
        own = traced.select([SHARD, "frame", "agent", "object_id"]).rename_columns([SHARD, "frame", "agent", "own"])
        pairs = own.join(boxes, keys=[SHARD, "frame"], join_type="inner", use_threads=False)
        pairs = pairs.filter(pc.not_equal(pairs["object_id"], pairs["own"]))
        agents = _agents(traced, names, kinds)
        for antenna in config.channel.antennas:
            on = pairs.filter(_is_on(antenna, pairs, agents, names))
            parts.append(_with(on, "sensor", names.number(antenna.name)))
    return _with(pa.concat_tables([part.select(key) for part in parts]), COUNT, 1)


def _points_on_objects(rows: pa.Table) -> tuple[np.ndarray, np.ndarray]:
    """Return row and object of each point of a sensor; echoes of multipath lie on no object."""
    lists = rows["object_id"].combine_chunks()
    row, object_id = (part.to_numpy() for part in (pc.list_parent_indices(lists), pc.list_flatten(lists)))
    if "path_type" not in rows.column_names:
        return row, object_id
    paths, is_on = rows["path_type"].combine_chunks(), np.ones(len(row), dtype=bool)
    has_paths = paths.is_valid().to_numpy(zero_copy_only=False)
    is_on[has_paths[row]] = pc.list_flatten(paths).to_numpy() == 0
    return row[is_on], object_id[is_on]


def _paths(links: pa.Table, table: str) -> pa.Table:
    """Return the rows of a table of paths: those of each link are numbered from 0."""
    count = np.maximum(links["path_count"].to_numpy(), 0)
    rows = links.take(pa.array(np.repeat(np.arange(len(count)), count)))
    path = np.arange(len(rows)) - np.repeat(np.cumsum(count) - count, count)
    rows = rows.append_column("path", pa.array(path).cast(TYPES["path"]))
    return _with(rows.select([SHARD, *KEY_OF[table]]), COUNT, 1)


def _links(config: Config, traced: pa.Table, names: Names, kinds: Kinds) -> pa.Table:
    """Return the rows of `links`: those that the configuration's rules make of the agents that are there."""
    here = traced.select([SHARD, "frame", "agent"])
    agents = _agents(traced, names, kinds)
    ends = config.channel.link_ends(agents)
    antennas = config.channel.antenna_names
    columns = {
        "agent": [agents[end.rx][1] for end in ends],
        "peer": [agents[end.tx][1] for end in ends],
        "antenna": [antennas[end.rx_antenna] for end in ends],
        "peer_antenna": [antennas[end.tx_antenna] for end in ends],
    }
    pairs = pa.table({name: pa.array(names.numbers(texts), TYPES[name]) for name, texts in columns.items()})
    pairs = here.join(pairs, keys="agent", join_type="inner", use_threads=False)
    peers = here.rename_columns([SHARD, "frame", "peer"])
    pairs = pairs.join(peers, keys=[SHARD, "frame", "peer"], join_type="left semi", use_threads=False)
    columns = [SHARD, *KEY_OF["links"], COUNT]
    carriers = range(len(config.channel.carriers_hz))
    return pa.concat_tables(_with(_with(pairs, "carrier", each), COUNT, 1).select(columns) for each in carriers)


def _is_on(one: Mounted, rows: pa.Table, agents: Sequence[AgentIdentity], names: Names) -> pa.ChunkedArray:
    """Return whether the agent of each row carries a sensor or an antenna."""
    carriers = [agent[1] for agent in agents if one.is_on(*agent)]
    return pc.is_in(rows["agent"], pa.array(names.numbers(carriers), TYPES["agent"]))


def _agents(poses: pa.Table, names: Names, kinds: Kinds) -> list[AgentIdentity]:
    """Return role and name of each agent of some poses, and model and class where they are known."""
    rows = poses.group_by(["role", "agent"], use_threads=False).aggregate([])
    roles, agents = ([names.texts[number] for number in rows[name].to_pylist()] for name in ("role", "agent"))
    pairs = [(role, name) for role, name in zip(roles, agents, strict=True) if role is not None and name is not None]
    return [AgentIdentity(role, name, *kinds.get(name, ())) for role, name in pairs]
