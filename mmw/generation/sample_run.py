"""Trace a few frames of a scenario in memory, to foresee rows, bytes and settings that find nothing: `--dry-run`.

A channel has as many paths as the scene gives it, and a picture compresses as what it shows: both are measured. The
pictures of a scenario have about equal sizes (standard deviation 7 to 12 %): one of each camera in a frame is enough.
Links differ more, by place and agent: the channel has frames of its own, and some links of a frame stand for many.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow as pa

from mmw.channel.links import Links
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.config import Config, Sampling, ScenarioConfig, SensorConfig
from mmw.config.sensor_spec import spec_of
from mmw.core.timing import StageTimer
from mmw.generation.capture import capture_channel, capture_frames, channel_links
from mmw.generation.configuration_warnings import configuration_warnings, surface_warnings
from mmw.generation.pipeline import join_batches, make_batch
from mmw.scene.prepare import prepare_scenario, read_scenario
from mmw.scene.rows import static_rows
from mmw.scene.views import sample_views
from mmw.sensors.batch import Batch, TableRows
from mmw.storage.arrow_tables import table_from_columns
from mmw.storage.parquet_writer import ParquetFileBuilder
from mmw.storage.shard_writer import FILE_META

SAMPLE_PLACES = (0.1, 0.5, 0.9)
"""Places of the traced frames in the scenario, as shares of its length. Design value."""

CHANNEL_FRAMES = 2
"""Traced frames of the channel for each place of the others. Design value: the paths of a link change by a factor of
up to four along a drive with `channel.physics: standard`."""

MAX_LINKS = 6
"""Most links of a frame that are traced with diffraction or diffuse reflection: with `channel.physics: full` each takes
seconds of a CPU, without these milliseconds. Design value."""

MAX_FIXED = 2.5
"""Largest ratio of what a file needs besides its rows to a file without any. Design value, seen: 1.2 to 2."""

SENSOR = "sensor"
"""Column that names the sensor of a row."""

CHANNEL, CHANNEL_TABLES = "channel", ("links", "path_geometry", "path_gains")
"""Name of the radio channel beside those of sensors, which may not have it, and its tables."""

FRAMES, STATIC = "", "/"
"""Origin of rows that neither a sensor nor the channel makes: every frame, or the scenario as a whole."""

Traced = dict[tuple[str, str], dict[int, pa.Table]]
"""Weather and table -> rows of each traced frame."""


@dataclass(frozen=True)
class SampledTable:
    """One foreseen table of a scenario, in all weathers."""

    rows: Mapping[str, float]
    """Sensor, `CHANNEL`, `FRAMES` or `STATIC` -> rows that come from it."""
    shard_bytes: float
    """Bytes of the files of a shard without rows."""
    row_bytes: float
    """Bytes of a row."""

    @property
    def row_count(self) -> float:
        """All rows."""
        return sum(self.rows.values())

    def bytes(self, shards: int) -> float:
        """Return the bytes of the files of some shards."""
        return shards * self.shard_bytes + self.row_count * self.row_bytes


@dataclass(frozen=True)
class SampledScenario:
    """Foreseen tables of a scenario."""

    name: str
    tables: Mapping[str, SampledTable]
    """By name."""
    shards: int
    """Shards of each framed table and weather."""
    notes: tuple[str, ...] = ()
    """Warnings, one line each."""
    is_traced: bool = True
    """Whether frames of this scenario were traced, rather than of others like it."""

    @property
    def rows(self) -> dict[str, float]:
        """Table -> rows in all weathers."""
        return {name: table.row_count for name, table in self.tables.items()}

    @property
    def bytes(self) -> dict[str, float]:
        """Table -> bytes of its files in all weathers."""
        return {name: table.bytes(self.shards) for name, table in self.tables.items()}


def sample_scenario(
    config: Config, scenario: ScenarioConfig, base: Path, device: str, places: Sequence[float] = SAMPLE_PLACES
) -> SampledScenario:
    """Trace some frames of a scenario, one of each sensor that has none there, and more of the channel alone.

    Args:
        config: The configuration.
        scenario: One of its scenarios.
        base: Folder that relative paths start from.
        device: Warp device.
        places: Places of the frames, as shares of the scenario's length.

    Raises:
        InputError: If the scenario cannot be prepared, read or traced.
    """
    with TemporaryDirectory(prefix="mmw_sample_") as folder, ThreadPoolExecutor(2) as pool:
        stage = prepare_scenario(config, scenario, base, Path(folder))
        arrays = read_scenario(config, scenario, stage)
        batch = make_batch(config, scenario, arrays, device, 1, pool, StageTimer())
        notes = (*configuration_warnings(arrays, config, scenario), *surface_warnings(batch.surfaces))
        frames = _sample_frames(config, scenario, places)
        ratio = _ratios(config, scenario, frames)
        traced, shares = _trace(replace(batch, surfaces=None), frames)
        if batch.surfaces is not None:
            ratio[CHANNEL] = _trace_channel(batch, batch.surfaces, CHANNEL_FRAMES * len(places), traced, shares)
        static = {
            name: table_from_columns(name, {"scenario": scenario.name, **columns})
            for name, columns in static_rows(arrays, config).items()
        }
    tables = {
        name: SampledTable({STATIC: table.num_rows}, 0.0, _encoded(name, [(0, table)]) / max(table.num_rows, 1))
        for name, table in static.items()
    }
    for name in dict.fromkeys(name for _, name in traced):
        tables[name] = _sampled_table(name, [traced[key] for key in traced if key[1] == name], ratio, shares)
    shards = -(-config.frames_of(scenario).count // config.output.shard_frames)
    return SampledScenario(scenario.name, tables, shards, notes)


def _sample_frames(config: Config, scenario: ScenarioConfig, places: Sequence[float]) -> list[int]:
    """Return the frames to trace, ascending."""
    whole, rate_hz = config.frames_of(scenario), config.frame_rate_of(scenario)
    own = {name: _due(sampling, range(whole.start, whole.stop), rate_hz) for name, sampling in _samplings(config)}
    rarest = min((due for due in own.values() if len(due)), key=len, default=np.arange(whole.start, whole.stop))
    chosen = {int(rarest[int(place * len(rarest))]) for place in places}
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


def _trace(batch: Batch, frames: Sequence[int]) -> tuple[Traced, dict[tuple[int, str], float]]:
    """Return the rows of frames without the channel, and by frame and sensor all samples over the traced ones."""
    traced: Traced = defaultdict(dict)
    shares: dict[tuple[int, str], float] = {}
    for index, frame in enumerate(frames):
        rows: TableRows = {weather: defaultdict(list) for weather in batch.config.weathers}
        sensors = []
        for sensor in batch.config.sensors:
            few, shares[frame, sensor.name] = _thinned(batch, sensor, frame, (index + 0.5) / len(frames))
            sensors.append(few)
        capture_frames(batch, [frame], rows, sensors)
        _collect(batch, frame, rows, traced)
    return traced, shares


def _trace_channel(
    batch: Batch, surfaces: SurfaceTable, count: int, traced: Traced, shares: dict[tuple[int, str], float]
) -> float:
    """Add the rows of the channel in up to so many frames, evenly spread, and return all its frames over these.

    Args:
        batch: The scenario.
        surfaces: Its surfaces.
        count: Most frames to trace.
        traced: Where the rows go.
        shares: Where all links of a frame over the traced ones go.
    """
    config, scenario = batch.config, batch.scenario
    whole = config.frames_of(scenario)
    due = _due(config.channel, range(whole.start, whole.stop), config.frame_rate_of(scenario))
    places = (np.arange(count) + 0.5) / count
    chosen = due[np.unique((places * len(due)).astype(np.int64))] if len(due) else np.array([whole.start])
    is_costly = config.channel.diffraction or config.channel.diffuse_reflection
    for index, frame in enumerate(chosen.tolist()):
        rows: TableRows = {weather: defaultdict(list) for weather in config.weathers}
        batch.scene.load_batch([frame])
        links = channel_links(batch, [frame])
        few = _thinned_links(links, (index + 0.5) / len(chosen)) if is_costly else links
        shares[frame, CHANNEL] = len(links) / max(len(few), 1)
        capture_channel(batch, surfaces, few, rows)
        _collect(batch, frame, rows, traced)
    return len(due) / len(chosen)


def _collect(batch: Batch, frame: int, rows: TableRows, traced: Traced) -> None:
    """Add the rows of a frame to those of all."""
    for weather, tables in rows.items():
        for name, batches in tables.items():
            traced[weather, name][frame] = join_batches(name, batch.scenario.name, weather, batches)


def _thinned_links(links: Links, place: float) -> Links:
    """Return up to `MAX_LINKS` of some links, evenly spread over their list.

    Args:
        links: The links of a frame.
        place: Place of the chosen one among those that it stands for, as a share of their number.
    """
    if len(links) <= MAX_LINKS:
        return links
    return links.take(((np.arange(MAX_LINKS) + place) * (len(links) / MAX_LINKS)).astype(np.int64))


def _thinned(batch: Batch, sensor: SensorConfig, frame: int, place: float) -> tuple[SensorConfig, float]:
    """Return a camera on one of its agents in a frame, that at a share of their list, and how many have it."""
    agents = sample_views(batch.arrays, [frame], sensor).actor
    if spec_of(sensor).kind != "image" or len(agents) < 2:
        return sensor, 1.0
    chosen = batch.arrays.actors[agents[int(place * len(agents))]].name
    return sensor.model_copy(update={"on": (chosen,)}), float(len(agents))


def _ratios(config: Config, scenario: ScenarioConfig, frames: list[int]) -> dict[str, float]:
    """Return samples of all frames over those of the traced ones, by sensor, antenna, of `CHANNEL` and of `FRAMES`."""
    whole, rate_hz = config.frames_of(scenario), config.frame_rate_of(scenario)
    ratio = {FRAMES: whole.count / len(frames)}
    for name, sampling in _samplings(config):
        traced = int(sampling.is_due(frames, rate_hz).sum())
        ratio[name] = len(_due(sampling, range(whole.start, whole.stop), rate_hz)) / traced if traced else 0.0
    if CHANNEL in ratio:  # rows of its antennas beside its tables
        ratio |= {antenna.name: ratio[CHANNEL] for antenna in config.channel.antennas if antenna.name not in ratio}
    return ratio


def _sampled_table(
    name: str,
    weathers: Iterable[Mapping[int, pa.Table]],
    ratio: Mapping[str, float],
    shares: Mapping[tuple[int, str], float],
) -> SampledTable:
    """Return a table that follows from the rows of the traced frames, by frame, of each weather."""
    rows: dict[str, float] = defaultdict(float)
    fixed = size = 0.0
    for tables in weathers:
        count = 0.0
        for frame, table in tables.items():
            for source, found in _sources(name, table).items():
                all_rows = found * ratio.get(source, ratio[FRAMES]) * shares.get((frame, source), 1.0)
                rows[source] += all_rows
                count += all_rows
        shard, each = _file_size(name, tables)
        fixed, size = fixed + shard, size + count * each
    return SampledTable(dict(rows), fixed, size / max(sum(rows.values()), 1.0))


def _sources(name: str, table: pa.Table) -> dict[str, int]:
    """Return what the rows of a table come from, and how many."""
    if SENSOR not in table.column_names:
        return {CHANNEL if name in CHANNEL_TABLES else FRAMES: table.num_rows}
    counts = table.column(SENSOR).cast(pa.string()).value_counts().to_pylist()
    return {count["values"]: count["counts"] for count in counts}


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
