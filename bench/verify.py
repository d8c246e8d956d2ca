"""Measure `mmw verify`: `python -m bench.verify --shards 1000`.

A dataset of shards of one frame, the worst case, is made once in a temporary folder or taken from DATASET. The time of
`mmw verify` is then compared with that of reading alone (files, SHA-256, Parquet).
"""

import argparse
import hashlib
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from mmw.cli.run import main as run
from mmw.cli.verify import WORKERS, check
from mmw.generation.verification.row_counts import COLUMNS
from mmw.storage.manifest import read_markers
from mmw.storage.parquet_schema import arrow_schema
from mmw.storage.row_checks import columns_to_read
from mmw.storage.schemas import TABLES
from mmw.storage.shard_files import THREADS
from mmw.storage.store import Store

RUN = (
    "weathers=[sunny, rainy]", "output.shard_frames=1", "channel.samples_per_tx=10_000",
    "sensors=[{type: lidar, channels: 8, points_per_channel: 64}, {type: imu}]",
)  # fmt: skip


def seconds_of(work: Callable[[], object]) -> float:
    """Return the time that a call takes [s]."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def read_all(root: Path) -> None:
    """Read, hash and decode what `mmw verify` does, by as many threads."""
    store = Store(root)
    tables = {
        spec.name: columns_to_read(arrow_schema(spec), spec.key, COLUMNS.get(spec.name, ())) for spec in TABLES.values()
    }

    def read(file: dict) -> None:
        data = store.read(file["path"])
        hashlib.sha256(data or b"").hexdigest()
        with pq.ParquetFile(pa.BufferReader(data)) as parquet:
            parquet.read(columns=tables[file["table"]], use_threads=False)

    with ThreadPoolExecutor(THREADS) as pool:
        for _ in pool.map(read, [file for marker in read_markers(root) for file in marker["files"]]):
            pass


def verify(root: Path, frames: int) -> None:
    """Run `mmw verify`; a finding ends the measurement."""
    if findings := check(root, frames, WORKERS):
        raise SystemExit(f"{root}: {findings[0]}")


def main() -> None:
    """Print one line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("dataset", nargs="?", type=Path, help="dataset; by default one is made")
    parser.add_argument("--shards", type=int, default=1000, help="shards of the dataset that is made")
    parser.add_argument("--frames", type=int, default=1, help="frames of each weather that are held against physics")
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        root = arguments.dataset or Path(folder) / "dataset"
        if arguments.dataset is None:
            code = run(["--config", "quickstart", *RUN, f"frames.count={arguments.shards // 2}", "--out", str(root)])
            if code:
                sys.exit(code)
        shards = sum(1 for _ in (root / "_shards").glob("*.*.*.json"))
        files = sum(1 for _ in root.rglob("part-*.parquet"))
        works = (lambda: read_all(root), lambda: verify(root, arguments.frames))
        pairs = [[seconds_of(work) for work in works] for _ in range(arguments.repeats)]
        reading, whole = (min(times) for times in zip(*pairs, strict=True))
        print(
            f"{shards} shards, {files} files: {whole:.2f} s; reading alone {reading:.2f} s; "
            f"beside reading {whole - reading:.2f} s (each the least of {arguments.repeats})"
        )


if __name__ == "__main__":
    main()
