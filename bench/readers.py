"""Measure readers that find one LiDAR sweep or a scenario's beam inputs: `python -m bench.readers --source DATASET`.

The shards of a dataset, the quickstart's for example, are repeated with other frame numbers and weathers until there
are `--shards` of 100 frames; the result stays in `--out` and is used again. Each reader then gets the sweep of random
(weather, frame, agent), all with the same keys in order, after a warm-up; pages are in the system's cache. On a
shared machine the minimum is the cost of the work, the median the usual time; `cpu` counts all threads of the process.
"""

import argparse
import json
import os
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.dataset as pds

import mmw
from bench.rays import cpu_name
from mmw.dataset import Dataset
from mmw.storage.manifest import finalize, prepare_root
from mmw.storage.parquet_schema import arrow_schema
from mmw.storage.schemas import table_spec
from mmw.storage.shard_writer import ShardKey, write_scenario, write_shard

WEATHERS = ("sunny", "rainy", "foggy")
FRAMES = 100
"""Frames of a shard."""
TABLES = ("frames", "poses", "lidar", "links", "path_gains", "path_geometry")
SCENARIO = "repeated"

Key = tuple[str, int, str]
"""Weather, frame, agent."""


@dataclass(frozen=True)
class Result:
    """One measured line."""

    reader: str
    what: str
    rows: int
    """Rows that one query returns."""
    minimum_ms: float
    median_ms: float
    cpu_ms: float
    """Least processor time of a query, all threads together."""
    queries: int


def repeat(source: Dataset, out: Path, shards: int) -> None:
    """Write a dataset of about `shards` shards in three weathers from the frames of another; nothing if it is there.

    Args:
        source: One with the tables `TABLES`; its first scenario and weather are used.
        out: New folder.
        shards: Shards of `FRAMES` frames; rounded up to a multiple of three.
    """
    each = -(-shards // len(WEATHERS))
    identity = {"repeated": source.info["config_sha256"], "shards": each * len(WEATHERS)}
    sha256 = f"{source.info['config_sha256'][:56]}{each:08x}"
    prepare_root(out, identity, sha256, source.info["versions"], overwrite=False)
    first = source.read("frames", columns=["scenario", "weather"]).slice(0, 1).to_pylist()[0]
    write_scenario(out, SCENARIO, {"sensors": _renamed("sensors", source.read("sensors", scenario=first["scenario"]))},
                   {"config_sha256": sha256})  # fmt: skip
    scenario = {"scenario": first["scenario"]}
    where = {name: first if table_spec(name).by_weather else scenario for name in TABLES}
    tables = {name: _hundred(source.read(name, **where[name])) for name in TABLES}
    for weather in WEATHERS:
        for begin in range(0, each * FRAMES, FRAMES):
            ready = {
                name: _renamed(name, table, weather, begin)
                for name, table in tables.items()
                if weather == WEATHERS[0] or table_spec(name).by_weather
            }
            key = ShardKey(SCENARIO, weather, begin, begin + FRAMES)
            write_shard(out, key, ready, {"config_sha256": sha256})
            print(f"\r{out}: {weather}, frame {begin}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    finalize(out)


def _hundred(table: pa.Table) -> pa.Table:
    """Return a table's frames again and again until there are `FRAMES`, numbered from 0."""
    frame = table["frame"].to_numpy()
    there = np.unique(frame)
    rows = [np.flatnonzero(frame == there[number % len(there)]) for number in range(FRAMES)]
    numbers = np.repeat(np.arange(FRAMES), [len(some) for some in rows])
    index = table.schema.get_field_index("frame")
    return table.take(np.concatenate(rows)).set_column(index, "frame", pa.array(numbers, pa.int32()))


def _renamed(name: str, table: pa.Table, weather: str = "", begin: int = 0) -> pa.Table:
    """Return a table with the bench's scenario, and with another weather and later frames if it has them."""
    values = {"scenario": SCENARIO, **({"weather": weather} if table_spec(name).of_weather else {})}
    schema, columns = arrow_schema(name), []
    for field in schema:
        column = table[field.name].combine_chunks()
        if field.name in values:
            column = pa.array([values[field.name]] * table.num_rows)
        if field.name == "frame":
            column = pa.array(column.to_numpy() + begin)
        if pa.types.is_dictionary(field.type):
            column = column.cast(pa.string()).dictionary_encode()
        columns.append(column.cast(field.type))
    return pa.Table.from_arrays(columns, schema=schema)


def readers(root: Path) -> Iterator[tuple[str, Callable[[Key], int]]]:
    """Yield the name of each reader of one sweep, and a function that returns the rows of a key."""
    import duckdb
    import pandas as pd
    import polars as pl

    folder = root / "lidar"

    def filters(key: Key) -> list[tuple[str, str, Any]]:
        return list(zip(("scenario", "weather", "frame", "agent"), ("==",) * 4, (SCENARIO, *key), strict=True))

    def where(key: Key) -> str:
        return f"scenario = '{SCENARIO}' AND weather = '{key[0]}' AND frame = {key[1]} AND agent = '{key[2]}'"

    data, connection = mmw.open(root), mmw.connect(root)
    yield (
        "mmw.open(...).pandas",
        lambda key: len(
            data.pandas(
                "lidar", columns=["x", "y", "z", "intensity"],
                scenario=SCENARIO, weather=key[0], frames=range(key[1], key[1] + 1), agent=key[2],
            )
        ),
    )  # fmt: skip
    yield (
        "mmw.connect(...).sql",
        lambda key: len(connection.sql(f"SELECT x, y, z, intensity FROM lidar WHERE {where(key)}").df()),
    )
    yield (
        "mmw.connect(...), lidar_at",
        lambda key: len(
            connection.sql(
                f"SELECT x, y, z, intensity FROM lidar_at('{SCENARIO}', '{key[0]}', {key[1]}) WHERE agent = '{key[2]}'"
            ).df()
        ),
    )
    plain = duckdb.connect()
    glob = f"read_parquet('{folder}/**/*.parquet', hive_partitioning = true)"
    yield (
        "DuckDB on the folder",
        lambda key: len(plain.sql(f"SELECT x, y, z, intensity FROM {glob} WHERE {where(key)}").df()),
    )
    yield "pandas, folder, filters", lambda key: len(pd.read_parquet(folder, filters=filters(key)))
    yield (
        "pandas, folder of the weather",
        lambda key: len(
            pd.read_parquet(folder / f"scenario={SCENARIO}" / f"weather={key[0]}", filters=filters(key)[2:])
        ),
    )
    yield (
        "pandas, file of the shard",
        lambda key: len(
            pd.read_parquet(
                folder / f"scenario={SCENARIO}" / f"weather={key[0]}" / f"part-{key[1] // FRAMES * FRAMES:06d}.parquet",
                columns=["x", "y", "z", "intensity"],
                filters=filters(key)[2:],
            )
        ),
    )
    yield (
        "polars.scan_parquet",
        lambda key: len(
            pl.scan_parquet(folder)
            .filter(scenario=SCENARIO, weather=key[0], frame=key[1], agent=key[2])
            .select("x", "y", "z", "intensity")
            .collect()
        ),
    )
    arrow = pds.dataset(folder, partitioning=pds.HivePartitioning.discover(infer_dictionary=True))

    def of_arrow(key: Key) -> int:
        parts = zip(("scenario", "weather", "frame", "agent"), (SCENARIO, *key), strict=True)
        wanted = [pds.field(name) == value for name, value in parts]
        return arrow.to_table(filter=wanted[0] & wanted[1] & wanted[2] & wanted[3]).num_rows

    yield "pyarrow.dataset, opened once", of_arrow


def whole_scenario(root: Path) -> Iterator[tuple[str, Callable[[], int]]]:
    """Yield readers of the inputs of the beam search of the whole scenario in one weather."""
    connection = mmw.connect(root)
    select = f"SELECT * FROM beam_inputs WHERE scenario = '{SCENARIO}' AND weather = 'rainy' AND carrier_hz = 28e9"
    yield "mmw.connect(...).sql(...).arrow", lambda: connection.sql(select).to_arrow_table().num_rows
    yield "mmw.connect(...).sql(...).df", lambda: len(connection.sql(select).df())
    data = mmw.open(root)
    yield "mmw.open(...).paths", lambda: data.paths(28e9, scenario=SCENARIO, weather="rainy").link_count


def measure(name: str, what: str, work: Callable[..., int], calls: list[tuple[Any, ...]]) -> Result:
    """Return the times of a query, once with each set of arguments; the first set is run twice, to warm up."""
    rows, wall, busy = work(*calls[0]), [], []
    for arguments in calls:
        start, cpu = time.perf_counter(), time.process_time()
        found = work(*arguments)
        wall.append(1e3 * (time.perf_counter() - start))
        busy.append(1e3 * (time.process_time() - cpu))
        if found != rows or not rows:
            raise ValueError(f"{name}: {found} rows for {arguments}, {rows} for others; as many are needed")
    return Result(name, what, rows, min(wall), statistics.median(wall), min(busy), len(wall))


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(prog="python -m bench.readers", description="Measure readers of a dataset.")
    parser.add_argument("--source", type=Path, required=True, help="dataset with LiDAR and channel to repeat")
    parser.add_argument("--out", type=Path, default=Path("out/readers"), help="where the long dataset is, or goes")
    parser.add_argument("--shards", type=int, default=100, help="shards of 100 frames, in three weathers together")
    parser.add_argument("--repeats", type=int, default=30, help="sweeps a reader")
    parser.add_argument("--format", choices=("human", "json"), default="human", help="json: one line a result")
    return parser.parse_args(arguments)


def main(arguments: list[str]) -> None:
    """Make the dataset if it is not there, measure and print."""
    options = parse(arguments)
    if not (options.out / "_manifest.parquet").is_file():
        repeat(mmw.open(options.source), options.out, options.shards)
    data = mmw.open(options.out)
    frames = data.arrow("frames").count_rows() // len(WEATHERS)
    agents = data.read("sensors", columns=["agent", "type"]).filter(pds.field("type") == "lidar")["agent"].to_pylist()
    rng = np.random.default_rng(7)
    keys = [
        ((str(rng.choice(WEATHERS)), int(rng.integers(frames)), str(rng.choice(agents))),)
        for _ in range(options.repeats)
    ]
    if options.format == "human":
        print(f"{cpu_name()}, {os.cpu_count()} cores, mmw {mmw.__version__}, pyarrow {pa.__version__}")
        print(f"{options.out}: {frames} frames x {len(WEATHERS)} weathers, {len(agents)} LiDARs")
        print("reader                            what               rows   min ms  median ms   cpu ms")
    for name, sweep in readers(options.out):
        show(measure(name, "one sweep", sweep, keys), options.format)
    for name, inputs in whole_scenario(options.out):
        show(measure(name, "inputs of beams", inputs, [()] * 5), options.format)


def show(result: Result, form: str) -> None:
    """Print one result."""
    if form == "json":
        print(json.dumps(asdict(result)), flush=True)
    else:
        times = f"{result.minimum_ms:8.1f} {result.median_ms:10.1f} {result.cpu_ms:8.1f}"
        print(f"{result.reader:33} {result.what:16} {result.rows:6} {times}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
