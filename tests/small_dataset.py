"""A small real dataset, made once a process, and how to damage copies of it."""

import atexit
import functools
import hashlib
import json
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from mmw.config import Config, ScenarioConfig
from mmw.paths import configs_dir
from mmw.prepare import read_scenario
from mmw.run import main
from mmw.scene_arrays import SceneArrays
from mmw.tables.manifest import finalize
from mmw.tables.parquet import arrow_schema, write_options

SCENARIO = "town03_roundabout"
SMALL = (
    "frames.count=4",
    "output.shard_frames=2",
    "weathers=[sunny, rainy]",
    "channel.rays=20_000",
    "sensors=[{type: lidar, channels: 16, points_per_channel: 180}, "
    "{type: depth, width_px: 160, height_px: 120, segmentation: true}, {type: imu}, {type: gnss, rate_hz: 50}, "
    "{type: rgb, name: front, width_px: 64, height_px: 48, every_frames: 2}]",
)


@functools.cache
def small_dataset() -> Path:
    """Return the folder of a dataset of four frames in two weathers; nothing may be changed in it."""
    root = Path(tempfile.mkdtemp(prefix="mmw-small-")) / "dataset"
    atexit.register(shutil.rmtree, root.parent, ignore_errors=True)
    code = main(["--config", str(configs_dir() / "quickstart.yaml"), *SMALL, "--out", str(root), "--device", "cpu"])
    assert code == 0
    return root


_SCENES: dict[tuple[str, str, Path], SceneArrays] = {}


def read_once(config: Config, scenario: ScenarioConfig, stage: Path) -> SceneArrays:
    """Stand in for `read_scenario` where rows are made again: a stage, which no copy changes, is read once."""
    key = config.sha256(), scenario.name, stage.resolve()
    if key not in _SCENES:
        _SCENES[key] = read_scenario(config, scenario, stage)
    return _SCENES[key]


def copy_of(root: Path, to: Path) -> Path:
    """Copy a dataset; stages and assets, which are large, are linked."""
    shutil.copytree(root, to, ignore=shutil.ignore_patterns("stages", "assets"))
    for name in ("stages", "assets"):
        (to / name).symlink_to(root / name)
    return to


def part(table: str, weather: str = "sunny", frame: int = 0) -> str:
    """Return the path of a file of the small dataset."""
    return f"{table}/scenario={SCENARIO}/weather={weather}/part-{frame:06d}.parquet"


def rewrite(root: Path, path: str, change: Callable[[pa.Table], pa.Table], meta: dict[str, str] | None = None) -> None:
    """Write a file with other rows, so that marker and manifest agree with it."""
    table = change(pq.ParquetFile(root / path).read())
    name = path.split("/")[0]
    old = pq.ParquetFile(root / path).schema_arrow.metadata or {}
    kept = {key.decode(): value.decode() for key, value in old.items() if key.startswith(b"mmw.")}
    kept = {**kept, **(meta or {})}
    schema = arrow_schema(name, kept)
    pq.write_table(table.replace_schema_metadata(schema.metadata), root / path, **write_options(name))
    data = (root / path).read_bytes()
    for marker in (root / "_shards").glob("*.json"):
        content = json.loads(marker.read_text())
        for file in content["files"]:
            if file["path"] == path:
                file.update(bytes=len(data), rows=table.num_rows, sha256=hashlib.sha256(data).hexdigest())
        marker.write_text(json.dumps(content))
    finalize(root)


def replace_column(table: pa.Table, name: str, change: Callable[[list], list]) -> pa.Table:
    """Return a table with other values in a column."""
    index = table.schema.get_field_index(name)
    field = table.schema.field(index)
    return table.set_column(index, field, pa.array(change(table.column(name).to_pylist()), field.type))
