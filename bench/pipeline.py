"""Measure whole runs: `python -m bench.pipeline --device cuda:0 --scenarios town03_roundabout --out FOLDER`.

A run as `python -m mmw.run` makes it, files on disk, from an empty folder: the seconds of every stage as the run's own
clock has them, scenario-weather-frames and rays a second, the share of the time in which the GPU had work and in which
the processor's cores had, the largest memory of both, and how long the whole of a configuration would take.

Stages of the tracing thread add up to the wall time; encoding and writing happen beside it, and show where it waits for
them. A projection takes set-up once a scenario, and all frames at the speed between set-up and end.
"""

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import mean, median
from typing import TYPE_CHECKING

from mmw.config import Config, config_path, load_config
from mmw.generation.executors.process_pool import CAN_FORK, may_use_processes, start_server

if TYPE_CHECKING:
    from mmw.generation.executors.executor import Executor


SAMPLE_S = 0.2
"""Time between two looks at the GPU and the cores [s]."""

PROCESSOR_TIMES = Path("/proc/stat")
"""File in which Linux counts the time of its cores."""


@dataclass(frozen=True)
class Busy:
    """Shares of the time in which something worked."""

    mean: float
    """After set-up."""
    median: float
    """Median of the share after set-up: the last pieces, which not all workers share, count less."""
    whole: float
    """Mean with set-up."""

    def __str__(self) -> str:
        return (
            f"busy {100 * self.mean:.0f} % (half of the time {100 * self.median:.0f} % and more; "
            f"{100 * self.whole:.0f} % with set-up)"
        )


@dataclass(frozen=True)
class Result:
    """One measured run."""

    scenarios: list[str]
    weathers: list[str]
    workers: int
    frames: int
    """Scenario-weather-frames."""
    seconds: float
    set_up_s: float
    """The part of it that runs once per scenario, divided by the workers."""
    seconds_per_frame: float
    frames_per_s: float
    rays_per_s: float
    stages: dict[str, float]
    """Stage -> seconds, summed up over the workers."""
    rows: int
    bytes: int
    gpu_busy: Busy | None
    """Times with running kernels, as `nvidia-smi` samples them; None without a GPU."""
    cores_busy: Busy | None
    """Times with busy cores, as Linux counts them; None elsewhere."""
    processor_s: float
    """Processor seconds of the run, its workers included."""
    host_gb: float
    """Largest memory of a process [GB]."""
    device_gb: float | None
    """Largest memory in use on a GPU [GB]."""
    projected_s: float
    """Projected seconds of the whole configuration."""


@dataclass
class Load:
    """Samples of the load of the first GPU and of all cores, and of the GPU's memory, while a block runs."""

    on_gpu: bool
    """True if a GPU traces; otherwise none is sampled."""
    gpu: list[tuple[float, float]] = field(default_factory=list)
    """Time and share of it that kernels ran."""
    cores: list[tuple[float, float]] = field(default_factory=list)
    """Time and share of it that cores worked."""
    memory_gb: float = 0.0
    _process: subprocess.Popen[str] | None = None
    _ended: threading.Event = field(default_factory=threading.Event)

    def __enter__(self) -> "Load":
        """Start to look."""
        if self.on_gpu:
            query = ["--query-gpu=utilization.gpu,memory.used", "--format=csv,noheader,nounits", "--id=0"]
            self._process = subprocess.Popen(
                ["nvidia-smi", *query, f"--loop-ms={int(1000 * SAMPLE_S)}"], stdout=subprocess.PIPE, text=True
            )
            threading.Thread(target=self._look, daemon=True).start()
        if PROCESSOR_TIMES.exists():
            threading.Thread(target=self._look_at_cores, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop."""
        self._ended.set()
        if self._process:
            self._process.kill()

    def _look(self) -> None:
        assert self._process and self._process.stdout
        for line in self._process.stdout:
            load, used = line.split(",")
            self.gpu.append((time.perf_counter(), float(load) / 100.0))
            self.memory_gb = max(self.memory_gb, float(used) * 2**20 / 1e9)

    def _look_at_cores(self) -> None:
        before = _processor_times()
        while not self._ended.wait(SAMPLE_S):
            now = _processor_times()
            total, idle = now[0] - before[0], now[1] - before[1]
            if total:
                self.cores.append((time.perf_counter(), 1.0 - idle / total))
            before = now


def _processor_times() -> tuple[int, int]:
    """Return all and the idle ticks of all cores since the machine started; `proc_stat(5)`."""
    ticks = [int(word) for word in PROCESSOR_TIMES.read_text().splitlines()[0].split()[1:9]]
    return sum(ticks), ticks[3] + ticks[4]


def _busy(samples: list[tuple[float, float]], start: float, steady: float, end: float) -> Busy | None:
    """Return the shares between two times, of which set-up is the first up to `steady`; None without samples."""
    whole = [load for at, load in samples if start <= at <= end]
    some = [load for at, load in samples if steady <= at <= end]
    return Busy(mean(some), median(some), mean(whole)) if some else None


def measure(config: Config, whole: Config, base: Path, executor: "Executor") -> Result:
    """Make a dataset and return what it took.

    Args:
        config: What is made.
        whole: What the projection is for.
        base: Folder that relative paths start from.
        executor: Generates the frames.
    """
    from mmw.generation.generate import generate_dataset
    from mmw.generation.progress import SET_UP, Console
    from mmw.generation.shards import Partition

    used = os.times()
    with Console() as console, Load(executor.devices[0] != "cpu") as load:
        generate_dataset(config, base=base, executor=executor, part=Partition(), overwrite=False, console=console)
        seconds, timer, workers = console.timer.elapsed, console.timer, console.workers
    _end_server()
    now = os.times()
    processor = sum(now[:4]) - sum(used[:4])
    set_up = sum(timer.seconds.get(name, 0.0) for name in SET_UP) / workers
    steady = max(seconds - set_up, 1e-9)
    times = timer.start, timer.start + set_up, timer.start + seconds
    frames = config.frame_total
    projected = set_up / len(config.scenarios) * len(whole.scenarios) + whole.frame_total * steady / frames
    files = list(Path(config.output.dir).rglob("part-*.parquet"))
    memory = max(resource.getrusage(whose).ru_maxrss for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return Result(
        [scenario.name for scenario in config.scenarios], list(config.weathers), workers, frames, seconds, set_up,
        seconds / frames, frames / seconds, sum(timer.rays.values()) / steady, dict(timer.seconds),
        sum(_rows(path) for path in files), sum(path.stat().st_size for path in files),
        _busy(load.gpu, *times), _busy(load.cores, *times), processor, memory * 1024 / 1e9, load.memory_gb or None,
        projected,
    )  # fmt: skip


def _end_server() -> None:
    """End the server that workers were forked from: only then the system counts their times as this process's."""
    if CAN_FORK:
        from multiprocessing import forkserver

        forkserver._forkserver._stop()  # what the standard library's own tests do; it has no other name


def _rows(path: Path) -> int:
    import pyarrow.parquet as pq

    return pq.read_metadata(path).num_rows


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(prog="python -m bench.pipeline", description="Measure whole runs.")
    parser.add_argument("--config", default="full", help="configuration file, or the name of a shipped one")
    parser.add_argument("--scenarios", help="some of its scenarios, by name and comma; all if absent")
    parser.add_argument("--frames", type=int, help="only so many frames of each")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N")
    parser.add_argument("--workers", default="auto", help="processes: a number or auto")
    parser.add_argument("--out", type=Path, help="folder for the data; it must not exist (a temporary one if absent)")
    parser.add_argument("--format", choices=("human", "json"), default="human", help="json: one line at the end")
    parser.add_argument("overrides", nargs="*", metavar="key=value", help="as of mmw.run")
    return parser.parse_intermixed_args(arguments)


def main(arguments: list[str]) -> None:
    """Measure and print."""
    options = parse(arguments)
    folder = options.out or Path(tempfile.mkdtemp(prefix="mmw_bench_"))
    path = config_path(options.config)
    whole = load_config(path, options.overrides, {"output.dir": str(folder / "dataset")})
    names = options.scenarios.split(",") if options.scenarios else [scenario.name for scenario in whole.scenarios]
    some = tuple(scenario for scenario in whole.scenarios if scenario.name in names)
    if len(some) != len(names):
        raise SystemExit(f"--scenarios {options.scenarios}: {options.config} has not all of them")
    workers = int(options.workers) if options.workers.isdecimal() else options.workers
    config = whole.model_copy(
        update={"scenarios": some, "compute": whole.compute.model_copy(update={"workers": workers})}
    )
    if options.frames:
        update = {"frames": config.frames_of(some[0]).model_copy(update={"start": 0, "count": options.frames})}
        config = config.model_copy(update=update)
    if may_use_processes(config.compute, config.frame_total):  # as `mmw.run` does, before slow imports
        start_server()
    from bench.rays import machine
    from mmw.core.device import worker_devices
    from mmw.generation.executors.executor import LocalExecutor

    try:
        executor = LocalExecutor(worker_devices(options.device, workers))
        result = measure(config, whole, path.parent, executor)
    finally:
        if not options.out:
            shutil.rmtree(folder)
    if options.format == "json":
        print(json.dumps({"machine": machine(options.device), **asdict(result)}))
        return
    for name, seconds in sorted(result.stages.items(), key=lambda item: -item[1]):
        print(f"  {name:<40} {seconds:>8.2f} s {100 * seconds / result.seconds / result.workers:>5.1f} %")
    busy = "".join(
        f"{name} {share}; " for name, share in (("GPU", result.gpu_busy), ("cores", result.cores_busy)) if share
    )
    print(
        f"{result.frames:,} scenario-weather-frames in {result.seconds:.1f} s ({result.set_up_s:.1f} s set-up) with "
        f"{result.workers} workers: {result.frames_per_s:.1f} frames/s, {result.rays_per_s / 1e6:,.0f} M rays/s, "
        f"{result.bytes / 1e6:,.0f} MB; {busy}{result.processor_s:.0f} s of processor time; "
        f"host {result.host_gb:.1f} GB, device {result.device_gb or 0:.1f} GB; "
        f"all of {path.name}: {result.projected_s:.0f} s"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
