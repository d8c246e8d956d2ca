"""Measure windows for learning: `python -m bench.window_loading --root out/quickstart` (any dataset of LiDAR and RGB).

The rows of the dataset's first scenario and weather are repeated to `--frames` frames, a sweep an agent and frame, an
image a camera and ten frames, in shards of 100 frames as a run writes them. Windows of 40 past and 10 future frames
are read in this one process and collated to batches of 8: `stream` in the order of the files with a buffer, `random`
in random order, where next to nothing is shared. Time is CPU time of the process, the least of several rounds; every
round starts with an empty cache.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import torch
from torch.utils.data import DataLoader

from bench.rays import machine
from mmw.dataset import Dataset, open_dataset
from mmw.dataset.windows import Feature, Windows, WindowSpec, open_windows
from mmw.dataset.windows.file_sources import FileSource
from mmw.dataset.windows.windows import CACHE_BYTES
from mmw.storage.manifest import finalize, prepare_root
from mmw.storage.schemas import table_spec
from mmw.storage.shard_writer import ShardKey, write_scenario, write_shard
from mmw.torch import WindowDataset, WindowStream, collate

BATCH = 8
SHARD_FRAMES = 100
IMAGE_FRAMES = 10
"""Frames from one image to the next."""
RANDOM_BYTES = 10_000_000
"""Size of the cache in random order: next to nothing is shared, as in a dataset that is larger than memory."""
TABLES = ("poses", "links", "path_gains", "path_geometry", "lidar", "rgb")


@dataclass(frozen=True)
class Result:
    """One measured line."""

    content: str
    """Features of a window."""
    order: str
    """`stream` or `random`."""
    stride: int
    """Frames from one window of a track to the next."""
    windows: int
    windows_per_s: float
    """By CPU time of one core."""


def stretch(source: Dataset, root: Path, frames: int) -> Path:
    """Write a dataset that repeats the frames of another one, and return its folder."""
    first = source.read("poses", columns=["scenario", "weather"])
    scenario, weather = (first.column(name)[0].as_py() for name in ("scenario", "weather"))
    weathers = {name: weather if table_spec(name).by_weather else None for name in TABLES}
    rows = {name: source.read(name, scenario=scenario, weather=weathers[name]) for name in TABLES}
    meta = {"config_sha256": source.info["config_sha256"]}
    prepare_root(root, source.info["config"], meta["config_sha256"], {}, False)
    write_scenario(root, scenario, {"sensors": source.read("sensors", scenario=scenario)}, meta)
    for begin in range(0, frames, SHARD_FRAMES):
        end = min(begin + SHARD_FRAMES, frames)
        write_shard(
            root, ShardKey(scenario, weather, begin, end),
            {name: repeated(table, begin, end, IMAGE_FRAMES if name == "rgb" else 1) for name, table in rows.items()},
            meta,
        )  # fmt: skip
    finalize(root)
    return root


def repeated(rows: pa.Table, begin: int, end: int, every: int) -> pa.Table:
    """Return rows for every frame of a shard that is a multiple of `every`, repeated from the existing ones in turn."""
    known = np.unique(rows.column("frame").to_numpy())
    index, field = rows.schema.get_field_index("frame"), rows.schema.field("frame")
    found = []
    for frame in range(-(-begin // every) * every, end, every):
        own = rows.filter(pc.equal(rows.column("frame"), int(known[frame // every % len(known)])))
        found.append(own.set_column(index, field, pa.array(np.full(own.num_rows, frame), field.type)))
    return pa.concat_tables(found).combine_chunks()


def contents(windows_of: Path, order: str, stride: int, carrier_hz: float, shrink: int) -> dict[str, Windows]:
    """Return windows of several contents of one dataset."""
    room = CACHE_BYTES if order == "stream" else RANDOM_BYTES
    beams = [Feature("beams", carrier_hz=carrier_hz), Feature("beams", span="future", carrier_hz=carrier_hz)]
    lidar, image = Feature("lidar", every=10), Feature("rgb", sensor="front", every=10, shrink=shrink)
    features = {
        "beams": beams,
        "4 LiDAR": [*beams, lidar],
        "4 JPEG": [*beams, image],
        "4 LiDAR + 4 JPEG": [*beams, lidar, image],
    }
    return {
        name: open_windows(
            windows_of,
            WindowSpec(some, past=40, future=10, stride=stride),
            cache=windows_of / "beams",
            cache_bytes=room,
        )
        for name, some in features.items()
    }


def measure(windows: Windows, order: str, rounds: int, min_s: float = 0.5) -> float:
    """Return windows a second of CPU time, the best of several rounds of at least some seconds."""
    best = 0.0
    for number in range(rounds):
        generator = torch.Generator().manual_seed(number)
        random = {"batch_size": BATCH, "collate_fn": collate, "shuffle": True, "generator": generator}
        loader = (
            DataLoader(WindowDataset(windows), **random)
            if order == "random"
            else DataLoader(WindowStream(windows, BATCH, seed=number), batch_size=None)
        )
        count, start = 0, time.process_time()
        while time.process_time() - start < min_s:
            for source in windows.sources.values():
                if isinstance(source, FileSource):
                    source.cache.clear()
            count += sum(len(batch["now"]) for batch in loader)
        best = max(best, count / (time.process_time() - start))
    return best


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(prog="python -m bench.window_loading", description="Measure windows for learning.")
    parser.add_argument("--root", type=Path, required=True, help="dataset whose rows are repeated")
    parser.add_argument("--frames", type=int, default=300, help="frames of the dataset that is measured")
    parser.add_argument("--keep", type=Path, help="folder of it; it is used again if it is there (a temporary one)")
    parser.add_argument("--carrier", type=float, default=28e9, help="carrier of the beams [Hz]")
    parser.add_argument("--shrink", type=int, default=1, help="divisor of the images' width and height")
    parser.add_argument("--rounds", type=int, default=3, help="timed rounds")
    parser.add_argument("--format", choices=("human", "json"), default="human", help="json: one line a result")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str]) -> None:
    """Measure and print."""
    options = parse(arguments)
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as temporary:
        root = options.keep or Path(temporary) / "dataset"
        if not root.is_dir():
            stretch(open_dataset(options.root), root, options.frames)
        about = {**machine("cpu"), "torch": torch.__version__, "pyarrow": pa.__version__}
        if options.format == "human":
            print(", ".join(f"{key} {value}" for key, value in about.items()))
            print("content            order   stride  windows  windows/s")
        for order, stride in (("stream", 10), ("stream", 1), ("random", 10)):
            for content, windows in contents(root, order, stride, options.carrier, options.shrink).items():
                rate = measure(windows, order, options.rounds)
                result = Result(content, order, stride, len(windows), rate)
                text = line(result) if options.format == "human" else json.dumps({**asdict(result), **about})
                print(text, flush=True)


def line(result: Result) -> str:
    """Return one row of the table."""
    return f"{result.content:18} {result.order:7} {result.stride:6} {result.windows:8} {result.windows_per_s:10,.0f}"


if __name__ == "__main__":
    main(sys.argv[1:])
