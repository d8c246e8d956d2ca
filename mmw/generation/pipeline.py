"""Trace a scenario batch by batch: load frames, capture every sensor, collect the rows.

Geometry is traced once a batch; what differs between weathers is evaluated on the hits.
"""

from collections import defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import pyarrow as pa

from mmw.channel.path_solver.solver import check_channel_materials
from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.config import Config, ScenarioConfig
from mmw.config.sensor_spec import spec_of
from mmw.core.errors import is_out_of_memory
from mmw.core.kinematics import differentiate
from mmw.core.later import Waiting
from mmw.core.timing import StageTimer
from mmw.generation.capture import capture_frames
from mmw.generation.progress import Reporter
from mmw.generation.shards import Work
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import resolved
from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.mount_checks import check_mounts
from mmw.storage.arrow_tables import sort_rows, unsorted_table
from mmw.storage.schemas import table_spec

T = TypeVar("T")


def make_batch(
    config: Config,
    scenario: ScenarioConfig,
    arrays: SceneData,
    device: str,
    max_frames: int,
    pool: ThreadPoolExecutor,
    timer: StageTimer,
    *,
    with_channel: bool = True,
) -> Batch:
    """Load a scenario onto the device, ready for `capture_frames`.

    Raises:
        InputError: If a sensor is inside something, or a material is not known to the channel.
    """
    sweep_s = max((spec_of(sensor).sweep_s(sensor) for sensor in config.sensors), default=0.0)
    scene = DeviceScene(arrays, device, max_batch_frames=max_frames, sweep_s=sweep_s)
    check_mounts(scene, config)
    surfaces = None
    if config.channel.enabled and with_channel:
        surfaces = make_surface_table(scene, **config.channel.surface_options)
        check_channel_materials(arrays.materials, surfaces.used_materials, config.channel)
    return Batch(config, scenario, arrays, differentiate(arrays.poses, arrays.pose_dt), scene, surfaces, pool, timer)


def launch_in_parts(
    items: range,
    step: int,
    make: Callable[[range], T],
    on_made: Callable[[range, T], None],
    on_full: Callable[[int, int], None],
) -> int:
    """Make something of items in parts, in order, and halve the parts where memory is full.

    Args:
        items: Numbers of the items.
        step: Items of a part at most.
        make: Makes a part.
        on_made: Takes each part and what was made of it.
        on_full: Takes the items of a part that did not fit, and those of the next ones.

    Returns:
        The items of a part that fit.

    Raises:
        MemoryError, RuntimeError: If the memory is full with a single item.
    """
    first = items.start
    while first < items.stop:
        some = range(first, min(first + step, items.stop))
        try:
            made = make(some)
        except (MemoryError, RuntimeError) as error:
            if len(some) == 1 or not is_out_of_memory(error):
                raise
            step = len(some) // 2
            on_full(len(some), step)
            continue
        on_made(some, made)
        first = some.stop
    return step


def trace_work(
    batch: Batch, work: Work, max_frames: int, reporter: Reporter, on_rows: Callable[[range, TableRows], None]
) -> int:
    """Trace the frames of some shards in batches, in order, and halve the batches where memory is full.

    Returns:
        The frames of a batch that fit.

    Raises:
        MemoryError, RuntimeError: If the memory is full with a single frame.
    """

    def trace(frames: range) -> TableRows:
        rows: TableRows = {weather: defaultdict(list) for weather in work.weathers}
        capture_frames(batch, frames, rows)
        return rows

    def hand_on(frames: range, rows: TableRows) -> None:
        on_rows(frames, rows)
        reporter.advance(len(frames) * len(work.weathers), work.scenario)

    def report(count: int, step: int) -> None:
        reporter.warn_once(f"memory is full with {count} frames a launch; going on with {step}")

    return launch_in_parts(range(work.frame_begin, work.frame_end), max_frames, trace, hand_on, report)


def join_batches(name: str, scenario: str, weather: str, batches: Sequence[Any]) -> pa.Table:
    """Return the batches of a table as one Arrow table, sorted by its key."""
    spec, ended = (
        table_spec(name),
        [columns.result() if isinstance(columns, Waiting) else columns for columns in batches],
    )
    fixed = {"scenario": scenario, **({"weather": weather} if spec.by_weather else {})}
    parts = [unsorted_table(name, {**fixed, **resolved(columns)}) for columns in ended]
    whole = parts[0] if len(parts) == 1 else pa.concat_tables(parts).unify_dictionaries().combine_chunks()
    return sort_rows(spec, whole)
