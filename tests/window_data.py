"""A made-up dataset with holes, for the tests of windows, and windows that exist in memory only."""

import atexit
import functools
import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from mmw.tables.columns import table_from_columns
from mmw.tables.encode import encode_rgb
from mmw.tables.manifest import finalize, prepare_root
from mmw.tables.schema.columns import F64, list_of
from mmw.tables.writer import ShardKey, write_scenario, write_shard
from mmw.windows import Track, Windows, WindowSpec
from tests.shards import AGENTS, META, make_shard

TOWNS = {"circle": "town03", "slope": "town03", "crossing": "town05"}
WEATHERS = ("rainy", "sunny")
FRAMES, SHARD = 60, 30
IMAGE_FRAMES, GNSS_FRAMES = 10, 2
SENSORS = ("lidar", "front", "imu", "gnss", "depth", "radar", "radar_2")
TABLES = ("poses", "boxes", "imu", "gnss", "lidar", "rgb", "depth", "radar", "links", "paths")


def is_there(table: str, scenario: str, agent: str, frame: int) -> bool:
    """Return whether the dataset has the rows of an agent in a frame: cav_2 is away in frames 25 to 27, the first
    scenario lacks one sweep, images come every ten frames and GNSS samples every two."""
    if agent == "cav_2" and 25 <= frame <= 27:
        return False
    if table == "lidar" and (scenario, agent, frame) == ("circle", "cav_1", 33):
        return False
    return not (table == "rgb" and frame % IMAGE_FRAMES) and not (table == "gnss" and frame % GNSS_FRAMES)


def shard_tables(key: ShardKey) -> dict[str, pa.Table]:
    """Return the tables of a shard, JPEG images of 16 x 24 pixels among them."""
    rng, found = np.random.default_rng(key.frame_begin), {}
    for name, columns in make_shard(key, points=20, height=2, width=3).items():
        if name not in TABLES:
            continue
        table = table_from_columns(name, {"scenario": key.scenario, "weather": key.weather, **columns})
        if name != "boxes":
            rows = zip(table.column("agent").to_pylist(), table.column("frame").to_pylist(), strict=True)
            table = table.filter(pa.array([is_there(name, key.scenario, agent, frame) for agent, frame in rows]))
        if name == "rgb":
            coarse = rng.integers(0, 255, (table.num_rows, 4, 6, 3), dtype=np.uint8)
            images = [(encode_rgb(one.repeat(4, 0).repeat(4, 1), "jpeg", 95, "4:4:4"), None) for one in coarse]
            index, field = table.schema.get_field_index("image"), table.schema.field("image")
            values = [{"bytes": data, "path": path} for data, path in images]
            table = table.set_column(index, field, pa.array(values, field.type))
        found[name] = table
    return found


def statics() -> dict:
    """Return columns of table `sensors`."""
    rows = [(agent, sensor) for agent in AGENTS for sensor in SENSORS]
    params = {"front": {"every_frames": IMAGE_FRAMES}, "gnss": {"rate_hz": 100 // GNSS_FRAMES}}
    zeros = np.zeros(len(rows))
    return {
        "sensors": {
            "agent": [agent for agent, _ in rows],
            "sensor": [sensor for _, sensor in rows],
            "type": [{"front": "rgb", "radar_2": "radar"}.get(sensor, sensor) for _, sensor in rows],
            **dict.fromkeys(["x", "y", "z", "qx", "qy", "qz"], zeros),
            "qw": zeros + 1.0,
            **dict.fromkeys(["fx", "fy", "cx", "cy", "width", "height", "lens"], [None] * len(rows)),
            "coefficients": pa.nulls(len(rows), list_of(F64)),
            "params": [json.dumps(params.get(sensor, {})) for _, sensor in rows],
        }
    }


@functools.cache
def window_data() -> Path:
    """Return the folder of the dataset; nothing may be changed in it."""
    root = Path(tempfile.mkdtemp(prefix="mmw-windows-")) / "dataset"
    atexit.register(shutil.rmtree, root.parent, ignore_errors=True)
    scenarios = [{"name": name, "town": town, "stage": None} for name, town in TOWNS.items()]
    prepare_root(root, {"seed": 42, "scenarios": scenarios}, META["config_sha256"], {"mmw": "0.1.0"}, False)
    for scenario in TOWNS:
        write_scenario(root, scenario, statics(), META)
        for weather in WEATHERS:
            for begin in range(0, FRAMES, SHARD):
                key = ShardKey(scenario, weather, begin, begin + SHARD)
                write_shard(root, key, shard_tables(key), META)
    finalize(root)
    return root


def row_of(rows: pa.Table, **key: object) -> dict:
    """Return the one row with these values."""
    for name, value in key.items():
        column = rows.column(name)
        column = column.cast(pa.string()) if pa.types.is_dictionary(column.type) else column
        rows = rows.filter(pc.equal(column, value))
    (row,) = rows.to_pylist()
    return row


def bare_windows(frames: Mapping[tuple[str, str, str], Sequence[int]], past: int, held: int, future: int) -> Windows:
    """Return windows of tracks without any dataset, one for every frame that has the frames it uses.

    Args:
        frames: Scenario, weather and agent -> frames of the track, growing.
        past: Frames before `now`.
        held: Frames that the oldest sample may be older than the first past frame; it is that for odd `now`.
        future: Frames after `now`.
    """
    tracks = tuple(Track(*name, "cav", np.array(own)) for name, own in sorted(frames.items()))
    found = []
    for number, track in enumerate(tracks):
        for now in track.frames.tolist():
            first, last = now - past - held * (now % 2), now + future
            if set(range(first, last + 1)) <= set(track.frames.tolist()):
                found.append((number, now, first, last, 0))
    arrays = np.array(found, dtype=np.int64).reshape(-1, 5).T
    return Windows(None, WindowSpec(["poses"], past + 1, future), tracks, {}, *arrays, {})
