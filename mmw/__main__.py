"""The `mmw` command. Each subcommand calls one function."""

import argparse
import sys
from collections.abc import Callable, Sequence

from mmw.core.extras import install
from mmw.core.registry import Registry

HELP = {
    "run": "make a dataset (same as python -m mmw.run)",
    "verify": "check a dataset: files, counts, physics, rows made again",
    "status": "say how far a dataset is, and which process writes it",
    "finalize": "write the manifest of a dataset whose parts were made by several runs",
    "regenerate": "make rows of a dataset again, from its stored configuration",
    "export": "write a dataset in another format: OPV2V, nuScenes, KITTI and others",
    "import": "make a town of a Mitsuba, OpenDRIVE, OSM (extra author), glTF, OBJ, PLY, STL or USD file",
    "radiomap": "trace path gain, RSS and SINR over the roads (its picture needs the extra plot)",
    "town": "build, check and draw towns (building needs the extra author, drawing plot)",
    "view": "open a dataset in the Rerun viewer (needs the extra viz), or take one picture without a run",
    "render": "draw a dataset: town, street, every sensor, weathers side by side, a link (needs the extra plot)",
    "report": "write one HTML page about a dataset: maps, pictures, links, counts, provenance",
}
"""Subcommand of mmw -> its line in the help."""

MODULES = {"import": "import_scene", "radiomap": "radio_map"}
"""Subcommand -> its module in `mmw.cli`, where it has another name."""

COMMANDS: Registry[Callable[..., int]] = Registry(
    "mmw.commands",
    "command",
    "collections.abc:Callable",
    {name: f"mmw.cli.{MODULES.get(name, name)}:main" for name in HELP},
)
"""Subcommand -> its `main(argv, prog)`, imported when it is asked for. Other packages add theirs."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the `mmw` command and return its exit code."""
    argv = list(sys.argv[1:] if argv is None else argv)
    if argv and argv[0] in COMMANDS:
        return COMMANDS[argv[0]](argv[1:], prog=f"mmw {argv[0]}")
    parser = argparse.ArgumentParser(
        prog="mmw",
        description="Multimodal wireless datasets from one configuration file.",
        epilog=f"Extras are optional packages: {install('NAME')}",
    )
    commands = parser.add_subparsers(dest="command", required=True)
    for name in COMMANDS:
        commands.add_parser(name, help=HELP.get(name) or f"from {COMMANDS.owner(name)}")
    parser.parse_args(argv)
    return 0  # never: without a known command argparse ends the process


if __name__ == "__main__":
    sys.exit(main())
