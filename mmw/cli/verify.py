"""Verify that a dataset is complete, intact and physically consistent: `mmw verify`."""

import argparse
import os
import sys
from collections.abc import Sequence
from functools import partial

from mmw.cli.command import run_command
from mmw.core.errors import InputError
from mmw.storage.file_checks import verify
from mmw.storage.finding import Finding
from mmw.storage.store import Root, store_of
from mmw.storage.sweep_index import dataset_roots

MAX_LINES = 40
"""Findings that are printed."""

WORKERS = min(os.cpu_count() or 1, 8)
"""Processes that read files, at most; each holds the rows of some shards."""


def main(argv: Sequence[str], prog: str = "mmw verify") -> int:
    """Run `mmw verify` and return its exit code: 0 nothing wrong, 1 something is, 2 no dataset."""
    parser = argparse.ArgumentParser(
        prog=prog,
        description="Check every file of a dataset against its hash, its rows against the configuration, and some "
        "frames against physics.",
    )
    parser.add_argument("dataset", help="dataset folder, that of a sweep, or s3://bucket/folder")
    parser.add_argument(
        "--rerender", type=int, default=0, metavar="K", help="generate K random rows again and compare them bit for bit"
    )
    parser.add_argument("--seed", type=int, default=0, help="which random rows")
    parser.add_argument(
        "--frames", type=int, default=5, metavar="N", help="frames of each scenario and weather held against physics"
    )
    parser.add_argument(
        "--workers", type=int, default=WORKERS, metavar="N",
        help="processes that read the files of a dataset of many shards (here %(default)s)",
    )  # fmt: skip
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N, for --rerender")
    return run_command(parser, _verify, argv)


def _verify(arguments: argparse.Namespace) -> int:
    members = dataset_roots(arguments.dataset)
    if not members:
        return _verify_dataset(store_of(arguments.dataset), arguments)
    codes = [_verify_member(name, folder, arguments) for name, folder in members.items()]
    print(f"{codes.count(0)} of {len(codes)} datasets of the sweep are complete, unchanged and right")
    return max(codes)


def _verify_member(name: str, folder: str, arguments: argparse.Namespace) -> int:
    """Verify a dataset of a sweep, and return 1 if it is missing or something is wrong."""
    root = store_of(folder)
    try:
        return _verify_dataset(root, arguments)
    except InputError as error:  # the others are verified all the same
        print(f"mmw: {name}: {error}", file=sys.stderr)
        return 1


def _verify_dataset(root: Root, arguments: argparse.Namespace) -> int:
    findings = check(root, arguments.frames, arguments.workers)
    if arguments.rerender and not any(finding.is_error for finding in findings):
        from mmw.generation.verification.reproducibility import rerender

        findings += rerender(root, arguments.rerender, seed=arguments.seed, device=arguments.device, tell=print)
    errors = [finding for finding in findings if finding.is_error]
    leftovers = [finding for finding in findings if not finding.is_error]
    for finding in (errors + leftovers)[:MAX_LINES]:
        print(finding)
    if len(findings) > MAX_LINES:
        print(f"and {len(findings) - MAX_LINES} more")
    if errors:
        skipped = ", no row was generated again" if arguments.rerender and errors[-1].kind != "regenerated" else ""
        count = f"{len(errors)} error{'s' if len(errors) > 1 else ''}"
        print(f"mmw: {root}: {count}{skipped}", file=sys.stderr)
        return 1
    mixed = "; see above what its shards are mixed of" if any(one.kind == "mixed" for one in findings) else ""
    print(f"{root}: every file is there and unchanged; counts, keys and physics are right{mixed}")
    return 0


def check(root: Root, frames_each: int, workers: int = 1) -> list[Finding]:
    """Return what is wrong with files, then counts, then physics; physics only where files and counts are right.

    Args:
        root: Dataset.
        frames_each: Frames of each scenario and weather that are held against physics.
        workers: Processes that read files if there are many shards; they know sensors of installed packages alone.

    Raises:
        InputError: If the folder is not a dataset, or its configuration cannot be read.
    """
    from mmw.generation.verification.completeness import check_plan, read_plan
    from mmw.generation.verification.physics import check_physics
    from mmw.generation.verification.planned_rows import PlannedRows
    from mmw.generation.verification.workers import check_files

    store = store_of(root)
    config, problems = read_plan(store)
    rows = None if config is None else PlannedRows(store, config)
    findings = verify(store, partial(check_files, rows=rows, workers=workers))
    if any(finding.path == "dataset.json" for finding in findings):
        return findings  # of another schema: nothing else can be judged
    if config is not None and rows is not None:
        problems = [*rows.findings, *rows.check_static(), *rows.check_path_counts(), *check_plan(store, config)]
    known = {(finding.kind, finding.path) for finding in findings}
    findings += [finding for finding in problems if (finding.kind, finding.path) not in known]
    if config is not None and not any(finding.is_error for finding in findings):
        try:
            findings += check_physics(store.address, config, frames_each)
        except InputError as error:  # rows that no reader can use
            findings.append(Finding("schema", "tables", str(error)))
    return findings
