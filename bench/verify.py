"""Measure `mmw verify`: `python -m bench.verify --shards 1000`.

A dataset of shards of one frame, the worst case, is made once in a temporary folder or taken from DATASET. The time of
`mmw verify` is then divided into reading (files, SHA-256, Parquet) and all else, the checks themselves.
"""

import argparse
import hashlib
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pyarrow.parquet as pq

from mmw.cli.run import main as run
from mmw.cli.verify import check
from mmw.dataset import Dataset
from mmw.storage.store import Store

RUN = (
    "weathers=[sunny, rainy]", "output.shard_frames=1", "channel.samples_per_tx=10_000",
    "sensors=[{type: lidar, channels: 8, points_per_channel: 64}, {type: imu}]",
)  # fmt: skip


class Stopwatch:
    """Time in some functions, calls inside of others not counted twice."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._is_running = False

    def timed(self, function: Callable) -> Callable:
        """Return the function with its time counted."""

        def call(*arguments: Any, **options: Any) -> Any:
            if self._is_running:
                return function(*arguments, **options)
            self._is_running, began = True, time.perf_counter()
            try:
                return function(*arguments, **options)
            finally:
                self.seconds += time.perf_counter() - began
                self._is_running = False

        return call


def measure(root: Path, frames: int) -> tuple[float, float]:
    """Return the seconds of a whole verification, and those of reading."""
    reading = Stopwatch()
    with (
        patch.object(Store, "read", reading.timed(Store.read)),
        patch.object(hashlib, "sha256", reading.timed(hashlib.sha256)),
        patch.object(pq.ParquetFile, "__init__", reading.timed(pq.ParquetFile.__init__)),
        patch.object(pq.ParquetFile, "read", reading.timed(pq.ParquetFile.read)),
        patch.object(pq, "read_table", reading.timed(pq.read_table)),
        patch.object(Dataset, "read", reading.timed(Dataset.read)),
    ):
        began = time.perf_counter()
        findings = check(root, frames)
        seconds = time.perf_counter() - began
    if findings:
        raise SystemExit(f"{root}: {findings[0]}")
    return seconds, reading.seconds


def main() -> None:
    """Print one line for each repetition."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("dataset", nargs="?", type=Path, help="dataset; by default one is made")
    parser.add_argument("--shards", type=int, default=1000, help="shards of the dataset that is made")
    parser.add_argument("--frames", type=int, default=1, help="frames of each weather that are held against physics")
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        root = arguments.dataset or Path(folder) / "dataset"
        if arguments.dataset is None:
            code = run(["--config", "quickstart", *RUN, f"frames.count={arguments.shards // 2}", "--out", str(root)])
            if code:
                sys.exit(code)
        shards = sum(1 for _ in (root / "_shards").glob("*.*.*.json"))
        files = sum(1 for _ in root.rglob("part-*.parquet"))
        for _ in range(arguments.repeats):
            whole, reading = measure(root, arguments.frames)
            print(
                f"{shards} shards, {files} files: {whole:.2f} s, of which reading {reading:.2f} s, "
                f"checks {whole - reading:.2f} s"
            )


if __name__ == "__main__":
    main()
