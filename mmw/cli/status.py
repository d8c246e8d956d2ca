"""`mmw status`: how far a dataset is, by the markers on the disk, whoever makes it."""

import argparse
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence

from mmw.cli.command import add_log_options, run_command
from mmw.generation.progress import si
from mmw.generation.provenance import stored_config
from mmw.generation.shards import Work, all_work, pending_work
from mmw.storage.lock import temporaries, writers
from mmw.storage.manifest import MANIFEST, read_markers
from mmw.storage.store import store_of


def main(argv: Sequence[str], prog: str = "mmw status") -> int:
    """Run `mmw status` and return its exit code: 0 complete, 1 not yet, 2 no dataset."""
    parser = argparse.ArgumentParser(
        prog=prog, description="Say how far a dataset is and who writes it. Exit codes: 0 complete, 1 not yet."
    )
    parser.add_argument("dataset", help="dataset folder, or s3://bucket/folder")
    arguments = add_log_options(parser).parse_args(argv)
    return run_command(lambda: _status(arguments.dataset), prog, debug=arguments.debug)


def _status(address: str) -> int:
    config = stored_config(address)
    root = store_of(address, config.output.staging)
    everything = all_work(config)
    wanted, missing = frames_by_scenario(everything), frames_by_scenario(pending_work(root, everything))
    size: dict[str, int] = defaultdict(int)
    for marker in read_markers(root):
        size[marker["scenario"]] += sum(file["bytes"] for file in marker["files"])
    print(f"{'scenario':<32} {'frames':>17} {'bytes':>10}")
    for name, frames in wanted.items():
        there = f"{frames - missing[name]:,}/{frames:,}"
        print(f"{name:<32} {there:>17} {si(size[name]):>9}B")
    total = wanted.total()
    done = total - missing.total()
    print(f"{'all':<32} {f'{done:,}/{total:,}':>17} {si(sum(size.values())):>9}B")
    running = writers(root)
    for line in running:
        print(f"being written: {line}")
    if done == total and root.sizes([MANIFEST]):
        return 0
    left = len(temporaries(root.staging))
    if not running:
        left_text = f"; {left} unfinished files of a killed run, which it removes" if left else ""
        if done == total:
            print(f"every shard is there; `mmw finalize {root}` writes the manifest")
        else:
            print(f"nobody writes it; the command that began it resumes{left_text}")
    return 1


def frames_by_scenario(work: Iterable[Work]) -> Counter[str]:
    """Return the scenario-weather-frames of each scenario in a list of work, in its order."""
    counts: Counter[str] = Counter()
    for item in work:
        counts[item.scenario] += item.frames
    return counts
