"""`python -m mmw.run --config FILE [key=value ...]`: parse, load, check, hand over to the pipeline; nothing else.

Exit codes: 0 done, 2 bad configuration or input (one line a problem), 1 failure while running (a rerun resumes).
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from mmw.command import fail
from mmw.config import Config, ConfigError, load_config
from mmw.config.load import json_schema, to_yaml

OUT_OF_MEMORY = "Failed to allocate"
"""How Warp's error about a full device or host begins."""


def parser(prog: str = "python -m mmw.run") -> argparse.ArgumentParser:
    """Return the command line's parser."""
    result = argparse.ArgumentParser(
        prog=prog,
        description="Make a multimodal wireless dataset from one configuration file.",
        epilog="A first run, without a GPU: %(prog)s --config configs/quickstart.yaml --out out/first. The same "
        "command again resumes. Exit codes: 0 done, 2 bad configuration or input, 1 failure while running.",
    )
    result.add_argument(
        "--config", required=False, metavar="FILE", help="configuration file (YAML), such as configs/quickstart.yaml"
    )
    result.add_argument(
        "overrides",
        nargs="*",
        metavar="key=value",
        help="replace values; list items by number, values as YAML: frames.count=10 sensors.0.range_m=80 "
        "'weathers=[sunny, rainy]'",
    )
    result.add_argument("--out", metavar="DIR", help="dataset folder (output.dir)")
    result.add_argument("--device", metavar="NAME", help="auto, cpu or cuda:N (compute.device)")
    result.add_argument(
        "--batch-frames", type=int, metavar="N", help="frames traced in one launch (compute.batch_frames)"
    )
    result.add_argument(
        "--overwrite", action="store_true", help="remove the data that is in the folder, and make it anew"
    )
    result.add_argument("--dry-run", action="store_true", help="say what would be made (frames, rays, bytes) and stop")
    result.add_argument(
        "--print-config", action="store_true", help="print the resolved configuration with every default and stop"
    )
    result.add_argument(
        "--print-schema", action="store_true", help="print the JSON Schema of the configuration and stop"
    )
    return result


def main(argv: Sequence[str] | None = None, prog: str = "python -m mmw.run") -> int:
    """Run the command line and return its exit code."""
    arguments = parser(prog).parse_intermixed_args(argv)
    if arguments.print_schema:
        print(json.dumps(json_schema(), indent=2))
        return 0
    if not arguments.config:
        return fail(["--config FILE is missing; a first one to try is configs/quickstart.yaml"])
    patch = {
        key: value
        for key, value in (
            ("output.dir", arguments.out),
            ("compute.device", arguments.device),
            ("compute.batch_frames", arguments.batch_frames),
        )
        if value is not None
    }
    try:
        config = load_config(arguments.config, arguments.overrides, patch)
    except ConfigError as error:
        return fail(error.problems)
    if arguments.print_config:
        print(to_yaml(config), end="")
        return 0
    try:
        return execute(config, Path(arguments.config), dry_run=arguments.dry_run, overwrite=arguments.overwrite)
    except KeyboardInterrupt:
        return fail(["interrupted; every finished shard is kept and the same command resumes"], code=1)


def execute(config: Config, path: Path, *, dry_run: bool = False, overwrite: bool = False) -> int:
    """Make (or with `dry_run` describe) the dataset of a configuration and return the exit code.

    Args:
        config: Validated configuration.
        path: The configuration file: relative `town` and `stage` paths start from its folder, messages name it.
        dry_run: Print what would be made, and stop.
        overwrite: Replace a dataset that another configuration made.
    """
    from mmw.compute.device import choose_device
    from mmw.pipeline import run
    from mmw.plan import check_inputs, describe_plan
    from mmw.provenance import check_continuation, versions
    from mmw.report import Console
    from mmw.tables.writer import OutOfSpaceError

    base = path.parent
    try:
        device = choose_device(config.compute.device)
        check_inputs(config, base)
        if dry_run:
            print(describe_plan(config, base, device))
            return 0
        with Console() as console:
            if not overwrite:
                for line in check_continuation(Path(config.output.dir), config, versions(config, base, device)):
                    console.warn_once(line)
            run(config, base=base, device=device, overwrite=overwrite, console=console)
    except ConfigError as error:
        return fail([f"{path}: {problem}" for problem in error.problems])
    except ValueError as error:
        return fail([str(error)])
    except OutOfSpaceError as error:
        return fail([str(error)], code=1)
    except OSError as error:
        return fail(
            [f"{error.filename or config.output.dir}: {error.strerror or error}; the same command resumes"], code=1
        )
    except (MemoryError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and OUT_OF_MEMORY not in str(error):
            raise
        return fail(
            [
                f"memory is full with {config.compute.batch_frames} frames a launch ({error}); every finished shard is "
                "kept; the same command with a smaller --batch-frames resumes"
            ],
            code=1,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
