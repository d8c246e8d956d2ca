"""A dataset from a configuration: what is missing of it is cut into work, an engine makes it, the manifest lists it."""

from pathlib import Path

from mmw.config import Config
from mmw.core.device import writer_threads
from mmw.core.errors import InputError
from mmw.core.temp_files import Owner
from mmw.generation.executors.executor import Engine
from mmw.generation.executors.process_pool import FRAMES_A_WORKER
from mmw.generation.progress import Console, closing_summary
from mmw.generation.provenance import keep_config, versions
from mmw.generation.shards import Partition, all_work, part_of, pending_work
from mmw.generation.worker import GenerationContext
from mmw.storage.lock import clean_other_parts, writing
from mmw.storage.manifest import finalize, keep_finished, prepare_root
from mmw.storage.store import Store, store_of


def generate_dataset(
    config: Config, *, base: Path, engine: Engine, part: Partition, overwrite: bool, console: Console
) -> None:
    """Make the dataset of a configuration, or what is missing of it, or of a part of it.

    Args:
        config: The configuration.
        base: Folder that relative paths in it start from.
        engine: Who makes it.
        part: Which part is made; the run that makes the last of them writes the manifest.
        overwrite: Replace a dataset that another configuration made.
        console: Where progress goes.

    Raises:
        InputError: If the folder belongs to another configuration, is being written or cannot be, or a scenario cannot
            be made or read.
        OutOfSpaceError: If the disk is full; the same command resumes.
        StoreError: If a store cannot be reached any more; the same command resumes.
        WorkerLostError: If worker processes die again and again.
    """
    root = output_of(config, part)
    if overwrite and not part.is_whole:
        raise InputError(f"--overwrite with --shard {part}: would remove the other parts; remove {root} first")
    root.check()
    with writing(root, part.index, part.count, console.say) as owner:
        _make(config, base, root, engine, part, owner, overwrite, console)


def output_of(config: Config, part: Partition) -> Store:
    """Return where a dataset goes.

    Raises:
        InputError: If `output.dir` names no place.
    """
    return store_of(config.output.dir, config.output.staging, f"{part.index}-of-{part.count}")


def _make(
    config: Config,
    base: Path,
    root: Store,
    engine: Engine,
    part: Partition,
    owner: Owner,
    overwrite: bool,
    console: Console,
) -> None:
    made_with = versions(config, base, engine.machine)
    prepare_root(root, config.identity(), config.sha256(), made_with, overwrite)
    keep_config(config, base, root)
    meta = {
        "config_sha256": config.sha256(),
        "mmw_version": made_with["mmw"],
        "git_sha": made_with["git"],
    }
    everything = all_work(config)
    wanted = part_of(everything, part)
    work = pending_work(root, wanted)
    if keep_finished(root, [key for item in work for key in item.keys]):
        work = pending_work(root, wanted)
    total, frames = (sum(item.frames for item in some) for some in (wanted, work))
    most = len(work)
    if config.compute.workers == "auto":
        most = min(most, frames // FRAMES_A_WORKER[engine.devices[0].partition(":")[0]])
    workers = max(min(len(engine.devices), most), 1)
    making = GenerationContext(config, base, root, meta, writer_threads(config.compute.writer_threads, workers), owner)
    console.begin(total, total - frames, workers)
    if console.done:
        rest = "making the rest" if console.done < total else "nothing to make"
        console.say(f"{root}: {console.done} of {total} frames are there already; {rest}")
    engine.make(making, work, workers, console)
    root.leave()
    missing = sum(item.frames for item in pending_work(root, everything))
    if missing:
        console.say(
            f"{root}: {missing} frames of other parts are not there yet; the run that makes the last of them writes "
            "the manifest"
        )
        return
    with console.clock.stage("manifest"):
        result = finalize(root)
    clean_other_parts(root, part.index, part.count)
    console.summary(closing_summary(root, config, engine.device_name, workers, result, console.clock, frames))
