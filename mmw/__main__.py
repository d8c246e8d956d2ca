"""The `mmw` command. Each subcommand calls one function."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from mmw.command import run_command


def main(argv: Sequence[str] | None = None) -> int:
    """Run the `mmw` command and return its exit code."""
    argv = list(sys.argv[1:] if argv is None else argv)
    if argv and argv[0] == "run":
        from mmw.run import main as run_main

        return run_main(argv[1:], prog="mmw run")
    if argv and argv[0] == "radiomap":
        from mmw.radio_map_command import main as map_main

        return map_main(argv[1:], prog="mmw radiomap")
    if argv and argv[0] == "town":
        from mmw.town_command import main as town_main

        return town_main(argv[1:], prog="mmw town")
    if argv and argv[0] == "view":
        from mmw.view_command import main as view_main

        return view_main(argv[1:], prog="mmw view")
    if argv and argv[0] == "import":
        from mmw.import_command import main as import_main

        return import_main(argv[1:], prog="mmw import")
    if argv and argv[0] == "export":
        from mmw.export_command import main as export_main

        return export_main(argv[1:], prog="mmw export")
    if argv and argv[0] == "verify":
        from mmw.verify_command import main as verify_main

        return verify_main(argv[1:], prog="mmw verify")
    if argv and argv[0] == "row":
        from mmw.row_command import main as row_main

        return row_main(argv[1:], prog="mmw row")
    parser = argparse.ArgumentParser(
        prog="mmw", description="Multimodal wireless datasets from one configuration file."
    )
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("run", help="make a dataset (same as python -m mmw.run)")
    commands.add_parser("radiomap", help="trace path gain, RSS and SINR over the roads (picture: needs mmw[plot])")
    commands.add_parser("town", help="build, check and draw towns (building needs mmw[author], drawing mmw[plot])")
    commands.add_parser("view", help="take one picture of a configuration or a town, without a run")
    commands.add_parser(
        "import", help="make a town of a Mitsuba, OpenDRIVE, OSM (mmw[author]), glTF, OBJ, PLY, STL or USD file"
    )
    commands.add_parser("export", help="write a dataset in another format: OPV2V, nuScenes, KITTI and others")
    commands.add_parser("verify", help="check a dataset: files, counts, physics, rows made again")
    commands.add_parser("row", help="make rows of a dataset again, from its stored configuration")
    pictures = commands.add_parser(
        "pictures", help="draw a dataset: town, street, every sensor, weathers side by side, a link (needs mmw[plot])"
    )
    pictures.add_argument("dataset", type=Path, help="dataset folder")
    pictures.add_argument("--out", type=Path, default=Path("pictures"), help="folder for the files")
    pictures.add_argument("--scenario", default="", help="scenario; the first by default")
    pictures.add_argument("--agent", default="", help="agent that is followed; the first CAV by default")
    pictures.add_argument("--frame", type=int, default=-1, help="frame; the first by default")
    pictures.add_argument("--samples", type=int, default=4, choices=(1, 4, 9), help="rays in a pixel on an edge")
    pictures.add_argument("--device", default="auto", help="auto, cpu or cuda:N")
    arguments = parser.parse_args(argv)
    work = {"pictures": _pictures}[arguments.command]
    return run_command(lambda: work(arguments), "mmw[plot]")


def _pictures(arguments: argparse.Namespace) -> int:
    from mmw.viewing.gallery import make_gallery

    options = {name: value for name, value in vars(arguments).items() if name not in ("command", "dataset", "out")}
    print(*make_gallery(arguments.dataset, arguments.out, **options), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
