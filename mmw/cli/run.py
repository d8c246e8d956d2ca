"""Generate a dataset: `python -m mmw.run --config FILE [key=value ...]`, or `mmw run`.

Exit codes: 0 done, 2 bad configuration or input (one line a problem), 1 failure while running (a rerun resumes).
"""

import argparse
import json
from collections.abc import Sequence

from mmw.cli.command import run_command
from mmw.config import config_path, load_config
from mmw.config.differences import differences_yaml
from mmw.config.load import json_schema, load_sweep, to_yaml
from mmw.config.shipped import CONFIG_HELP
from mmw.core.errors import InputError
from mmw.generation.run_config import RunOptions, describe_config, run_config
from mmw.generation.sweep import describe_sweep, run_sweep


def parser(prog: str = "python -m mmw.run") -> argparse.ArgumentParser:
    """Return the command line's parser."""
    result = argparse.ArgumentParser(
        prog=prog,
        description="Generate a multimodal wireless dataset from one configuration file.",
        epilog="A first run, without a GPU: %(prog)s --config quickstart --out out/first. The same "
        "command again resumes. Exit codes: 0 done, 2 bad configuration or input, 1 failure while running.",
    )
    result.add_argument("--config", required=False, metavar="FILE", help=CONFIG_HELP)
    result.add_argument(
        "overrides",
        nargs="*",
        metavar="key=value",
        help="replace values (without --config, the configuration comes first); items of lists by name or number, "
        "* for all, values as YAML: frames.count=10 sensors.lidar.range_m=80 'weathers=[sunny, rainy]' "
        "'scenarios.*.traffic.warmup_s=5'",
    )
    result.add_argument("--out", metavar="DIR", help="dataset folder, or s3://bucket/folder (output.dir)")
    result.add_argument("--device", metavar="NAME", help="auto, cpu or cuda:N (compute.device)")
    result.add_argument(
        "--engine", metavar="NAME", help="local (processes of this machine) or ray (a Ray cluster) (compute.engine)"
    )
    result.add_argument(
        "--batch-frames", type=int, metavar="N", help="frames traced in one launch (compute.batch_frames)"
    )
    result.add_argument("--workers", metavar="N", help="processes that trace: a number or auto (compute.workers)")
    result.add_argument(
        "--shard",
        default="0/1",
        metavar="i/N",
        help="generate part i of N, counted from 0: for N runs of a scheduler's array into one folder",
    )
    result.add_argument("--overwrite", action="store_true", help="remove the data in the folder and generate it again")
    result.add_argument(
        "--accept",
        action="append",
        default=[],
        choices=("versions", "machine"),
        help="resume although the shards that are there were made with other versions of mmw or its packages "
        "(versions), or on another kind of machine (machine); may be repeated",
    )
    result.add_argument(
        "--dry-run",
        action="store_true",
        help="trace some frames, print rows, bytes, rays and notes that the whole dataset would have, and stop",
    )
    result.add_argument(
        "--quick", action="store_true", help="with --dry-run: trace nothing, and guess the bytes from other scenarios"
    )
    result.add_argument(
        "--print-config", action="store_true", help="print the resolved configuration with every default and stop"
    )
    result.add_argument("--diff", action="store_true", help="print only what differs from the defaults and stop")
    result.add_argument(
        "--print-schema", action="store_true", help="print the JSON Schema of the configuration and stop"
    )
    return result


def main(argv: Sequence[str] | None = None, prog: str = "python -m mmw.run") -> int:
    """Run the command line and return its exit code."""
    finished = "every finished shard is kept and the same command resumes"
    return run_command(parser(prog), _run, argv, intermixed=True, finished=finished)


def _run(arguments: argparse.Namespace) -> None:
    if arguments.print_schema:
        print(json.dumps(json_schema(), indent=2))
        return
    if not arguments.config and arguments.overrides and "=" not in arguments.overrides[0]:
        arguments.config = arguments.overrides.pop(0)
    if not arguments.config:
        raise InputError(
            "--config FILE is missing; a first one to try is --config quickstart; `mmw configs` lists more"
        )
    if arguments.quick and not arguments.dry_run:
        raise InputError("--quick goes with --dry-run; add it, or remove --quick")
    workers = arguments.workers
    options = {
        "output.dir": arguments.out,
        "compute.engine": arguments.engine,
        "compute.device": arguments.device,
        "compute.batch_frames": arguments.batch_frames,
        "compute.workers": _whole_number(workers),
    }
    path = config_path(arguments.config)
    given = {key: value for key, value in options.items() if value is not None}
    config = load_config(path, arguments.overrides, given)
    members = load_sweep(path, arguments.overrides, given)
    how = RunOptions(overwrite=arguments.overwrite, shard=arguments.shard, accept=arguments.accept)
    if arguments.print_config:
        print(to_yaml(config), end="")
    elif arguments.diff:
        print(differences_yaml(config), end="")
    elif arguments.dry_run and members:
        print(describe_sweep(members, config.output.dir, path.parent, path, arguments.shard))
    elif members:
        run_sweep(members, config.output.dir, path.parent, path, how)
    elif arguments.dry_run:
        print(describe_config(config, path.parent, path, arguments.shard, is_quick=arguments.quick))
    else:
        run_config(config, path.parent, path, how)


def _whole_number(text: str | None) -> int | str | None:
    """Return text as a number if it is one; other text is for the configuration to refuse."""
    return int(text) if text is not None and text.isdecimal() and len(text) < 10 else text
