"""Hostile datasets: a small real one with files damaged, rewritten, renamed and replaced."""

import json
import os
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq

import mmw
from mmw.cli.run import main as run_main
from mmw.core.errors import Error
from mmw.dataset.export.registry import EXPORTERS
from mmw.storage.schemas import TABLES
from tests.fixtures.edit_files import agree
from tests.fixtures.own_world import write_own_world
from tests.fuzz.cases import Step, call, command
from tests.fuzz.mutations import mutate_bytes, mutate_text, mutate_tree

SENSORS = (
    "sensors=[{type: lidar, channels: 4, points_per_channel: 32}, {type: imu}, {type: gnss}, "
    "{type: rgb, name: front, width_px: 24, height_px: 16, rate_hz: 50, segmentation: true}, "
    "{type: depth, width_px: 24, height_px: 16}, {type: radar, azimuth_rays: 8, elevation_rays: 4, on: [rsu]}]"
)
SMALL = ("frames.count=4", "output.shard_frames=2", "weathers=[sunny, rainy]", SENSORS)


class Datasets:
    """Copies of one dataset; every reader, exporter and command looks at each."""

    def prepare(self, folder: Path) -> None:
        write_own_world(folder)
        self.root = folder / "d"
        code = run_main(["--config", str(folder / "mine.yaml"), *SMALL, "--out", str(self.root), "--device", "cpu",
                         "--workers", "1"])  # fmt: skip
        assert code == 0
        self.parquet = [path.relative_to(self.root) for path in sorted(self.root.rglob("*.parquet"))]
        self.json = [path.relative_to(self.root) for path in sorted(self.root.rglob("*.json"))]
        self.files = [path.relative_to(self.root) for path in sorted(self.root.rglob("*")) if path.is_file()]

    def make(self, rng: random.Random, folder: Path) -> list[Step]:
        root = folder / "d"
        shutil.copytree(self.root, root)
        for _ in range(rng.choice((1, 1, 1, 2, 3))):
            kind = rng.random()
            if kind < 0.4:
                self._rewrite(rng, root)
            elif kind < 0.65:
                self._json(rng, root)
            elif kind < 0.85:
                self._bytes(rng, root)
            else:
                self._names(rng, root)
        name = rng.choice(list(EXPORTERS))
        options = {"kitti": ["images=none"], "opv2v": ["images=none", "vehicles=all"]}.get(name, [])
        steps = [command("verify", str(root)), command("status", str(root))]
        others = [
            call("mmw.open: read every table", lambda: read_all(root)),
            call("mmw.connect: read every view", lambda: query_all(root)),
            call("Dataset.frame", lambda: read_frame(root)),
            command("export", name, str(root), str(folder / "out"), *options),
        ]
        steps += rng.sample(others, 2)
        more = rng.random()
        if more < 0.04:
            steps.append(command("report", str(root), "--out", str(folder / "report.html")))
        elif more < 0.1:
            steps.append(command("view", str(root), "--save", str(folder / "a.rrd")))
        elif more < 0.11:
            steps.append(command("render", str(root), "--out", str(folder / "pictures"), "--device", "cpu"))
        elif more < 0.3:
            table = rng.choice(("lidar", "rgb", "path_gains", "path_geometry", "imu", "poses", "boxes"))
            weather = ("weather=sunny",) if TABLES[table].by_weather else ()
            where = ("frame=1", *weather, "--device", "cpu", "--out", str(folder / "rows.jsonl"))
            steps.append(command("regenerate", table, str(root), *where))
        elif more < 0.4:
            steps.append(command("finalize", str(root)))
        return steps

    def _bytes(self, rng: random.Random, root: Path) -> None:
        path = root / rng.choice(self.files)
        if not path.is_file():
            return
        data = path.read_bytes()
        new = rng.choice((mutate_bytes(rng, data), data[: rng.randrange(len(data) + 1)], b"", data * 2))
        path.write_bytes(new)
        if rng.random() < 0.3:
            _agree(root)

    def _json(self, rng: random.Random, root: Path) -> None:
        path = root / rng.choice((*self.json, Path("dataset.json")))
        if not path.is_file():
            return
        text = path.read_text(errors="replace")
        if rng.random() < 0.25:
            path.write_bytes(mutate_text(rng, text).encode(errors="surrogateescape"))
            return
        try:
            tree = json.loads(text)
        except ValueError:  # mutated before
            return
        path.write_text(json.dumps(mutate_tree(rng, tree)))

    def _names(self, rng: random.Random, root: Path) -> None:
        path = root / rng.choice(self.files)
        other = root / rng.choice(self.files)
        if not path.is_file() or path == other:
            return
        kind = rng.randrange(9)
        if kind == 0:
            path.unlink()
        elif kind == 1:
            path.unlink()
            path.mkdir()
        elif kind == 2:
            path.unlink()
            path.symlink_to(path)
        elif kind == 3:
            path.unlink()
            os.mkfifo(path)
        elif kind == 4 and other.is_file():
            shutil.copy(other, path)
        elif kind == 5:
            path.rename(
                path.with_name(rng.choice(("x", ".x", "part-9.parquet", "part-000001.parquet", "a\nb.json", "é.json")))
            )
        elif kind == 6:
            shutil.copy(
                path, path.with_name(rng.choice(("part-000099.parquet", "copy.json", ".part-000000.parquet.1.tmp")))
            )
        elif kind == 7:
            folder = path.parent
            if folder != root:
                folder.rename(
                    folder.with_name(rng.choice(("scenario=other", "weather=snow", "weather=", "x", "scenario=..%2F")))
                )
        else:
            shutil.rmtree(root / path.relative_to(root).parts[0], ignore_errors=True)

    def _rewrite(self, rng: random.Random, root: Path) -> None:
        """Write a Parquet file with other columns or values, which its marker may then agree with."""
        path = root / rng.choice(self.parquet)
        if not path.is_file():  # a pipe would wait
            return
        try:
            table = pq.ParquetFile(path).read()
        except (OSError, pa.ArrowException):  # damaged before
            return
        for _ in range(rng.choice((1, 1, 2))):
            table = rng.choice(_TABLES)(rng, table)
        try:
            pq.write_table(table, path, compression=rng.choice(("zstd", "none", "snappy")))
        except pa.ArrowInvalid:  # null where the schema has none: the file is left half written
            return
        if rng.random() < 0.7:
            _agree(root)


def _agree(root: Path) -> None:
    """Make markers agree with the files, as far as what is damaged lets them be read."""
    if any(path.is_fifo() for path in root.rglob("*")):  # it would wait
        return
    try:
        agree(root)
    except (Error, OSError, ValueError, KeyError, TypeError, AttributeError):
        return


def _column(rng: random.Random, table: pa.Table, change: Callable[[str, list], pa.Array]) -> pa.Table:
    if not table.num_columns:
        return table
    index = rng.randrange(table.num_columns)
    name = table.column_names[index]
    return table.set_column(index, name, change(name, table.column(index).to_pylist()))


_TYPES: tuple[Any, ...] = (
    pa.string(), pa.int8(), pa.int64(), pa.float32(), pa.float16(), pa.bool_(), pa.null(), pa.binary(),
    pa.timestamp("us"),
    pa.decimal128(10, 2), pa.list_(pa.float64()), pa.struct([("a", pa.int64())]), pa.dictionary(pa.int32(),
    pa.string()),
    pa.large_string(), pa.list_(pa.int32(), 3), pa.uint64(), pa.date32(),
)  # fmt: skip


def _retype(rng: random.Random, table: pa.Table) -> pa.Table:
    kind = rng.choice(_TYPES)

    def change(name: str, values: list) -> pa.Array:
        try:
            return pa.array(values, kind)
        except (pa.ArrowException, TypeError, ValueError, OverflowError):
            return pa.nulls(len(values), pa.string() if pa.types.is_dictionary(kind) else kind)

    return _column(rng, table, change)


def _revalue(rng: random.Random, table: pa.Table) -> pa.Table:
    if not table.num_rows or not table.num_columns:
        return table
    index = rng.randrange(table.num_columns)
    field, values = table.schema.field(index), table.column(index).to_pylist()
    news: tuple[Any, ...] = (
        None, float("nan"), float("inf"), -1, 0, 1, 10**6, 2**31 - 1, 2**62, 1e300, "", "../../x", "<script>",
        "x" * 999, "a\nb",
        b"", b"\xff\xd8\xff", [], [None], [float("nan")], [1] * 999, "cav_9", True, {}, "{", "[1]", "é",
    )  # fmt: skip
    new = rng.choice(news)
    rows = range(len(values)) if rng.random() < 0.3 else [rng.randrange(len(values))]
    for row in rows:
        values[row] = new
    try:
        column = pa.array(values, field.type)
    except (pa.ArrowException, TypeError, ValueError, OverflowError):
        return table
    return table.set_column(index, pa.field(field.name, field.type), column)


def _columns(rng: random.Random, table: pa.Table) -> pa.Table:
    if not table.num_columns:
        return table
    index = rng.randrange(table.num_columns)  # names may be there twice
    kind = rng.randrange(5)
    if kind == 0:
        return table.remove_column(index)
    if kind == 1:
        return table.append_column(table.schema.field(index), table.column(index))
    if kind == 2:
        name = rng.choice(("x", "", "scenario", "é", 'a"b', "a'b"))
        return table.set_column(index, name, table.column(index))
    if kind == 3:
        return table.append_column("more", pa.array(range(table.num_rows)))
    order = rng.sample(range(table.num_columns), table.num_columns)
    return pa.Table.from_arrays(
        [table.column(i) for i in order],
        schema=pa.schema([table.schema.field(i) for i in order], table.schema.metadata),
    )


def _rows(rng: random.Random, table: pa.Table) -> pa.Table:
    kind = rng.randrange(5)
    if kind == 0:
        return table.slice(0, 0)
    if kind == 1:
        return pa.concat_tables([table] * rng.choice((2, 20)))
    if kind == 2:
        return table.slice(0, table.num_rows // 2)
    if kind == 3 and table.num_rows:
        return table.take(rng.sample(range(table.num_rows), table.num_rows))
    return table.replace_schema_metadata(rng.choice(({}, {"mmw.table": "x"}, {"mmw.schema_version": "99"})))


_TABLES = (_retype, _retype, _revalue, _revalue, _revalue, _columns, _columns, _rows)


def read_all(root: Path) -> None:
    data = mmw.open(root)
    for table in (*data.tables, *data.views):
        data.read(table)
    data.numpy("poses")
    data.paths(28e9)


def query_all(root: Path) -> None:
    connection = mmw.connect(root)
    try:
        views = connection.execute("SELECT table_name FROM information_schema.tables").fetchall()
        for (view,) in views:
            connection.execute(f'SELECT count(*) FROM "{view}"').fetchall()
    except duckdb.Error:  # a connection is DuckDB's own, and its errors name the file
        pass
    finally:
        connection.close()


def read_frame(root: Path) -> None:
    data = mmw.open(root)
    frame = data.frame("mine", "sunny", 1)
    for agent in frame.agents.values():
        agent.links, agent.sweeps, agent.views  # noqa: B018 - read at their first use
        for sensor in ("lidar", "imu", "gnss", "front", "depth", "radar"):
            agent.sensor(sensor)
