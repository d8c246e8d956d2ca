"""The run: for each scenario, for each shard, for each batch of frames: launch every sensor, collect rows, hand over.

Geometry is traced once a batch; what differs between weathers is evaluated on the hits. Shards are encoded and
written by threads while the device traces the next one.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from mmw.channel.solver import check_channel_materials
from mmw.channel.surface_table import make_surface_table
from mmw.compute.device import device_name
from mmw.config import Config, LidarConfig, ScenarioConfig
from mmw.constants import FRAME_DT
from mmw.kinematics import differentiate
from mmw.mounts import check_mounts
from mmw.notes import notes
from mmw.prepare import prepare_scenario, read_scenario
from mmw.provenance import keep_config, versions
from mmw.recording.channel import record_channel
from mmw.recording.ground_truth import record_ground_truth
from mmw.recording.job import Job, Rows
from mmw.recording.kernels import compiled_ahead
from mmw.recording.sensors import record_sensors
from mmw.report import Clock, Console, closing_summary
from mmw.scene import Scene
from mmw.scene_arrays import SceneArrays
from mmw.tables.columns import sort_rows, table_from_columns
from mmw.tables.manifest import finalize, pending_scenarios, pending_shards, prepare_root
from mmw.tables.rows.common import resolved
from mmw.tables.rows.world import static_rows
from mmw.tables.schemas import table_spec
from mmw.tables.writer import ShardKey, write_scenario, write_shard

SHARDS_IN_FLIGHT = 2
"""Groups of shards (one a weather) that may always wait for the writers; with more threads than weathers, as many as
keep the threads busy. Tracing pauses beyond that, which bounds memory to about 0.5 GB a group."""


def run(config: Config, *, base: Path, device: str, overwrite: bool, console: Console) -> None:
    """Make the dataset of a configuration, or what is missing of it.

    Args:
        config: The configuration.
        base: Folder that relative paths in it start from.
        device: Warp device name.
        overwrite: Replace a dataset that another configuration made.
        console: Where progress goes.

    Raises:
        ValueError: If the folder belongs to another configuration, or a scenario cannot be made or read.
        OutOfSpaceError: If the disk is full; the same command resumes.
    """
    root = Path(config.output.dir)
    made_with = versions(config, base, device)
    prepare_root(root, config.identity(), config.sha256(), made_with, overwrite)
    keep_config(config, base, root)
    meta = {
        "config_sha256": config.sha256(),
        "mmw_version": made_with["mmw"],
        "git_sha": made_with["git"],
        "device": device_name(device),
    }
    keys = {scenario.name: shard_keys(config, scenario) for scenario in config.scenarios}
    pending = {name: pending_shards(root, all_keys) for name, all_keys in keys.items()}
    frames = {name: sum(key.frame_end - key.frame_begin for key in some) for name, some in pending.items()}
    total = config.frame_total
    console.begin(total, total - sum(frames.values()))
    if console.done:
        rest = "making the rest" if console.done < total else "nothing to make"
        console.say(f"{root}: {console.done} of {total} frames are there already; {rest}")
    writers = ThreadPoolExecutor(config.compute.writer_threads, thread_name_prefix="mmw-writer")
    with writers as pool, compiled_ahead(config, device) if any(pending.values()) else nullcontext([]) as kernels:
        try:
            for scenario in config.scenarios:
                some = pending[scenario.name]
                if some or pending_scenarios(root, [scenario.name]):
                    _run_scenario(config, scenario, base, root, device, some, pool, kernels, meta, console)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    with console.clock.stage("manifest"):
        result = finalize(root)
    console.summary(closing_summary(root, config, device_name(device), result, console.clock, sum(frames.values())))


def shard_keys(config: Config, scenario: ScenarioConfig) -> list[ShardKey]:
    """Return all shards of a scenario: weathers x pieces of `output.shard_frames` frames."""
    step, frames = config.output.shard_frames, config.frames_of(scenario)
    return [
        ShardKey(scenario.name, weather, begin, min(begin + step, frames.stop))
        for begin in range(frames.start, frames.stop, step)
        for weather in config.weathers
    ]


def _run_scenario(
    config: Config,
    scenario: ScenarioConfig,
    base: Path,
    root: Path,
    device: str,
    pending: Sequence[ShardKey],
    pool: ThreadPoolExecutor,
    kernels: Sequence[Future[None]],
    meta: dict[str, Any],
    console: Console,
) -> None:
    clock = console.clock
    with clock.stage("traffic and stage"):
        stage = prepare_scenario(config, scenario, base, root)
    with clock.stage("scene"):
        arrays = read_scenario(config, scenario, stage)
        for line in notes(arrays, config, scenario):
            console.warn_once(line)
        write_scenario(root, scenario.name, static_rows(arrays, config, scenario), meta)
        if not pending:
            return
    with clock.stage("kernels"):
        for kernel in kernels:
            kernel.result()
    with clock.stage("scene"):
        slots = min(config.compute.batch_frames, config.output.shard_frames)
        job = make_job(config, scenario, arrays, device, slots, pool, clock)
    for line in job.texture_notes():
        console.warn_once(line)
    writing: list[list[Future[Any]]] = []
    for begin, end, weathers in _groups(pending):
        collected = _trace_shard(job, begin, end, weathers, console)
        writing.append(
            [
                pool.submit(_write, root, ShardKey(scenario.name, weather, begin, end), collected[weather], meta)
                for weather in weathers
            ]
        )
        while len(writing) > max(SHARDS_IN_FLIGHT, config.compute.writer_threads // len(config.weathers)):
            _wait(writing.pop(0), clock)
    for group in writing:
        _wait(group, clock)


def make_job(
    config: Config,
    scenario: ScenarioConfig,
    arrays: SceneArrays,
    device: str,
    slots: int,
    pool: ThreadPoolExecutor,
    clock: Clock,
    *,
    with_channel: bool = True,
) -> Job:
    """Return a scenario on the device, ready for `record_frames`.

    Args:
        config: The configuration.
        scenario: One of its scenarios.
        arrays: The scenario's arrays.
        device: Warp device name.
        slots: Frames of a batch at most.
        pool: Threads that encode.
        clock: Where the time of each stage is summed up.
        with_channel: False leaves the radio channel out, whatever the configuration says.

    Raises:
        ValueError: If a sensor is inside something, or a material is not known to the channel.
    """
    sweeps = any(isinstance(sensor, LidarConfig) and sensor.rolling for sensor in config.sensors)
    scene = Scene(arrays, device, max_slots=slots, sweep_s=FRAME_DT if sweeps else 0.0)
    check_mounts(scene, config)
    surfaces = None
    if config.channel.enabled and with_channel:
        surfaces = make_surface_table(
            scene, wedges=config.channel.diffraction, sheets=config.channel.diffraction_sheets
        )
        check_channel_materials(arrays.materials, np.unique(surfaces.material_id), config.channel)
    return Job(config, scenario, arrays, differentiate(arrays.poses), scene, surfaces, pool, clock)


def _groups(pending: Sequence[ShardKey]) -> Iterator[tuple[int, int, list[str]]]:
    """Yield pending shards of the same frames together, so that they are traced once for all their weathers."""
    by_frames: dict[tuple[int, int], list[str]] = defaultdict(list)
    for key in pending:
        by_frames[key.frame_begin, key.frame_end].append(key.weather)
    for (begin, end), weathers in by_frames.items():
        yield begin, end, weathers


def _wait(group: list[Future[Any]], clock: Clock) -> None:
    with clock.stage("waiting for writers"):
        for future in group:
            future.result()


def _trace_shard(job: Job, begin: int, end: int, weathers: Sequence[str], console: Console) -> Rows:
    """Trace the frames of a shard in batches and return their rows in every weather."""
    collected: Rows = {weather: defaultdict(list) for weather in weathers}
    step = job.scene.max_slots
    for first in range(begin, end, step):
        frames = range(first, min(first + step, end))
        record_frames(job, frames, collected)
        console.advance(len(frames) * len(weathers), job.scenario.name)
    return collected


def record_frames(job: Job, frames: Sequence[int], collected: Rows) -> None:
    """Trace one batch of frames and add its rows in every weather of `collected`."""
    with job.clock.stage("batch set-up"):
        job.scene.load_batch(frames)
    record_ground_truth(job, frames, collected)
    record_sensors(job, frames, collected)
    if job.surfaces is not None:
        record_channel(job, job.surfaces, frames, collected)


def _write(root: Path, key: ShardKey, tables: dict[str, list[Any]], meta: dict[str, Any]) -> None:
    """Turn the batches of a shard into Arrow tables and publish them. Runs in a writer thread."""
    ready = {name: join_batches(name, key.scenario, key.weather, batches) for name, batches in tables.items()}
    write_shard(root, key, ready, meta)


def join_batches(name: str, scenario: str, weather: str, batches: Sequence[Any]) -> pa.Table:
    """Return the batches of a table as one Arrow table, sorted by its key.

    Args:
        name: Table name.
        scenario: Scenario of the rows.
        weather: Weather of the rows.
        batches: Columns of each batch, or the future of them; at least one.
    """
    ended = [columns.result() if isinstance(columns, Future) else columns for columns in batches]
    fixed = {"scenario": scenario, "weather": weather}
    parts = [table_from_columns(name, {**fixed, **resolved(columns)}) for columns in ended]
    return sort_rows(table_spec(name), pa.concat_tables(parts).unify_dictionaries().combine_chunks())
