"""`python -m examples.beam_prediction --config FILE --data DATASET --out OUT [key=value ...]`: the whole experiment.

Three steps, each of which makes what is missing: the cache of labels and features, every run of the matrix of input
sets and seeds, and the report. The same command again goes on where it stopped.

Exit codes: 0 done, 2 bad input, 1 failure while running, 3 time was up; the same command goes on.
"""

import argparse
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mmw.cli.command import run_command
from mmw.core.errors import InputError

if TYPE_CHECKING:
    import torch

STEPS = ("prepare", "train", "report")


def parser() -> argparse.ArgumentParser:
    """Return the command line's parser."""
    result = argparse.ArgumentParser(
        prog="python -m examples.beam_prediction", description="Multimodal beam prediction"
    )
    default = Path(__file__).with_name("experiment.yaml")
    result.add_argument("--config", type=Path, default=default, metavar="FILE", help="experiment (experiment.yaml)")
    result.add_argument(
        "--data", type=Path, metavar="DATASET", help="dataset; once the cache is there, for the report's images"
    )
    result.add_argument(
        "--more", type=Path, nargs="+", default=(), metavar="DATASET", help="datasets that train alone (other `seed`)"
    )
    result.add_argument("--out", type=Path, required=True, metavar="DIR", help="where runs and report go")
    result.add_argument("--cache", type=Path, metavar="DIR", help="labels and features (OUT/cache)")
    result.add_argument(
        "--device", default="auto", metavar="NAME", help="auto (the first GPU, else the CPU), cpu, cuda"
    )
    result.add_argument("--workers", type=int, default=os.cpu_count(), help="processes that make the cache (all cores)")
    result.add_argument("--minutes", type=float, default=float("inf"), help="begin no epoch after this time")
    result.add_argument("--steps", type=steps_of, default=STEPS, metavar="a,b", help=f"of {', '.join(STEPS)} (all)")
    result.add_argument("overrides", nargs="*", metavar="key=value", help="replace values: training.epochs=2")
    return result


def steps_of(text: str) -> tuple[str, ...]:
    """Return the steps of a list with commas.

    Raises:
        argparse.ArgumentTypeError: If one is none of `STEPS`.
    """
    steps = tuple(text.split(","))
    if not set(steps) <= set(STEPS):
        raise argparse.ArgumentTypeError(f"{text!r}; steps are {', '.join(STEPS)}, with commas between them")
    return steps


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    return run_command(parser(), execute, argv, intermixed=True)


def execute(arguments: argparse.Namespace) -> int:
    """Do the steps that are asked for."""
    from examples.beam_prediction.cache import prepare
    from examples.beam_prediction.config import load_experiment

    deadline = time.monotonic() + 60.0 * arguments.minutes
    experiment = load_experiment(arguments.config, arguments.overrides)
    cache = arguments.cache or arguments.out / "cache"
    if "prepare" in arguments.steps:
        prepare(experiment, arguments.data, cache, arguments.workers, arguments.more)
    if not {"train", "report"} & set(arguments.steps):
        return 0

    import torch

    from examples.beam_prediction.data import load_data
    from examples.beam_prediction.report import write_report
    from examples.beam_prediction.training import runs_of, train
    from mmw.dataset import open_dataset

    device = pick_device(arguments.device)
    torch.set_float32_matmul_precision("high")
    data = load_data(cache, experiment, device)
    runs, done = runs_of(experiment), []
    print(f"data: {', '.join(f'{part} {len(rows):,}' for part, rows in data.starts.items())} windows on {device}")
    for run in runs if "train" in arguments.steps else ():
        done.append(time.monotonic() < deadline and train(run, experiment, data, arguments.out / "runs", deadline))
    if "report" in arguments.steps:
        dataset = open_dataset(arguments.data) if arguments.data else None
        print(f"report: {write_report(arguments.out, experiment, data, dataset)}")
    if not all(done):
        print(f"time was up: {sum(done)} of {len(runs)} runs are finished; the same command goes on")
        return 3
    return 0


def pick_device(name: str) -> "torch.device":
    """Return the device of that name.

    Raises:
        InputError: If a GPU is asked for and there is none.
    """
    import torch

    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    if name.startswith("cuda") and not torch.cuda.is_available():
        raise InputError(f"--device {name}: PyTorch sees no GPU; give cpu")
    return torch.device(name)


if __name__ == "__main__":
    sys.exit(main())
