"""Generate a dataset: divide missing frames into work, run it on an executor, write the manifest."""

from pathlib import Path

from mmw.config import Config
from mmw.core.device import writer_threads
from mmw.core.errors import InputError
from mmw.generation.executors.executor import Executor
from mmw.generation.executors.process_pool import MIN_FRAMES_PER_WORKER
from mmw.generation.progress import Console, closing_summary
from mmw.generation.provenance import check_continuation, versions, write_config
from mmw.generation.shards import Partition, all_work, part_of, pending_work
from mmw.generation.worker import GenerationContext
from mmw.storage.lock import clean_other_parts, writing
from mmw.storage.manifest import finalize, prepare_root, upload_finished
from mmw.storage.store import Store, store_of


def generate_dataset(
    config: Config, *, base: Path, executor: Executor, part: Partition, overwrite: bool, console: Console
) -> None:
    """Generate the missing frames of a dataset, or of a part of it; the run that completes it writes the manifest.

    Relative paths in the configuration start from `base`. `overwrite` replaces a dataset of another configuration.

    Raises:
        InputError: If the folder belongs to another configuration, is being written or cannot be, or a scenario cannot
            be prepared or read.
        OutOfSpaceError: If the disk is full; the same command resumes.
        StoreError: If a store cannot be reached any more; the same command resumes.
        WorkerLostError: If worker processes die again and again.
    """
    root = output_of(config, part)
    if overwrite and part.count > 1:
        raise InputError(f"--overwrite with --shard {part}: would remove the other parts; remove {root} first")
    root.check_writable()
    with writing(root, part.index, part.count, console.say) as owner:
        now, sha256 = versions(config, base, executor.machine), config.sha256()
        for line in [] if overwrite else check_continuation(root, config, now):
            console.warn_once(line)
        prepare_root(root, config.identity(), sha256, now, overwrite)
        write_config(config, base, root)
        meta = {"config_sha256": sha256, "mmw_version": now["mmw"], "git_sha": now["git"]}
        everything = all_work(config)
        wanted = part_of(everything, part)
        work = pending_work(root, wanted)
        if upload_finished(root, [key for item in work for key in item.keys]):
            work = pending_work(root, wanted)
        total, frames = (sum(item.frames for item in some) for some in (wanted, work))
        most = len(work)
        if config.compute.workers == "auto":
            most = min(most, frames // MIN_FRAMES_PER_WORKER[executor.devices[0].partition(":")[0]])
        workers = max(min(len(executor.devices), most), 1)
        threads = writer_threads(config.compute.writer_threads, workers)
        context = GenerationContext(config, base, root, meta, threads, owner)
        console.begin(total, total - frames, workers)
        if console.done:
            rest = "making the rest" if console.done < total else "nothing to make"
            console.say(f"{root}: {console.done} of {total} frames are there already; {rest}")
        executor.run(context, work, workers, console)
        root.check_present()
        root.remove_staging()
        missing = sum(item.frames for item in pending_work(root, everything))
        if missing:
            console.say(
                f"{root}: {missing} frames of other parts are not there yet; the run that makes the last of them "
                "writes the manifest"
            )
            return
        with console.timer.stage("manifest"):
            result = finalize(root)
        clean_other_parts(root, part.index, part.count)
        console.summary(closing_summary(root, config, executor.device_name, workers, result, console.timer, frames))


def output_of(config: Config, part: Partition) -> Store:
    """Return the store that a dataset is written to.

    Raises:
        InputError: If `output.dir` is neither a folder nor the URL of a store.
    """
    return store_of(config.output.dir, config.output.staging, f"{part.index}-of-{part.count}")
