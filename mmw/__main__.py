"""The `mmw` command. Each subcommand calls one function."""

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from mmw.cli.command import add_log_options, run_command
from mmw.core.extras import install

COMMANDS = {
    "run": "mmw.cli.run",
    "radiomap": "mmw.cli.radio_map",
    "town": "mmw.cli.town",
    "view": "mmw.cli.view",
    "import": "mmw.cli.import_scene",
    "export": "mmw.cli.export",
    "verify": "mmw.cli.verify",
    "row": "mmw.cli.row",
    "report": "mmw.cli.report",
    "status": "mmw.cli.status",
    "finalize": "mmw.cli.finalize",
}
"""Subcommand -> the module whose `main` parses and does it, imported when it is asked for."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the `mmw` command and return its exit code."""
    argv = list(sys.argv[1:] if argv is None else argv)
    if argv and argv[0] in COMMANDS:
        return import_module(COMMANDS[argv[0]]).main(argv[1:], prog=f"mmw {argv[0]}")
    parser = argparse.ArgumentParser(
        prog="mmw",
        description="Multimodal wireless datasets from one configuration file.",
        epilog=f"Extras are optional packages: {install('NAME')}",
    )
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("run", help="make a dataset (same as python -m mmw.run)")
    commands.add_parser(
        "radiomap", help="trace path gain, RSS and SINR over the roads (its picture needs the extra plot)"
    )
    commands.add_parser("town", help="build, check and draw towns (building needs the extra author, drawing plot)")
    commands.add_parser(
        "view", help="open a dataset in the Rerun viewer (needs the extra viz), or take one picture without a run"
    )
    commands.add_parser(
        "import", help="make a town of a Mitsuba, OpenDRIVE, OSM (extra author), glTF, OBJ, PLY, STL or USD file"
    )
    commands.add_parser("export", help="write a dataset in another format: OPV2V, nuScenes, KITTI and others")
    commands.add_parser("status", help="say how far a dataset is, and who writes it")
    commands.add_parser("finalize", help="write the manifest of a dataset whose parts were made by several runs")
    commands.add_parser("report", help="write one HTML page about a dataset: maps, pictures, links, counts, provenance")
    commands.add_parser("verify", help="check a dataset: files, counts, physics, rows made again")
    commands.add_parser("row", help="make rows of a dataset again, from its stored configuration")
    pictures = commands.add_parser(
        "pictures",
        help="draw a dataset: town, street, every sensor, weathers side by side, a link (needs the extra plot)",
    )
    pictures.add_argument("dataset", type=Path, help="dataset folder")
    pictures.add_argument("--out", type=Path, default=Path("pictures"), help="folder for the files")
    pictures.add_argument("--scenario", default="", help="scenario; the first by default")
    pictures.add_argument("--agent", default="", help="agent that is followed; the first CAV by default")
    pictures.add_argument("--frame", type=int, default=-1, help="frame; the first by default")
    pictures.add_argument("--samples", type=int, default=4, choices=(1, 4, 9), help="rays in a pixel on an edge")
    pictures.add_argument("--device", default="auto", help="auto, cpu or cuda:N")
    add_log_options(pictures)
    arguments = parser.parse_args(argv)
    return run_command(lambda: _pictures(arguments), "mmw pictures", debug=arguments.debug)


def _pictures(arguments: argparse.Namespace) -> int:
    from mmw.viz.stills.dataset_gallery import make_gallery

    names = "scenario", "agent", "frame", "samples", "device"
    options = {name: getattr(arguments, name) for name in names}
    print(*make_gallery(arguments.dataset, arguments.out, **options), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
