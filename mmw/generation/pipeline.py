"""Frames through a scenario on the device: each batch of frames is loaded, every sensor launched, its rows collected.

Geometry is traced once a batch; what differs between weathers is evaluated on the hits.
"""

from collections import defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
import pyarrow as pa

from mmw.channel.path_solver.solver import check_channel_materials
from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.config import Config, ScenarioConfig
from mmw.config.sensor_spec import spec_of
from mmw.core.kinematics import differentiate
from mmw.core.timing import StageTimer
from mmw.generation.progress import Reporter
from mmw.generation.recorders.channel import record_channel
from mmw.generation.recorders.ground_truth import record_ground_truth
from mmw.generation.recorders.sensors import record_sensors
from mmw.generation.shards import Work
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import resolved
from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.mount_checks import check_mounts
from mmw.storage.arrow_tables import sort_rows, unsorted_table
from mmw.storage.schemas import table_spec

OUT_OF_MEMORY = "Failed to allocate"
"""How Warp's error about a full device or host begins."""


def make_job(
    config: Config,
    scenario: ScenarioConfig,
    arrays: SceneData,
    device: str,
    slots: int,
    pool: ThreadPoolExecutor,
    clock: StageTimer,
    *,
    with_channel: bool = True,
) -> Batch:
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
        InputError: If a sensor is inside something, or a material is not known to the channel.
    """
    sweep_s = max((spec_of(sensor).sweep_s(sensor) for sensor in config.sensors), default=0.0)
    scene = DeviceScene(arrays, device, max_slots=slots, sweep_s=sweep_s)
    check_mounts(scene, config)
    surfaces = None
    if config.channel.enabled and with_channel:
        surfaces = make_surface_table(
            scene, wedges=config.channel.diffraction, sheets=config.channel.diffraction_sheets
        )
        check_channel_materials(arrays.materials, np.unique(surfaces.material_id), config.channel)
    return Batch(config, scenario, arrays, differentiate(arrays.poses), scene, surfaces, pool, clock)


def trace_work(
    job: Batch, work: Work, most_frames: int, reporter: Reporter, on_batch: Callable[[range, TableRows], None]
) -> int:
    """Trace the frames of some shards in batches.

    A batch that finds the memory full is done again in halves, and so are those after it.

    Args:
        job: The scenario on the device.
        work: The shards.
        most_frames: Frames of a batch.
        reporter: Where progress goes.
        on_batch: Takes the frames of each batch and its rows in every weather, in the order of the frames.

    Returns:
        The frames of a batch that fit.

    Raises:
        MemoryError, RuntimeError: If the memory is full with a single frame.
    """
    step, first = most_frames, work.frame_begin
    while first < work.frame_end:
        frames = range(first, min(first + step, work.frame_end))
        batch = _trace_batch(job, frames, work.weathers)
        if batch is None:
            step = len(frames) // 2
            reporter.warn_once(f"memory is full with {len(frames)} frames a launch; going on with {step}")
            continue
        on_batch(frames, batch)
        first = frames.stop
        reporter.advance(len(frames) * len(work.weathers), work.scenario)
    return step


def _trace_batch(job: Batch, frames: Sequence[int], weathers: Sequence[str]) -> TableRows | None:
    """Return the rows of a batch; None if the memory was full and fewer frames may fit."""
    collected: TableRows = {weather: defaultdict(list) for weather in weathers}
    try:
        record_frames(job, frames, collected)
    except (MemoryError, RuntimeError) as error:
        if len(frames) == 1 or not is_out_of_memory(error):
            raise
        return None
    return collected


def is_out_of_memory(error: BaseException) -> bool:
    """Return whether an error says that the memory of a device or the host is full."""
    return isinstance(error, MemoryError) or (isinstance(error, RuntimeError) and OUT_OF_MEMORY in str(error))


def record_frames(job: Batch, frames: Sequence[int], collected: TableRows) -> None:
    """Trace one batch of frames and add its rows in every weather of `collected`."""
    with job.clock.stage("batch set-up"):
        job.scene.load_batch(frames)
    record_ground_truth(job, frames, collected)
    record_sensors(job, frames, collected)
    if job.surfaces is not None:
        record_channel(job, job.surfaces, frames, collected)


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
    parts = [unsorted_table(name, {**fixed, **resolved(columns)}) for columns in ended]
    whole = parts[0] if len(parts) == 1 else pa.concat_tables(parts).unify_dictionaries().combine_chunks()
    return sort_rows(table_spec(name), whole)
