"""`mmw finalize`: the manifest and the card of a dataset whose parts were made by several runs."""

import argparse
import sys
from collections.abc import Sequence

from mmw.cli.command import add_log_options, fail, run_command
from mmw.generation.provenance import stored_config
from mmw.generation.shards import all_work, pending_work
from mmw.storage.lock import writing
from mmw.storage.manifest import finalize
from mmw.storage.store import store_of


def main(argv: Sequence[str], prog: str = "mmw finalize") -> int:
    """Run `mmw finalize` and return its exit code: 0 done, 1 shards are missing, 2 no dataset or one being written."""
    parser = argparse.ArgumentParser(
        prog=prog,
        description="Write the manifest and the card of a dataset from its finished shards, and remove what killed "
        "runs left unfinished. A run does the same when it ends.",
    )
    parser.add_argument("dataset", help="dataset folder, or s3://bucket/folder")
    parser.add_argument("--partial", action="store_true", help="also if shards are missing: list those that are there")
    arguments = add_log_options(parser).parse_args(argv)
    return run_command(lambda: _finalize(arguments.dataset, arguments.partial), prog, debug=arguments.debug)


def _finalize(address: str, partial: bool) -> int:
    config = stored_config(address)
    root = store_of(address, config.output.staging)
    missing = pending_work(root, all_work(config))
    frames = sum(item.frames for item in missing)
    if missing and not partial:
        problem = f"{root}: {frames} frames are missing, the first of {missing[0]}; run the configuration again, or "
        return fail([problem + "list what is there by --partial"], code=1)
    with writing(root, 0, 1, lambda line: print(line, file=sys.stderr)):
        result = finalize(root)
    print(f"{root}: {result['files']:,} files, {result['rows']:,} rows, {result['bytes']:,} bytes listed")
    return 0
