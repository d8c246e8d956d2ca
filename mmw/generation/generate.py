"""Generate a dataset: divide missing frames into work, run it on an executor, write the manifest."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from mmw.config import Config
from mmw.core.device import writer_threads
from mmw.core.errors import InputError
from mmw.generation.continuation import MACHINE, check_continuation, is_outdated, makers_of
from mmw.generation.executors.executor import Executor
from mmw.generation.executors.process_pool import MIN_FRAMES_PER_WORKER
from mmw.generation.progress import Console, closing_summary
from mmw.generation.provenance import versions, write_config, write_license
from mmw.generation.shards import Partition, all_work, part_of, pending_work, planned_keys
from mmw.generation.shared_stages import SharedStages
from mmw.generation.worker import GenerationContext
from mmw.scene.input_files import hash_inputs
from mmw.storage.foreign_files import check_foreign_files
from mmw.storage.lock import exclusive_lock, remove_leftovers, writing
from mmw.storage.manifest import finalize, prepare_root, read_dataset, upload_finished
from mmw.storage.store import Store, store_of


def generate_dataset(
    config: Config,
    *,
    base: Path,
    executor: Executor,
    part: Partition,
    overwrite: bool,
    console: Console,
    accepted: Collection[str] = (),
    sweep: Mapping[str, Any] | None = None,
    stages: SharedStages | None = None,
) -> None:
    """Generate the missing frames of a dataset, or of a part of it; the run that completes it writes the manifest.

    Relative paths in the configuration start from `base`. `overwrite` replaces a dataset of another configuration.
    `accepted` names what may differ from the shards that are there, see `mmw.generation.continuation`.
    Of a sweep, `sweep` is what `dataset.json` says about it, and `stages` has the stages of its other datasets.

    Raises:
        InputError: If the folder belongs to another configuration or other input files, has shards of other software
            or another machine, has files that are no part of the dataset, is being written or cannot be, or a scenario
            cannot be prepared or read.
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
        inputs = hash_inputs(config, base)
        rates = {scenario.name: config.frame_rate_of(scenario) for scenario in config.scenarios}
        with exclusive_lock(root.staging, "begin"):  # of several parts, one begins the dataset
            anew = overwrite or (part.count == 1 and is_outdated(root, sha256, inputs, now))
            prepare_root(root, config.identity(), sha256, now, anew, inputs, rates, sweep)
        write_config(config, base, root)
        write_license(config, base, root)
        everything = all_work(config)
        plan = planned_keys(everything)
        check_foreign_files(root, plan)
        wanted = part_of(everything, part)
        work = pending_work(root, wanted)
        if upload_finished(root, [key for item in work for key in item.keys]):
            work = pending_work(root, wanted)
        is_part = part.count > 1
        makers = makers_of(root)
        for line in check_continuation(root, makers, now, accepted, has_work=bool(work), is_part=is_part):
            console.warn_once(line)
        meta = {
            "config_sha256": sha256,
            "inputs_sha256": read_dataset(root).get("inputs_sha256"),
            "mmw_version": now["mmw"],
            "git_sha": now["git"],
            "software": now["software"],
            "accepted": " ".join(sorted({*accepted, *makers.accepted})) or None,
        }
        total, frames = (sum(item.frames for item in some) for some in (wanted, work))
        most = len(work)
        if config.compute.workers == "auto":
            most = min(most, frames // MIN_FRAMES_PER_WORKER[executor.devices[0].partition(":")[0]])
        workers = max(min(len(executor.devices), most), 1)
        threads = writer_threads(config.compute.writer_threads, workers)
        machines = None if MACHINE in accepted else makers.machines
        context = GenerationContext(config, base, root, meta, threads, owner, inputs=inputs, machines=machines)
        console.begin(total, total - frames, workers)
        if console.done:
            rest = "making the rest" if console.done < total else "nothing to make"
            console.say(f"{root}: {console.done} of {total} frames are there already; {rest}")
        if stages is not None:
            stages.share(config, root)
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
            result = finalize(root, plan)
        remove_leftovers(root, part.index, part.count)
        if sweep is None or work:  # of the finished ones of a sweep a line is enough
            text = closing_summary(root, config, executor.device_name, workers, result, console.timer, frames)
            console.summary(text)


def output_of(config: Config, part: Partition) -> Store:
    """Return the store that a dataset is written to.

    Raises:
        InputError: If `output.dir` is neither a folder nor the URL of a store.
    """
    return store_of(config.output.dir, config.output.staging, f"{part.index}-of-{part.count}")
