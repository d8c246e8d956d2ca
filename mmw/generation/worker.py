"""Make shards: one device holds a scenario, and threads encode and write its rows."""

import logging
import pickle
import time
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import Any

from mmw.config import Config, ScenarioConfig
from mmw.config.sensor_spec import spec_of
from mmw.core.cuda import keep_memory, wait_asleep
from mmw.core.device import GPU_BYTES_A_WORKER, machine_kind
from mmw.core.registry import load_reference
from mmw.core.temp_files import Owner
from mmw.generation.configuration_warnings import notes
from mmw.generation.pipeline import join_batches, make_job, trace_work
from mmw.generation.precompile import compiled_ahead
from mmw.generation.progress import Reporter
from mmw.generation.shards import Work
from mmw.scene.prepare import cached_stage, read_scenario
from mmw.scene.rows import static_rows
from mmw.scene.scene_data import SceneData
from mmw.sensors.batch import Batch, TableRows
from mmw.storage.atomic_files import write_bytes_atomically
from mmw.storage.lock import only_one
from mmw.storage.manifest import pending_scenarios
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
    log_level: int = field(default_factory=lambda: logging.getLogger("mmw").getEffectiveLevel())
    """Lowest level of log records that workers send to the run."""

    def shared_name(self, scenario: str) -> str:
        """Return the name in `root.folder` of what the first worker of this run has read of a scenario."""
        return f".{scenario}.{replace(self.owner, worker=None)}.tmp.scene"

    def for_worker(self, number: int) -> "GenerationContext":
        """Return the same for one of the run's workers."""
        return replace(self, owner=replace(self.owner, worker=number))


class Worker:
    """Makes shards on one device. Tracing goes on while threads write what was traced before.

    A scenario stays on the device until work of another one comes.
    """

    def __init__(self, making: GenerationContext, device: str, reporter: Reporter):
        """Start the threads.

        Args:
            making: What is made.
            device: Warp device name.
            reporter: Where progress goes.
        """
        if not wait_asleep(device):
            reporter.warn_once(f"threads that wait for {device} keep a core busy: its driver does not let them sleep")
        keep_memory(device, GPU_BYTES_A_WORKER)
        self._making = making
        self._device = device
        self._meta = {**making.meta, "device": machine_kind(device)}
        self._reporter = reporter
        self._pool = ThreadPoolExecutor(making.threads, thread_name_prefix="mmw-writer")
        self._scenarios = {scenario.name: scenario for scenario in making.config.scenarios}
        self._job: Batch | None = None
        self._current = ""
        self._batch_frames = 0
        self._writing: list[list[Future[None]]] = []
        self._compiling = ExitStack()
        self._kernels: list[Future[None]] = []
        self._skies: list[Future[None]] = []
        self._shared: list[Path] = []

    def __enter__(self) -> "Worker":
        """Begin to compile what the configuration needs, and to make its skies."""
        config = self._making.config
        self._kernels = self._compiling.enter_context(compiled_ahead(config, self._device))
        ahead = dict.fromkeys(spec_of(sensor).warm_up for sensor in config.sensors)
        self._skies = [self._pool.submit(load_reference(work), config) for work in ahead if work]
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._compiling.close()
        for path in self._shared:
            path.unlink(missing_ok=True)
        self._pool.shutdown(cancel_futures=kind is not None)

    def make(self, work: Work) -> None:
        """Trace a piece of work and hand it to the writers; what came long before it is on the disk then.

        Raises:
            InputError: If the scenario cannot be made or read.
            OutOfSpaceError: If the disk is full.
            StoreError: If a store cannot be reached or refuses.
        """
        scenario = self._scenarios[work.scenario]
        if self._current != work.scenario:
            self._job = None  # the device has room for one
            self._job = self._load(scenario, with_job=bool(work.weathers))
            self._current = work.scenario if self._job is not None else ""
            self._batch_frames = self._job.scene.max_slots if self._job is not None else 0
        if self._job is None or not work.weathers:
            return
        shards = {key.weather: ShardWriter(self._making.root, key, self._meta) for key in work.keys}
        ends: dict[str, Future[None]] = {}
        begin = time.perf_counter()

        def on_batch(frames: range, rows: TableRows) -> None:
            for weather, tables in rows.items():
                ends[weather] = self._pool.submit(_add, shards[weather], frames, tables, ends.get(weather))
            self._queue(list(ends.values()))

        self._batch_frames = trace_work(self._job, work, self._batch_frames, self._reporter, on_batch)
        self._queue([self._pool.submit(_close, shards[name], begin, end) for name, end in ends.items()])

    def finish(self) -> None:
        """Wait until everything is on the disk."""
        while self._writing:
            self._wait(self._writing.pop(0))

    def _load(self, scenario: ScenarioConfig, *, with_job: bool) -> Batch | None:
        """Write a scenario's static tables; return it on the device if anything is traced."""
        making, clock = self._making, self._reporter.clock
        with clock.stage("traffic and stage"), only_one(making.root.folder, f"stage-{scenario.name}"):
            stage = cached_stage(making.config, scenario, making.base, making.root)
        with clock.stage("scene"):
            arrays = self._read(scenario, stage)
            for line in notes(arrays, making.config, scenario):
                self._reporter.warn_once(line)
            if pending_scenarios(making.root, [scenario.name]):
                write_scenario(making.root, scenario.name, static_rows(arrays, making.config, scenario), self._meta)
        if not with_job:
            return None
        with clock.stage("kernels"):
            for kernel in self._kernels:
                kernel.result()
        for skies in self._skies:
            with clock.stage("textures and skies"):
                skies.result()
        with clock.stage("scene"):
            slots = min(making.config.compute.batch_frames, making.config.output.shard_frames)
            job = make_job(making.config, scenario, arrays, self._device, slots, self._pool, clock)
        for line in job.texture_notes():
            self._reporter.warn_once(line)
        return job

    def _read(self, scenario: ScenarioConfig, stage: Path) -> SceneData:
        """Return a scenario's arrays: the first worker of a run reads the stage, the others what it has read.

        A town of 280,000 triangles takes 7 s of a core to read from its stage, and 0.03 s from the first one's file.
        """
        folder = self._making.root.folder
        path = folder / self._making.shared_name(scenario.name)
        with only_one(folder, f"scene-{scenario.name}"):
            if path.is_file():
                return pickle.loads(path.read_bytes())
            arrays = read_scenario(self._making.config, scenario, stage)
            write_bytes_atomically(path, pickle.dumps(arrays, pickle.HIGHEST_PROTOCOL))
            self._shared.append(path)
        return arrays

    def _queue(self, group: list[Future[None]]) -> None:
        """Let writers go on beside the tracing, but not far behind it."""
        self._writing.append(group)
        while len(self._writing) > BATCHES_IN_FLIGHT:
            self._wait(self._writing.pop(0))

    def _wait(self, group: list[Future[None]]) -> None:
        with self._reporter.clock.stage("waiting for writers"):
            for future in group:
                future.result()


def _add(shard: ShardWriter, frames: range, tables: dict[str, list[Any]], before: Future[None] | None) -> None:
    """Encode the rows of a batch, after those of the batch before. Runs in a writer thread.

    Threads take what was queued first, so the batch before is done or being done.
    """
    key = shard.key
    ready = {name: join_batches(name, key.scenario, key.weather, batches) for name, batches in tables.items()}
    if before:
        before.result()
    shard.add(ready, frames.stop)


def _close(shard: ShardWriter, begin: float, before: Future[None]) -> None:
    """Publish a shard after its last batch. Runs in a writer thread."""
    before.result()
    shard.close(time.perf_counter() - begin)
