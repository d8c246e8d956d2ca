"""Report the progress of a dataset from its stored markers: `mmw status`."""

import argparse
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence

from mmw.cli.command import run_command
from mmw.generation.progress import si
from mmw.generation.provenance import stored_config
from mmw.generation.shards import all_work, pending_work, planned_keys
from mmw.storage.foreign_files import foreign_files, name_files
from mmw.storage.identity import mixtures
from mmw.storage.lock import temporaries, writers
from mmw.storage.manifest import MANIFEST, read_markers
from mmw.storage.store import DATASET, store_of
from mmw.storage.sweep_index import dataset_roots


def main(argv: Sequence[str], prog: str = "mmw status") -> int:
    """Run `mmw status` and return its exit code: 0 complete, 1 not, 2 no dataset."""
    parser = argparse.ArgumentParser(
        prog=prog,
        description="Report the progress of a dataset and its writers. Exit codes: 0 complete, 1 not yet, or there are "
        "files that are no part of it.",
    )
    parser.add_argument("dataset", help="dataset folder, that of a sweep, or s3://bucket/folder")
    return run_command(parser, _status, argv)


def _status(arguments: argparse.Namespace) -> int:
    members = dataset_roots(arguments.dataset)
    return _sweep_status(members) if members else _dataset_status(arguments.dataset)


def _sweep_status(members: Mapping[str, str]) -> int:
    """Print a line for every dataset of a sweep; return 0 if all are complete."""
    complete = 0
    width = max(map(len, members))
    for name, folder in members.items():
        state = "missing"
        if store_of(folder).read(DATASET) is not None:
            config = stored_config(folder)
            root = store_of(folder, config.output.staging)
            left = sum(item.frames for item in pending_work(root, all_work(config)))
            is_complete = not left and bool(root.sizes([MANIFEST]))
            complete += is_complete
            state = f"{config.frame_total - left:,}/{config.frame_total:,} frames"
            state += "" if is_complete else ", being written" if writers(root) else ", not complete"
        print(f"{name:<{width}}  {state}")
    print(f"{complete} of {len(members)} datasets are complete")
    if complete < len(members):
        print("the command that began the sweep makes the rest; `mmw status` of a dataset's folder tells more")
    return 0 if complete == len(members) else 1


def _dataset_status(dataset: str) -> int:
    config = stored_config(dataset)
    root = store_of(dataset, config.output.staging)
    everything = all_work(config)
    wanted, missing = Counter[str](), Counter[str]()
    for counts, work in ((wanted, everything), (missing, pending_work(root, everything))):
        for item in work:
            counts[item.scenario] += item.frames
    size: dict[str, int] = defaultdict(int)
    markers = read_markers(root)
    listed: set[str] = set()
    for marker in markers:
        size[marker["scenario"]] += sum(file["bytes"] for file in marker["files"])
        listed.update(file["path"] for file in marker["files"])
    print(f"{'scenario':<32} {'frames':>17} {'bytes':>10}")
    for name, frames in wanted.items():
        there = f"{frames - missing[name]:,}/{frames:,}"
        print(f"{name:<32} {there:>17} {si(size[name]):>9}B")
    total = wanted.total()
    done = total - missing.total()
    print(f"{'all':<32} {f'{done:,}/{total:,}':>17} {si(sum(size.values())):>9}B")
    for line in mixtures(markers):
        print(f"mixed: {line}")
    running = writers(root)
    for line in running:
        print(f"being written: {line}")
    foreign = foreign_files(root, planned_keys(everything), listed if done == total else None)
    if foreign:
        print(name_files(foreign))
    if done == total and root.sizes([MANIFEST]):
        return 1 if foreign else 0
    left = len(temporaries(root.staging))
    if not running:
        left_text = f"; {left} unfinished files of a killed run, which it removes" if left else ""
        if done == total:
            print(f"every shard is there; `mmw finalize {root}` writes the manifest")
        else:
            print(f"no process writes it; the command that began it resumes{left_text}")
    return 1
