"""`python -m mmw.run --config FILE [key=value ...]`: parse, load, check, hand over to the pipeline; nothing else.

Exit codes: 0 done, 2 bad configuration or input (one line a problem), 1 failure while running (a rerun resumes).
"""

import argparse
import json
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

from mmw.cli.command import add_log_options, fail, run_command
from mmw.config import CONFIG_HELP, Config, ConfigError, config_path, load_config
from mmw.config.load import json_schema, to_yaml
from mmw.core.errors import OutOfMemoryError
from mmw.generation.executors.process_pool import import_ahead, may_be_several

LOGGER = logging.getLogger(__name__)


def parser(prog: str = "python -m mmw.run") -> argparse.ArgumentParser:
    """Return the command line's parser."""
    result = argparse.ArgumentParser(
        prog=prog,
        description="Make a multimodal wireless dataset from one configuration file.",
        epilog="A first run, without a GPU: %(prog)s --config quickstart --out out/first. The same "
        "command again resumes. Exit codes: 0 done, 2 bad configuration or input, 1 failure while running.",
    )
    result.add_argument("--config", required=False, metavar="FILE", help=CONFIG_HELP)
    result.add_argument(
        "overrides",
        nargs="*",
        metavar="key=value",
        help="replace values; items of lists by name or number, * for all, values as YAML: frames.count=10 "
        "sensors.lidar.range_m=80 'weathers=[sunny, rainy]' 'scenarios.*.traffic.warmup_s=5'",
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
        help="make part i of N, counted from 0: for N runs of a scheduler's array that fill one folder",
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
    return add_log_options(result)


def main(argv: Sequence[str] | None = None, prog: str = "python -m mmw.run") -> int:
    """Run the command line and return its exit code."""
    arguments = parser(prog).parse_intermixed_args(argv)
    if arguments.print_schema:
        print(json.dumps(json_schema(), indent=2))
        return 0
    if not arguments.config:
        return fail(["--config FILE is missing; a first one to try is --config quickstart"])
    patch = {
        key: value
        for key, value in (
            ("output.dir", arguments.out),
            ("compute.engine", arguments.engine),
            ("compute.device", arguments.device),
            ("compute.batch_frames", arguments.batch_frames),
            ("compute.workers", int(arguments.workers) if str(arguments.workers).isdecimal() else arguments.workers),
        )
        if value is not None
    }
    options = {"dry_run": arguments.dry_run, "overwrite": arguments.overwrite, "shard": arguments.shard}

    def work() -> int:
        LOGGER.info("configuration %s, overrides %s, options %s", arguments.config, arguments.overrides, patch)
        path = config_path(arguments.config)
        config = load_config(path, arguments.overrides, patch)
        if arguments.print_config:
            print(to_yaml(config), end="")
            return 0
        return execute(config, path, **options)

    return run_command(
        work,
        prog,
        debug=arguments.debug,
        interrupted="interrupted; every finished shard is kept and the same command resumes",
        kept="every finished shard is kept and the same command resumes",
    )


def execute(config: Config, path: Path, *, dry_run: bool = False, overwrite: bool = False, shard: str = "0/1") -> int:
    """Make (or with `dry_run` describe) the dataset of a configuration and return the exit code.

    Args:
        config: Validated configuration.
        path: The configuration file: relative `town` and `stage` paths start from its folder, messages name it.
        dry_run: Print what would be made, and stop.
        overwrite: Replace a dataset that another configuration made.
        shard: Make only this part of it, `i/N`.

    Raises:
        InputError: If the configuration or a file that it names cannot be used.
        Error: If the disk or the memory is full, workers die, or a store cannot be reached.
    """
    if not dry_run and may_be_several(config.compute, config.frame_total):
        import_ahead()
    from mmw.core.device import worker_devices
    from mmw.generation.estimate import check_inputs, describe_plan
    from mmw.generation.executors.executor import open_engine
    from mmw.generation.generate import generate_dataset, output_of
    from mmw.generation.pipeline import is_out_of_memory
    from mmw.generation.progress import Console
    from mmw.generation.provenance import check_continuation, versions
    from mmw.generation.shards import Partition
    from mmw.storage.atomic_files import StoreError

    base = path.parent
    try:
        part = Partition.parse(shard)
        root = output_of(config, part)
        check_inputs(config, base)
        if dry_run:
            compute = config.compute
            is_local = compute.engine == "local"
            where = worker_devices(compute.device, compute.workers)[0] if is_local else "a Ray cluster"
            print(describe_plan(config, base, where))
            return 0
        with Console() as console, open_engine(config.compute, console) as engine:
            root.check()
            if not overwrite:
                made_with = versions(config, base, engine.machine)
                for line in check_continuation(root, config, made_with):
                    console.warn_once(line)
            generate_dataset(config, base=base, engine=engine, part=part, overwrite=overwrite, console=console)
    except ConfigError as error:
        raise ConfigError([f"{path}: {problem}" for problem in error.problems]) from error
    except StoreError as error:
        raise StoreError(f"{error}; everything that is finished is kept, and the same command resumes") from error
    except (MemoryError, RuntimeError) as error:
        if not is_out_of_memory(error):
            raise
        raise OutOfMemoryError(
            f"memory is full with a single frame a launch ({error}); every finished shard is kept; make room, or "
            "use fewer --workers or compute.writer_threads; the same command resumes"
        ) from error
    return 0


if __name__ == "__main__":
    sys.exit(main())
