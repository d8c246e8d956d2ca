"""Trace a few frames of a scenario in memory, to foresee rows, bytes and settings that find nothing: `--dry-run`.

A channel has as many paths as the scene gives it, and a picture compresses as what it shows: both are measured.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow as pa

from mmw.config import Config, Sampling, ScenarioConfig
from mmw.core.timing import StageTimer
from mmw.generation.capture import capture_frames
from mmw.generation.configuration_warnings import configuration_warnings, wedge_warnings
from mmw.generation.pipeline import join_batches, make_batch
from mmw.scene.prepare import prepare_scenario, read_scenario
from mmw.scene.rows import static_rows
from mmw.sensors.batch import Batch, TableRows
from mmw.storage.arrow_tables import table_from_columns
from mmw.storage.parquet_writer import ParquetFileBuilder
from mmw.storage.shard_writer import FILE_META

SAMPLE_PLACES = (0.1, 0.5, 0.9)
"""Places of the traced frames in the scenario, as shares of its length. Design value."""

MAX_FIXED = 2.5
"""Largest ratio of what a file needs besides its rows to a file without any. Design value, seen: 1.2 to 2."""

SENSOR = "sensor"
"""Column that names the sensor of a row."""

CHANNEL, CHANNEL_TABLES = "channel", ("links", "path_geometry", "path_gains")
"""Name of the radio channel beside those of sensors, which may not have it, and its tables."""


@dataclass(frozen=True)
class SampledScenario:
    """Foreseen tables of a scenario."""

    rows: Mapping[str, float]
    """Table -> rows in all weathers."""
    bytes: Mapping[str, float]
    """Table -> bytes of its files in all weathers."""
    notes: tuple[str, ...]
    """Warnings, one line each."""


def sample_scenario(config: Config, scenario: ScenarioConfig, base: Path, device: str) -> SampledScenario:
    """Trace frames at `SAMPLE_PLACES` of a scenario, and one of each sensor that has none there.

    Args:
        config: The configuration.
        scenario: One of its scenarios.
        base: Folder that relative paths start from.
        device: Warp device.

    Raises:
        InputError: If the scenario cannot be prepared, read or traced.
    """
    with TemporaryDirectory(prefix="mmw_sample_") as folder, ThreadPoolExecutor(2) as pool:
        stage = prepare_scenario(config, scenario, base, Path(folder))
        arrays = read_scenario(config, scenario, stage)
        batch = make_batch(config, scenario, arrays, device, 1, pool, StageTimer())
        notes = (*configuration_warnings(arrays, config, scenario), *wedge_warnings(batch.surfaces))
        frames = _sample_frames(config, scenario)
        traced = _trace(batch, scenario.name, frames)
        static = {
            name: table_from_columns(name, {"scenario": scenario.name, **columns})
            for name, columns in static_rows(arrays, config).items()
        }
    rows: dict[str, float] = defaultdict(float)
    size: dict[str, float] = defaultdict(float)
    for name, table in static.items():
        rows[name] += table.num_rows
        size[name] += _encoded(name, [(0, table)])
    whole = config.frames_of(scenario)
    shards = -(-whole.count // config.output.shard_frames)
    ratio = _ratios(config, scenario, frames)
    for (_, name), tables in traced.items():
        count = _weighted_rows(name, tables.values(), ratio)
        fixed, each = _file_size(name, tables)
        rows[name] += count
        size[name] += shards * fixed + count * each
    return SampledScenario(dict(rows), dict(size), notes)


def _sample_frames(config: Config, scenario: ScenarioConfig) -> list[int]:
    """Return the frames to trace, ascending."""
    whole, rate_hz = config.frames_of(scenario), config.frame_rate_of(scenario)
    own = {name: _due(sampling, range(whole.start, whole.stop), rate_hz) for name, sampling in _samplings(config)}
    rarest = min((due for due in own.values() if len(due)), key=len, default=np.arange(whole.start, whole.stop))
    chosen = {int(rarest[int(place * len(rarest))]) for place in SAMPLE_PLACES}
    for due in own.values():
        if len(due) and not chosen.intersection(due.tolist()):
            chosen.add(int(due[len(due) // 2]))
    return sorted(chosen)


def _samplings(config: Config) -> Iterator[tuple[str, Sampling]]:
    """Yield the name of each sensor, or `CHANNEL`, and when it samples."""
    yield from ((sensor.name, sensor) for sensor in config.sensors)
    if config.channel.enabled:
        yield CHANNEL, config.channel


def _due(sampling: Sampling, frames: range, rate_hz: int) -> np.ndarray:
    """Return those of some frames that are sampled."""
    every = np.array(frames, dtype=np.int64)
    return every[sampling.is_due(every, rate_hz)]


def _trace(batch: Batch, scenario: str, frames: Iterable[int]) -> dict[tuple[str, str], dict[int, pa.Table]]:
    """Return the rows of frames, by weather and table."""
    traced: dict[tuple[str, str], dict[int, pa.Table]] = defaultdict(dict)
    for frame in frames:
        rows: TableRows = {weather: defaultdict(list) for weather in batch.config.weathers}
        capture_frames(batch, [frame], rows)
        for weather, tables in rows.items():
            for name, batches in tables.items():
                traced[weather, name][frame] = join_batches(name, scenario, weather, batches)
    return traced


def _ratios(config: Config, scenario: ScenarioConfig, frames: list[int]) -> dict[str, float]:
    """Return samples of all frames over those of the traced ones, by sensor, of `CHANNEL` and, under "", of frames."""
    whole, rate_hz = config.frames_of(scenario), config.frame_rate_of(scenario)
    ratio = {"": whole.count / len(frames)}
    for name, sampling in _samplings(config):
        traced = int(sampling.is_due(frames, rate_hz).sum())
        ratio[name] = len(_due(sampling, range(whole.start, whole.stop), rate_hz)) / traced if traced else 0.0
    return ratio


def _weighted_rows(name: str, tables: Iterable[pa.Table], ratio: Mapping[str, float]) -> float:
    """Return the rows of a table in all frames that follow from those in the traced ones."""
    total = 0.0
    for table in tables:
        if SENSOR not in table.column_names:
            total += table.num_rows * ratio[CHANNEL if name in CHANNEL_TABLES else ""]
            continue
        counts = table.column(SENSOR).cast(pa.string()).value_counts().to_pylist()
        total += sum(count["counts"] * ratio.get(count["values"], ratio[""]) for count in counts)
    return total


def _file_size(name: str, tables: Mapping[int, pa.Table]) -> tuple[float, float]:
    """Return the bytes of a file without its rows, and those of each row, from the rows of some frames.

    What a file needs as soon as it has a row, dictionaries and statistics, counts as its own, not as the row's.
    """
    parts = [(frame, table) for frame, table in tables.items() if table.num_rows]
    empty = _encoded(name, [(frame, table.slice(0, 0)) for frame, table in list(tables.items())[:1]])
    if not parts:
        return empty, 0.0
    rows, whole = sum(table.num_rows for _, table in parts), _encoded(name, parts)
    one = _encoded(name, [(parts[0][0], parts[0][1].slice(0, 1))])
    each = (whole - one) / (rows - 1) if rows > 1 else one - empty
    fixed = min(max(one - each, empty), MAX_FIXED * empty)  # pictures differ: one alone may be larger than the others
    return fixed, max(whole - fixed, 0.0) / rows


def _encoded(name: str, parts: Iterable[tuple[int, pa.Table]]) -> int:
    """Return the bytes of a file with rows of some frames."""
    builder: ParquetFileBuilder | None = None
    for frame, table in parts:
        builder = builder or ParquetFileBuilder(name, frame, dict.fromkeys(FILE_META.values(), "0" * 64))
        builder.add(table, frame + 1)
    return builder.close().nbytes if builder is not None else 0


def total(values: Mapping[str, float]) -> float:
    """Return the sum over tables."""
    return sum(values.values())


def table_lines(samples: Iterable[SampledScenario]) -> Iterator[str]:
    """Yield a line for each table with its rows and bytes, over all scenarios."""
    rows: dict[str, float] = defaultdict(float)
    size: dict[str, float] = defaultdict(float)
    for sample in samples:
        for name, count in sample.rows.items():
            rows[name] += count
            size[name] += sample.bytes[name]
    for name, count in rows.items():
        yield f"  {name:16} {count:>14,.0f} rows {size[name] / 1e6:>12,.2f} MB"
