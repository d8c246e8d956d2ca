"""Draw a dataset: `mmw render`."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from mmw.cli.command import run_command


def main(argv: Sequence[str], prog: str = "mmw render") -> int:
    """Run `mmw render` and return its exit code."""
    parser = argparse.ArgumentParser(
        prog=prog, description="Draw town, street, every sensor, weathers side by side and a link of a dataset."
    )
    parser.add_argument("dataset", type=Path, help="dataset folder")
    parser.add_argument("--out", type=Path, default=Path("pictures"), help="folder for the files")
    parser.add_argument("--scenario", default="", help="scenario; the first by default")
    parser.add_argument("--agent", default="", help="agent that is followed; the first CAV by default")
    parser.add_argument("--frame", type=int, default=-1, help="frame; the first by default")
    parser.add_argument("--samples", type=int, default=4, choices=(1, 4, 9), help="rays in a pixel on an edge")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N")
    return run_command(parser, _render, argv)


def _render(arguments: argparse.Namespace) -> None:
    from mmw.viz.stills.dataset_gallery import make_gallery

    names = "scenario", "agent", "frame", "samples", "device"
    options = {name: getattr(arguments, name) for name in names}
    print(*make_gallery(arguments.dataset, arguments.out, **options), sep="\n")
