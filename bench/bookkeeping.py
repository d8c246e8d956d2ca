"""Measure what the number of shards costs: `python -m bench.bookkeeping --copies 1,10,100 --folder out/bookkeeping`.

The folder of a dataset of so many times `configs/full.yaml` is laid out as finished runs leave it: configuration,
markers, and every file under its name, which is a link to one Parquet file without rows. Then every step is timed that
looks at all of it: at the start and end of a run, in `mmw status`, in `mmw finalize`, and when a reader opens a table.
Processor time counts, of all threads; the system's file cache is warm, and a network file system takes longer.
"""

import argparse
import hashlib
import io
import json
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import warp as wp

import mmw
from bench.rays import machine
from mmw.cli import status as status_command
from mmw.config import Config, load_config
from mmw.config.load import to_yaml
from mmw.generation.estimate import check_inputs
from mmw.generation.provenance import versions
from mmw.generation.shards import all_work, pending_work
from mmw.storage.lock import remove_temporaries
from mmw.storage.manifest import CONFIG, DATASET, MANIFEST, finalize, prepare_root, read_markers
from mmw.storage.parquet_schema import arrow_schema
from mmw.storage.shard_writer import ShardKey, marker_path, table_path, write_scenario, write_shard

FULL = Path(__file__).resolve().parent.parent / "configs" / "full.yaml"

FRAMED = (
    "frames", "poses", "boxes", "box_visibility", "imu", "gnss", "lidar", "rgb", "depth", "radar", "boxes_2d", "links",
    "paths",
)  # fmt: skip
"""Tables of a shard of `configs/full.yaml`."""

STATIC = ("objects", "sensors", "materials")

MAX_LINKS = 30_000
"""Names that one file gets; file systems allow 65,000."""

CLEAR_PEAK = Path("/proc/self/clear_refs")


@dataclass(frozen=True)
class Step:
    """One measured line."""

    copies: int
    """Times `configs/full.yaml`."""
    shards: int
    files: int
    step: str
    cpu_s: float
    wall_s: float
    peak_gb: float | None
    """Memory that it took at most [GB]; None where the system does not tell."""


class Links:
    """Many names for the files of one shard."""

    def __init__(self, root: Path, marker: dict[str, Any]):
        """Take the files of a marker."""
        self._root = root
        self._source = {file["table"]: root / file["path"] for file in marker["files"]}
        self._used = dict.fromkeys(self._source, 1)

    def add(self, table: str, path: Path) -> None:
        """Give a table's file another name."""
        target = self._root / path
        if target == self._source[table]:
            return
        target.parent.mkdir(parents=True, exist_ok=True)
        if self._used[table] < MAX_LINKS:
            os.link(self._source[table], target)
            self._used[table] += 1
        else:
            shutil.copyfile(self._source[table], target)
            self._source[table], self._used[table] = target, 1


def many(config: Config, copies: int) -> Config:
    """Return a configuration with all its scenarios so many times, under other names."""
    scenarios = [
        scenario.model_copy(update={"name": f"{scenario.name}_{copy:05d}"})
        for copy in range(copies)
        for scenario in config.scenarios
    ]
    return config.model_copy(update={"scenarios": tuple(scenarios)})


def lay_out(config: Config, root: Path) -> None:
    """Write a finished dataset whose files have no rows."""
    prepare_root(root, config.identity(), config.sha256(), {}, overwrite=False)
    (root / CONFIG).write_text(to_yaml(config))
    meta = {"config_sha256": config.sha256(), "mmw_version": mmw.__version__, "git_sha": "0" * 12, "device": "none"}
    links: dict[bool, tuple[dict[str, Any], Links]] = {}
    for key in _keys(config):
        is_framed = isinstance(key, ShardKey)
        if is_framed not in links:
            tables = {name: arrow_schema(name).empty_table() for name in (FRAMED if is_framed else STATIC)}
            marker = write_shard(root, key, tables, meta) if is_framed else write_scenario(root, key, tables, meta)
            links[is_framed] = marker, Links(root, marker)
        marker, linked = links[is_framed]
        own = {"scenario": key.scenario, "weather": key.weather, "frame_begin": key.frame_begin,
               "frame_end": key.frame_end} if is_framed else {"scenario": key}  # fmt: skip
        for file in marker["files"]:
            linked.add(file["table"], table_path(file["table"], key))
        paths = [table_path(file["table"], key).as_posix() for file in marker["files"]]
        files = [
            {**file, "path": path, "sha256": hashlib.sha256(path.encode()).hexdigest()}
            for file, path in zip(marker["files"], paths, strict=True)
        ]
        (root / marker_path(key)).write_text(json.dumps({**marker, **own, "files": files}, indent=1))
    finalize(root)


def _keys(config: Config) -> Iterator[ShardKey | str]:
    yield from (scenario.name for scenario in config.scenarios)
    for work in all_work(config):
        yield from work.keys


def measure(config: Config, copies: int, root: Path) -> list[Step]:
    """Return what every step takes on a dataset that `lay_out` wrote.

    Args:
        config: Its configuration.
        copies: Times `configs/full.yaml`.
        root: The folder.
    """
    everything = all_work(config)
    shards = sum(len(work.keys) for work in everything)
    files = shards * len(FRAMED) + len(config.scenarios) * len(STATIC)
    first = config.scenarios[0].name
    steps: dict[str, Callable[[], Any]] = {
        "read the configuration": lambda: load_config(root / CONFIG),
        "check its inputs": lambda: check_inputs(config, FULL.parent),
        "hash its towns": lambda: versions(config, FULL.parent, "cpu"),
        "find what is missing": lambda: pending_work(root, everything),
        "find unfinished files": lambda: remove_temporaries(root),
        "read the markers": lambda: read_markers(root),
        "mmw status": lambda: _quiet(lambda: status_command.main([str(root)])),
        "mmw finalize": lambda: finalize(root),
        "open, read one frame": lambda: mmw.open(root).read(
            "poses", scenario=first, weather=config.weathers[0], frames=range(1)
        ),
    }
    return [Step(copies, shards, files, name, *_timed(step)) for name, step in steps.items()]


def _quiet(step: Callable[[], Any]) -> None:
    with redirect_stdout(io.StringIO()):
        step()


def _timed(step: Callable[[], Any]) -> tuple[float, float, float | None]:
    """Return processor time [s], time [s] and memory [GB] that a step takes."""
    before = _memory("VmRSS", clear=True)
    cpu, wall = time.process_time(), time.perf_counter()
    result = step()  # kept until its memory has been looked at
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    peak = _memory("VmHWM")
    del result
    return cpu, wall, None if before is None or peak is None else peak - before


def _memory(name: str, *, clear: bool = False) -> float | None:
    """Return the process's memory or its peak [GB], where Linux tells; `clear` begins a new peak first."""
    if not CLEAR_PEAK.exists():
        return None
    if clear:
        CLEAR_PEAK.write_text("5")
    rows = Path("/proc/self/status").read_text().splitlines()
    return next(int(row.split()[1]) * 1024 / 1e9 for row in rows if row.startswith(name))


def sizes(root: Path) -> dict[str, int]:
    """Return the bytes of what describes a dataset."""
    markers = [path.stat().st_size for path in (root / "_shards").iterdir()]
    found = {name: (root / name).stat().st_size for name in (CONFIG, DATASET, MANIFEST)}
    return {**found, "markers": sum(markers)}


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(prog="python -m bench.bookkeeping", description="Measure the cost of shards.")
    parser.add_argument("--copies", default="1,10", help="times configs/full.yaml, with commas; 100 are 660,000 names")
    parser.add_argument("--folder", type=Path, required=True, help="where the datasets go; each is removed afterwards")
    parser.add_argument("--format", choices=("human", "json"), default="human", help="json: one line a result")
    return parser.parse_args(arguments)


def main(arguments: list[str]) -> None:
    """Measure and print."""
    wp.config.log_level = wp.LOG_WARNING
    options = parse(arguments)
    about = machine("cpu")
    if options.format == "human":
        print(", ".join(f"{key} {value}" for key, value in about.items()))
        print(f"{'copies':>7} {'shards':>8} {'files':>9}  {'step':<24} {'CPU s':>9} {'wall s':>9} {'GB':>7}")
    for copies in (int(text) for text in options.copies.split(",")):
        config, root = many(load_config(FULL), copies), options.folder / f"x{copies}"
        try:
            lay_out(config, root)
            for step in measure(config, copies, root):
                print(json.dumps({**asdict(step), **about}) if options.format == "json" else line(step), flush=True)
            described = {"copies": copies, "bytes": sizes(root)}
            print(json.dumps(described) if options.format == "json" else f"bytes: {described['bytes']}", flush=True)
        finally:
            shutil.rmtree(root)


def line(step: Step) -> str:
    """Return one row of the table."""
    peak = "" if step.peak_gb is None else f"{step.peak_gb:.3f}"
    return (
        f"{step.copies:>7,} {step.shards:>8,} {step.files:>9,}  {step.step:<24} {step.cpu_s:>9.3f} {step.wall_s:>9.3f} "
        f"{peak:>7}"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
