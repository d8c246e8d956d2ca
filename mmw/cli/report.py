"""Write one HTML page about a dataset: `mmw report`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from mmw.cli.command import printable, run_command


def main(argv: Sequence[str], prog: str = "mmw report") -> int:
    """Run `mmw report` and return its exit code."""
    parser = argparse.ArgumentParser(
        prog=prog,
        description="Write one self-contained HTML page about a dataset, finished or not: maps, contact sheets, links "
        "over time, delays, angles and beams, counts and sizes, a quick check, provenance.",
        epilog="docs/guides/viewer.md describes the page. Exit codes: 0 done, 2 a folder, file or scenario that cannot "
        "be used, 1 failure while running.",
    )
    parser.add_argument("dataset", help="dataset folder")
    parser.add_argument("--out", type=Path, default=Path("report.html"), metavar="FILE.html", help="file to write")
    parser.add_argument(
        "--scenario", action="append", default=[], metavar="A,B", help="scenarios to show; all by default"
    )
    parser.add_argument("--force", action="store_true", help="replace a file that mmw report did not write")
    return run_command(parser, _report, argv)


def _report(arguments: argparse.Namespace) -> None:
    from mmw.viz.report import make_report

    names = [name for item in arguments.scenario for name in item.split(",") if name]
    make_report(
        arguments.dataset, arguments.out, scenarios=names, force=arguments.force,
        tell=lambda line: print(f"mmw: {printable(line)}", file=sys.stderr),
    )  # fmt: skip
    print(arguments.out)
