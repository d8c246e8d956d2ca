"""Draw pictures of the shipped scenarios: `python -m mmw.cli.scenario_gallery --out FOLDER`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from mmw.cli.command import run_command
from mmw.viz.stills.scenario_gallery import FRAME, draw_scenarios


def main(argv: Sequence[str] | None = None) -> int:
    """Draw the gallery and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m mmw.cli.scenario_gallery", description="Draw the gallery.")
    parser.add_argument("scenarios", nargs="*", help="shipped scenarios; all by default")
    parser.add_argument("--out", type=Path, required=True, help="folder for the JPEG files")
    parser.add_argument("--frame", type=int, default=FRAME, help="frame that is shown")
    parser.add_argument("--agent", default="cav_1", help="CAV whose cameras are shown")
    parser.add_argument("--samples", type=int, default=9, choices=(1, 4, 9), help="rays in a pixel on an edge")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N")
    return run_command(parser, _draw, argv)


def _draw(arguments: argparse.Namespace) -> None:
    options = {name: getattr(arguments, name) for name in ("frame", "agent", "samples", "device")}
    draw_scenarios(arguments.out, arguments.scenarios, **options)


if __name__ == "__main__":
    sys.exit(main())
