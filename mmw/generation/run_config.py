"""Generate the dataset of a configuration: the work of `mmw.generate` and of `mmw run`."""

import itertools
import multiprocessing
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from mmw.config import Config, ConfigError
from mmw.config.load import Source, base_folder, in_config, load_config, load_sweep, place_of
from mmw.config.sensor_spec import SENSORS
from mmw.config.traffic_engine import ENGINES
from mmw.core.errors import InputError
from mmw.core.registry import REGISTERED
from mmw.generation.executors.process_pool import may_use_processes, start_server


@dataclass(frozen=True)
class RunOptions:
    """How datasets are generated, whatever their configuration."""

    overwrite: bool = False
    """Remove the data in the folder and generate it again."""
    shard: str = "0/1"
    """Part of each dataset, `i/N`."""
    accept: Collection[str] = ()
    """Keys of `mmw.generation.continuation.ACCEPTABLE`: differences from the shards that are there that do not stop a
    resume."""
    is_quiet: bool = False
    """Print nothing."""


DEFAULT_OPTIONS = RunOptions()


def generate(
    config: Source,
    out: str | os.PathLike[str] | None = None,
    *,
    overrides: Sequence[str] = (),
    base: str | os.PathLike[str] | None = None,
    device: str | None = None,
    workers: int | Literal["auto"] | None = None,
    overwrite: bool = False,
    accept: Collection[str] = (),
    progress: bool = True,
) -> Any:
    """Generate the missing frames of a dataset and open it, as `mmw run` does; of a sweep, of all its datasets.

    The same call resumes what an earlier one, or a killed one, has left. Worker processes do not run the caller's
    script, which needs no guard for them. Messages name options of the command: `--out` is `out` here.

    Args:
        config: Path of a YAML file; name of a shipped configuration, such as `quickstart`; content of a file as a
            mapping; or a `Config`.
        out: Dataset folder, or `s3://bucket/folder`; by default `output.dir`.
        overrides: `key=value` as on the command line, values as YAML: `frames.count=10`.
        base: Folder that relative paths of input files start from. By default that of the configuration file; the
            current folder for a mapping and a `Config`.
        device: `auto`, `cpu` or `cuda:N`; by default `compute.device`.
        workers: Processes that trace, or `auto`; by default `compute.workers`.
        overwrite: Remove the data in the folder and generate it again.
        accept: Differences from the shards that are there that do not stop a resume: `versions`, `machine`.
        progress: Show the progress on standard error, and a summary on standard output. Without, mmw prints nothing;
            its logger `mmw` has it all.

    Returns:
        The `mmw.Dataset`; with a `sweep`, a map of the names of its datasets to them.

    Raises:
        ConfigError: If the configuration or a file that it names cannot be used; one line for each problem.
        InputError: If the folder has data of another configuration, or is being written or cannot be.
        Error: If the disk is full, workers die, or a store cannot be reached; the same call resumes.

    Examples:
        >>> import mmw
        >>> changes = ["frames.count=2", "sensors=[{type: imu}]"]
        >>> data = mmw.generate("quickstart", out="out/two_frames", overrides=changes, workers=1, progress=False)
        >>> data.read("imu").num_rows  # three vehicles, two frames
        6
    """
    options = {"output.dir": out, "compute.device": device, "compute.workers": workers}
    given = {key: value for key, value in options.items() if value is not None}
    found = load_config(config, overrides, given, base=base)
    where, place = base_folder(config, base), place_of(config)
    how = RunOptions(overwrite=overwrite, accept=accept, is_quiet=not progress)
    members = load_sweep(config, overrides, given, base=base)
    if members:
        from mmw.generation.sweep import run_sweep

        run_sweep(members, found.output.dir, where, place, how)
    else:
        run_config(found, where, place, how)
    from mmw.dataset import open_dataset

    if members:
        return {member.name: open_dataset(member.config.output.dir) for member in members}
    return open_dataset(found.output.dir)


def run_config(config: Config, base: Path, place: Path | str, options: RunOptions = DEFAULT_OPTIONS) -> None:
    """Generate the dataset of a configuration, or a part of it.

    Args:
        config: The configuration.
        base: Folder that relative paths of input files start from.
        place: File of the configuration, or words for one that is no file, as messages begin.
        options: How.

    Raises:
        InputError: If the configuration or a file that it names cannot be used.
        Error: If the disk or the memory is full, workers die, or a store cannot be reached.
    """
    with in_config(place):
        config.check_single("a run of one")
    run_datasets([(config, None)], base, place, options)


def run_datasets(
    datasets: Sequence[tuple[Config, Mapping[str, Any] | None]],
    base: Path,
    place: Path | str,
    options: RunOptions,
    *,
    begin: Callable[[], None] | None = None,
) -> None:
    """Generate several datasets, or a part of each, one after the other, as `run_config`; inputs are checked first.

    Args:
        datasets: Configuration of each, and what `dataset.json` says about its place in a sweep.
        base: Folder that relative paths of input files start from.
        place: File of the configurations.
        options: How.
        begin: Called once all inputs have been checked.
    """
    with in_config(place):
        fitting = [(*_with_fitting_workers(config), sweep) for config, sweep in datasets]
    if any(may_use_processes(config.compute, config.frame_total) for config, _, _ in fitting):
        start_server()
    from mmw.generation.continuation import ACCEPTABLE
    from mmw.generation.estimate import check_inputs
    from mmw.generation.executors.executor import open_executor
    from mmw.generation.generate import generate_dataset, output_of
    from mmw.generation.progress import Console
    from mmw.generation.shards import Partition
    from mmw.generation.shared_stages import SharedStages

    accept = options.accept
    if isinstance(accept, str) or not set(accept) <= set(ACCEPTABLE):
        raise InputError(f"accept = {accept!r}: give a list of some of {', '.join(map(repr, ACCEPTABLE))}")
    with in_config(place):
        part = Partition.parse(options.shard)
        for config, _, _ in fitting:
            output_of(config, part)  # refuses an invalid address
            check_inputs(config, base)
        if begin is not None:
            begin()
        stages = SharedStages() if len(fitting) > 1 else None
        for _, group in itertools.groupby(fitting, lambda item: item[0].compute):
            with ExitStack() as stack:
                console = stack.enter_context(Console(is_quiet=options.is_quiet))
                executor = None
                for config, note, sweep in group:
                    executor = executor or stack.enter_context(open_executor(config.compute, console))
                    if note:
                        console.warn_once(note)
                    generate_dataset(
                        config,
                        base=base,
                        executor=executor,
                        part=part,
                        overwrite=options.overwrite,
                        console=console,
                        accepted=frozenset(accept),
                        sweep=sweep,
                        stages=stages,
                    )


def describe_config(
    config: Config, base: Path, place: Path | str, shard: str = "0/1", *, is_quick: bool = False
) -> str:
    """Return the text of `--dry-run`: what `run_config` would generate with the same arguments.

    Frames of a few scenarios are traced for it, see `mmw.generation.foresee`; if `is_quick`, none is.

    Raises:
        InputError: As `run_config`.
    """
    from mmw.core.device import choose_device, worker_devices
    from mmw.generation.estimate import check_inputs, count_agents, describe_plan
    from mmw.generation.foresee import foresee
    from mmw.generation.generate import output_of
    from mmw.generation.shards import Partition

    with in_config(place):
        output_of(config, Partition.parse(shard))
        check_inputs(config, base)
        compute = config.compute
        is_local = compute.engine == "local"
        where = worker_devices(compute.device, compute.workers)[0] if is_local else "a Ray cluster"
        counts, samples = count_agents(config, base), []
        if not is_quick:
            samples = foresee(config, base, choose_device(compute.device if is_local else "auto"), counts)
        return describe_plan(config, base, where, counts, samples)


def _with_fitting_workers(config: Config) -> tuple[Config, str]:
    """Return a configuration with one worker if worker processes could not do its work, and a note on it.

    Raises:
        ConfigError: If the configuration demands several workers.
    """
    compute = config.compute
    reason = _why_one_process(config)
    if not reason or not (compute.engine != "local" or may_use_processes(compute, config.frame_total)):
        return config, ""
    if compute.engine != "local":
        raise ConfigError([f"compute.engine = {compute.engine!r}: {reason}; use engine local with workers = 1"])
    if compute.workers != "auto":
        raise ConfigError([f"compute.workers = {compute.workers}: {reason}; give workers = 1"])
    single = config.model_copy(update={"compute": compute.model_copy(update={"workers": 1})})
    return single, f"one worker, because {reason}"


def _why_one_process(config: Config) -> str:
    """Return why only this process can do the work of a configuration; empty if other processes can."""
    engines = [scenario.traffic.engine for scenario in config.scenarios if scenario.traffic]
    for what, registry, names in (
        ("sensor", SENSORS, [sensor.type for sensor in config.sensors]),
        ("traffic engine", ENGINES, engines),
    ):
        for name in names:
            if registry.owner(name) == REGISTERED:
                return f"{what} {name!r} is registered in this process only, and is no entry point of a package"
    if multiprocessing.current_process().daemon:
        return "this process is a worker of multiprocessing itself, which may start no processes"
    return ""
