"""Trace shards on one device, while threads encode and write rows that were traced before."""

import logging
import pickle
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mmw.config import Config, ScenarioConfig
from mmw.core.cuda import retain_memory, use_blocking_sync
from mmw.core.device import GPU_BYTES_PER_WORKER, machine_kind, start_warp
from mmw.core.errors import InputError
from mmw.core.temp_files import Owner
from mmw.generation.configuration_warnings import configuration_warnings, surface_warnings
from mmw.generation.pipeline import join_batches, make_batch, trace_work
from mmw.generation.precompile import compiled_ahead, warm_up
from mmw.generation.progress import Reporter
from mmw.generation.shards import Work
from mmw.scene.prepare import cached_stage, read_scenario
from mmw.scene.rows import actor_presence, static_rows
from mmw.scene.scene_data import SceneData
from mmw.sensors.batch import Batch, TableRows
from mmw.storage.atomic_files import write_bytes_atomically
from mmw.storage.lock import exclusive_lock
from mmw.storage.manifest import pending_scenarios
from mmw.storage.schemas import table_spec
from mmw.storage.shard_writer import ShardWriter, write_scenario
from mmw.storage.store import Store

BATCHES_IN_FLIGHT = 2
"""Batches that may wait for the writers. Tracing pauses beyond that, which bounds memory: 50 frames of the paper's
sensors are 0.5 GB without their images, which `mmw.sensors.image_encoder` bounds."""


@dataclass(frozen=True)
class GenerationContext:
    """Settings that all workers of a dataset share."""

    config: Config
    base: Path
    """Folder that relative paths in the configuration start from."""
    root: Store
    """Root of the dataset."""
    meta: Mapping[str, Any]
    """Content of every marker besides the worker's device; see `write_shard`."""
    threads: int
    """Threads of each worker that encode and write."""
    owner: Owner = field(default_factory=Owner)
    """Mark of this run, or of one of its workers, in the names of unfinished files."""
    inputs: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """Hashes of the input files, see `mmw.scene.input_files`."""
    machines: tuple[str, ...] | None = None
    """Kinds of machine that may make shards; None for any."""
    log_level: int = field(default_factory=lambda: logging.getLogger("mmw").getEffectiveLevel())
    """Lowest level of log records that workers send to the run."""

    def shared_name(self, scenario: str) -> str:
        """Return the name in `root.folder` of the arrays that the first worker of this run has read of a scenario."""
        return f".{scenario}.{replace(self.owner, worker=None)}.tmp.scene"

    def for_worker(self, number: int) -> "GenerationContext":
        """Return the context of one of the run's workers."""
        return replace(self, owner=replace(self.owner, worker=number))


class Worker:
    """Generates shards on one device; a scenario stays on the device until work of another one comes."""

    def __init__(self, context: GenerationContext, device: str, reporter: Reporter):
        """Start the threads.

        Raises:
            InputError: If the device is of a kind that may not make shards.
        """
        start_warp()
        if not use_blocking_sync(device):
            reporter.warn_once(f"threads that wait for {device} keep a core busy: its driver does not let them sleep")
        retain_memory(device, GPU_BYTES_PER_WORKER)
        self._context = context
        self._device = device
        kind = machine_kind(device)
        if context.machines is not None and kind not in context.machines:
            raise InputError(
                f"{device}: is another kind of machine than the dataset has: {'; '.join(context.machines)} -> {kind}, "
                "between which last bits may differ (docs/concepts/determinism.md); use one kind, or --accept machine"
            )
        self._meta = {**context.meta, "device": kind}
        self._reporter = reporter
        self._pool = ThreadPoolExecutor(context.threads, thread_name_prefix="mmw-writer")
        self._scenarios = {scenario.name: scenario for scenario in context.config.scenarios}
        self._batch: Batch | None = None
        self._current = ""
        self._batch_frames = 0
        self._writing: list[list[Future[None]]] = []
        self._compiling = ExitStack()
        self._kernels: list[Future[None]] = []
        self._skies: list[Future[None]] = []
        self._shared: list[Path] = []

    def __enter__(self) -> "Worker":
        """Begin to compile kernels and to prepare skies in threads."""
        config = self._context.config
        self._kernels = self._compiling.enter_context(compiled_ahead(config, self._device))
        self._skies = warm_up(config, self._pool)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._compiling.close()
        for path in self._shared:
            with suppress(OSError):  # keep the error that ended the work, if any; the end of the run removes it too
                path.unlink(missing_ok=True)
        self._pool.shutdown(cancel_futures=kind is not None)

    def trace(self, work: Work) -> None:
        """Trace a piece of work and queue its rows for the writers.

        Raises:
            InputError: If the scenario cannot be prepared or read.
            OutOfSpaceError: If the disk is full.
            StoreError: If a store cannot be reached or refuses.
        """
        scenario = self._scenarios[work.scenario]
        if self._current != work.scenario:
            self._batch = None  # the device has room for one
            self._batch = self._load(scenario, on_device=bool(work.weathers))
            self._current = work.scenario if self._batch is not None else ""
            self._batch_frames = self._batch.scene.max_batch_frames if self._batch is not None else 0
        if self._batch is None or not work.weathers:
            return
        shards = {key.weather: ShardWriter(self._context.root, key, self._meta_of(scenario)) for key in work.keys}
        ends: dict[str, Future[None]] = {}
        begin = time.perf_counter()

        def on_rows(frames: range, rows: TableRows) -> None:
            for weather, tables in rows.items():
                if weather != self._context.config.weathers[0]:  # its shard has what is the same in all
                    tables = {name: batches for name, batches in tables.items() if table_spec(name).by_weather}
                ends[weather] = self._pool.submit(_add, shards[weather], frames, tables, ends.get(weather))
            self._queue(list(ends.values()))

        self._batch_frames = trace_work(self._batch, work, self._batch_frames, self._reporter, on_rows)
        closed: list[Future[None]] = []
        for name, end in ends.items():  # the first weather's comes before others: it has what is the same in all
            closed.append(self._pool.submit(_close, shards[name], begin, [end, *closed[:1]]))
        self._queue(closed)

    def _meta_of(self, scenario: ScenarioConfig) -> dict[str, Any]:
        return {**self._meta, "frame_rate_hz": self._context.config.frame_rate_of(scenario)}

    def finish(self) -> None:
        """Wait until everything is on the disk."""
        while self._writing:
            self._wait(self._writing.pop(0))

    def _load(self, scenario: ScenarioConfig, *, on_device: bool) -> Batch | None:
        """Write a scenario's static tables, and load the scenario onto the device if `on_device`."""
        context, timer = self._context, self._reporter.timer
        with timer.stage("traffic and stage"), exclusive_lock(context.root.folder, f"stage-{scenario.name}"):
            inputs = context.inputs.get(scenario.name, {})
            stage = cached_stage(context.config, scenario, context.base, context.root, inputs, self._reporter.warn_once)
        with timer.stage("scene"):
            arrays = self._read(scenario, stage)
            notes = list(configuration_warnings(arrays, context.config, scenario))
            for line in notes:
                self._reporter.warn_once(line)
            if pending_scenarios(context.root, [scenario.name]):
                frames = context.config.frames_of(scenario)
                actors = actor_presence(arrays, range(frames.start, frames.stop))
                rows = static_rows(arrays, context.config)
                write_scenario(context.root, scenario.name, rows, self._meta_of(scenario), actors, notes)
        if not on_device:
            return None
        with timer.stage("kernels"):
            for kernel in self._kernels:
                kernel.result()
        for skies in self._skies:
            with timer.stage("textures and skies"):
                skies.result()
        with timer.stage("scene"):
            max_frames = min(context.config.compute.batch_frames, context.config.output.shard_frames)
            batch = make_batch(context.config, scenario, arrays, self._device, max_frames, self._pool, timer)
        for line in (*surface_warnings(batch.surfaces), *batch.texture_notes()):
            self._reporter.warn_once(line)
        return batch

    def _read(self, scenario: ScenarioConfig, stage: Path) -> SceneData:
        """Return a scenario's arrays: the first worker of a run reads the stage, the others read its pickled arrays.

        A town of 280,000 triangles takes 7 s of a core to read from its stage, and 0.03 s from the pickle.
        """
        folder = self._context.root.folder
        path = folder / self._context.shared_name(scenario.name)
        with exclusive_lock(folder, f"scene-{scenario.name}"):
            if path.is_file():
                return pickle.loads(path.read_bytes())
            arrays = read_scenario(self._context.config, scenario, stage)
            write_bytes_atomically(path, pickle.dumps(arrays, pickle.HIGHEST_PROTOCOL))
            self._shared.append(path)
        return arrays

    def _queue(self, group: list[Future[None]]) -> None:
        """Queue writes, and wait for those of earlier batches if too many are unfinished."""
        self._writing.append(group)
        while len(self._writing) > BATCHES_IN_FLIGHT:
            self._wait(self._writing.pop(0))

    def _wait(self, group: list[Future[None]]) -> None:
        with self._reporter.timer.stage("waiting for writers"):
            for future in group:
                future.result()


def _add(shard: ShardWriter, frames: range, tables: dict[str, list[Any]], previous: Future[None] | None) -> None:
    """Encode the rows of a batch in a writer thread, and append them after those of the previous batch."""
    key = shard.key
    ready = {name: join_batches(name, key.scenario, key.weather, batches) for name, batches in tables.items()}
    if previous:
        previous.result()
    shard.add(ready, frames.stop)


def _close(shard: ShardWriter, begin: float, previous: Sequence[Future[None]]) -> None:
    """Write a shard after its last batch and other shards, in a writer thread."""
    for before in previous:
        before.result()
    shard.close(time.perf_counter() - begin)
