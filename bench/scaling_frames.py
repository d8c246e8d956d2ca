"""Frames of one scenario in which one size grows: vehicles, images, sweeps, rays, links, frames of a batch, weathers.

Batches are traced as in a run, by `make_batch` and `capture_frames`, but nothing is encoded or written: other
threads do that in a run. After a batch that warms up, several are timed; the median counts. A stage ends when the
device has done its part. In one more batch, which is not timed, the device's own work is summed up and its memory is
looked at before every launch.
"""

import gc
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import warp as wp

from bench.camera_views import SCENARIOS, camera_scene
from bench.scaling_towns import device_bytes
from bench.scenes import grid_town, with_vehicles
from mmw.config import Config, load_config
from mmw.core.errors import is_out_of_memory
from mmw.core.timing import StageTimer
from mmw.generation.capture import capture_frames
from mmw.generation.pipeline import make_batch
from mmw.scene.device_scene import instance_actors
from mmw.scene.scene_data import MODEL_NONE, Actor, SceneData, SceneObject
from mmw.sensors.batch import Batch

CONFIGS = Path(__file__).resolve().parent.parent / "configs" / "scenarios"

LOW_M = 2.2
"""Height below which vehicles carry sensors without blocking them [m]."""

CAVS = 3
"""Connected vehicles unless given, as in the paper's scenarios."""


@dataclass(frozen=True)
class FramePoint:
    """One measured point of a curve; everything is for one frame in all its weathers."""

    value: float
    """Value of the quantity that grows."""
    frames: int
    """Frames of a batch; fewer than requested if memory was full."""
    frame_ms: float
    """Median time [ms]."""
    least_ms: float
    most_ms: float
    stages_ms: dict[str, float]
    """Stage -> median time [ms]; see `stage_of`."""
    rays: dict[str, int]
    """Stage -> primary rays."""
    device_ms: float | None
    """Kernels and copies on the device, end to end [ms]; None without a GPU."""
    device_gb: float | None
    """Most device memory in use, whatever for [GB]; None without a GPU."""


class Discarding(ThreadPoolExecutor):
    """A pool that drops its work and reports it as done."""

    def submit(self, *_: Any, **__: Any) -> Future[Any]:  # type: ignore[override]
        """Return a future that holds nothing."""
        future: Future[Any] = Future()
        future.set_result(None)
        return future


class DeviceClock(StageTimer):
    """A clock whose stages end when the device has finished them."""

    def __init__(self, device: str) -> None:
        """Make a clock for a Warp device."""
        super().__init__()
        self._device = device

    @contextmanager
    def stage(self, name: str, rays: int = 0) -> Iterator[None]:
        """Add the time of the enclosed block, and its rays, to a stage."""
        with super().stage(name, rays):
            yield
            wp.synchronize_device(self._device)


def scenario_config(overrides: Sequence[str] = (), weathers: Sequence[str] = ("sunny",)) -> Config:
    """Return the roundabout of Town03 with every sensor.

    Args:
        overrides: As of `mmw.run`.
        weathers: Presets.
    """
    path = CONFIGS / f"{SCENARIOS['town03']}.yaml"
    return load_config(path, [f"weathers=[{', '.join(weathers)}]", *overrides])


def scenario_arrays(name: str, frames: int, vehicles: int, weathers: Sequence[str]) -> SceneData:
    """Return a scene with vehicles and a roadside unit.

    Args:
        name: `grid`, a small procedural town, or a town of `bench.camera_views`.
        frames: Frames from 0 on.
        vehicles: Vehicles of a scenario; the procedural town has 40.
        weathers: Presets.
    """
    if name != "grid":
        return camera_scene(name, frames, vehicles, weathers)
    arrays = with_vehicles(grid_town(2), frames)
    mast = SceneObject(len(arrays.objects), "/Actors/rsu_1", "unlabeled", 0, (), "rsu_1")
    actor = Actor("rsu_1", "rsu", mast.prim_path, MODEL_NONE, mast.object_id, (0, 0, 0), (0, 0, 0), "unlabeled")
    pose = np.broadcast_to(np.array([0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 1.0]), (frames, 1, 7))
    return connected(
        replace(
            arrays, actors=(*arrays.actors, actor), objects=(*arrays.objects, mast),
            poses=np.concatenate([arrays.poses, pose], axis=1),
            materials=dict.fromkeys(weathers, arrays.materials["sunny"]),
        ),
        CAVS,
    )  # fmt: skip


def with_bodies(arrays: SceneData, count: int) -> SceneData:
    """Return a scene of so many vehicles: the connected ones, and those nearest to them.

    Args:
        arrays: A scene with as many.
        count: Vehicles, not fewer than the connected ones; 0 leaves these their sensors without a body.
    """
    cavs = [i for i, actor in enumerate(arrays.actors) if actor.role == "cav"]
    middle = arrays.poses[0, cavs, :3].mean(axis=0)
    others = np.setdiff1d(instance_actors(arrays), cavs)
    nearest = others[np.argsort(np.linalg.norm(arrays.poses[0, others, :3] - middle, axis=1))]
    standing = [i for i, actor in enumerate(arrays.actors) if actor.model == MODEL_NONE]
    chosen = sorted([*standing, *cavs, *nearest[: max(count - len(cavs), 0)].tolist()])
    actors = [arrays.actors[i] for i in chosen]
    if not count:
        actors = [replace(actor, model=MODEL_NONE) for actor in actors]
    return replace(arrays, actors=tuple(actors), poses=arrays.poses[:, chosen])


def connected(arrays: SceneData, count: int) -> SceneData:
    """Return a scene in which the low vehicles nearest to the roadside unit are connected, and no others.

    Args:
        arrays: A scene with a roadside unit.
        count: How many.
    """
    unit = next(i for i, actor in enumerate(arrays.actors) if actor.role == "rsu")
    low = np.array([i for i in instance_actors(arrays) if arrays.actors[i].size[2] <= LOW_M])
    distance = np.linalg.norm(arrays.poses[0, low, :3] - arrays.poses[0, unit, :3], axis=1)
    chosen = set(low[np.argsort(distance)][:count].tolist())
    if len(chosen) < count:
        raise ValueError(f"{count} connected vehicles: the scene has {len(low)} low ones; ask for at most that many")
    roles = {"cav": "vehicle", "vehicle": "vehicle"}
    actors = tuple(
        replace(actor, role="cav" if i in chosen else roles.get(actor.role, actor.role))
        for i, actor in enumerate(arrays.actors)
    )
    return replace(arrays, actors=actors)


def stage_of(stage: str, config: Config) -> str:
    """Return the kind of sensor that a stage of the clock belongs to, `cameras` for all cameras; else its own name."""
    kinds = {sensor.name: sensor.type for sensor in config.sensors}
    found = {kinds.get(name, "") for name in stage.split(", ")}
    if found <= {"rgb", "depth"}:
        return "cameras"
    return found.pop() if len(found) == 1 and found != {""} else stage


class Frames:
    """Measures jobs: one batch to warm up, several that count, one to look at the device."""

    def __init__(self, device: str, rounds: int):
        """Measure on a device.

        Args:
            device: Warp device.
            rounds: Batches that count.
        """
        self.device = device
        self.has_gpu = wp.get_device(device).is_cuda
        self._rounds = rounds
        self._pool = Discarding(1)

    def job(self, config: Config, arrays: SceneData, slots: int) -> Batch:
        """Return a scene on the device with everything that a configuration needs there, kernels apart.

        Args:
            config: The configuration.
            arrays: The scene.
            slots: Frames of a batch at most.
        """
        gc.collect()  # what is gone leaves the device before its memory is looked at
        job = make_batch(config, config.scenarios[0], arrays, self.device, slots, self._pool, StageTimer())
        notes = job.texture_notes()  # textures and skies are made here
        if notes:
            raise ValueError(f"textures: {notes[0]}; a benchmark needs all of them")
        return job

    def measure(self, job: Batch, value: float, frames: int) -> FramePoint:
        """Return one point.

        Args:
            job: What is recorded; other configurations of one scene may be put in by `dataclasses.replace`.
            value: What the curve grows with.
            frames: Frames of a batch; half as many, and so on, if memory is full.

        Raises:
            MemoryError, RuntimeError: If memory is full with one frame.
        """
        try:
            return self._measure(job, value, frames)
        except (MemoryError, RuntimeError) as error:
            if frames == 1 or not is_out_of_memory(error):
                raise
        return self.measure(job, value, frames // 2)

    def _measure(self, job: Batch, value: float, frames: int) -> FramePoint:
        weathers, config = job.config.weathers, job.config
        recorded = config.frames_of(config.scenarios[0]).count
        spent: list[float] = []
        stages: dict[str, list[float]] = defaultdict(list)
        rays: dict[str, int] = {}
        for batch in range(self._rounds + 1):
            clock = DeviceClock(self.device)
            start = time.perf_counter()
            _record(replace(job, clock=clock), _batch(batch, frames, recorded), weathers)
            wp.synchronize_device(self.device)
            if batch == 0:
                continue
            spent.append(1e3 * (time.perf_counter() - start) / frames)
            by_kind: dict[str, float] = defaultdict(float)
            rays = defaultdict(int)
            for name, seconds in clock.seconds.items():
                by_kind[stage_of(name, config)] += 1e3 * seconds / frames
                rays[stage_of(name, config)] += clock.rays[name] // frames
            for name, milliseconds in by_kind.items():
                stages[name].append(milliseconds)
        device_ms, device_gb = self._look(job, _batch(0, frames, recorded))
        return FramePoint(
            value, frames, median(spent), min(spent), max(spent), {name: median(ms) for name, ms in stages.items()},
            {name: count for name, count in rays.items() if count}, device_ms, device_gb,
        )  # fmt: skip

    def _look(self, job: Batch, frames: range) -> tuple[float | None, float | None]:
        """Return the device's own time for a frame [ms], and its peak memory in use [GB]; None without a GPU."""
        if not self.has_gpu:
            return None, None
        peak, launch = 0, wp.launch

        def looked(*args: Any, **options: Any) -> Any:
            nonlocal peak
            peak = max(peak, device_bytes(self.device) or 0)
            return launch(*args, **options)

        wp.launch = looked
        wp.timing_begin(wp.TIMING_ALL)
        try:
            _record(job, frames, job.config.weathers)
        finally:
            activities = wp.timing_end()
            wp.launch = launch
        return sum(activity.elapsed for activity in activities) / len(frames), peak / 1e9


def _batch(number: int, frames: int, recorded: int) -> range:
    """Return the frames of a batch, one after the other and from the start again."""
    first = number * frames % (recorded - frames + 1)
    return range(first, first + frames)


def _record(job: Batch, frames: range, weathers: Sequence[str]) -> None:
    capture_frames(job, frames, {weather: defaultdict(list) for weather in weathers})
