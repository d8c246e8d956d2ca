"""Build, check and draw towns: `mmw town`."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from mmw.cli.command import run_command
from mmw.core.errors import InputError


def main(argv: Sequence[str], prog: str = "mmw town") -> int:
    """Run a subcommand of `mmw town` and return its exit code."""
    parser = argparse.ArgumentParser(prog=prog, description="Build, check and draw towns.")
    commands = parser.add_subparsers(dest="command", required=True)
    build = commands.add_parser(
        "build", help="build a town from its YAML description (needs the extra author)",
        description="Build the USD asset of a town from its YAML description (docs/guides/towns.md). "
        "Needs the extra author.",
    )  # fmt: skip
    build.set_defaults(work=_build)
    build.add_argument("description", help="the town's YAML file, or the name of a shipped town")
    build.add_argument("--out", type=Path, help="folder for the built asset; the description's own by default")
    check = commands.add_parser(
        "check", help="check a town, or any USD stage; exit code 1 if there are errors",
        description="List what is wrong with a town, or any USD stage: where, and what to do "
        "(docs/guides/towns.md). Exit codes: 0 no errors, 1 errors, 2 a file that cannot be read.",
    )  # fmt: skip
    check.set_defaults(work=_check)
    check.add_argument("stage", help="USD file, or the name of a shipped town")
    check.add_argument("--json", action="store_true", help="print the findings as one JSON object")
    check.add_argument("--all", action="store_true", help="list hidden faces that touch one by one")
    check.add_argument(
        "--material-map", action="append", default=[], metavar="GLOB=ROW",
        help="radio material for meshes without one, such as '/World/Wall*=itu_concrete'; may be repeated",
    )  # fmt: skip
    render = commands.add_parser(
        "render", help="draw a town: from above, three streets, its lanes (needs the extra plot)",
        description="Draw a town, or any USD stage, by the RGB camera, from above and in three streets, and its lanes.",
    )  # fmt: skip
    render.set_defaults(work=_render)
    render.add_argument("stage", help="USD file, or the name of a shipped town")
    render.add_argument("--out", type=Path, default=Path("pictures"), help="folder for the files")
    render.add_argument(
        "--at", nargs=4, type=float, action="append", default=[], metavar=("X", "Y", "Z", "YAW"),
        help="eye of a street view [m] and its direction [deg, counter-clockwise from east]; up to three times",
    )  # fmt: skip
    render.add_argument("--samples", type=int, default=4, choices=(1, 4, 9), help="rays in a pixel on an edge")
    render.add_argument("--device", default="auto", help="auto, cpu or cuda:N")
    return run_command(parser, lambda arguments: arguments.work(arguments), argv)


def _build(arguments: argparse.Namespace) -> None:
    from mmw.physics.materials.itu_rows import RADIO_ROWS
    from mmw.worlds.towns.build import build_shipped_town, build_town

    path = Path(arguments.description)
    if path.suffix in (".yaml", ".yml"):
        print(build_town(path, arguments.out or path.parent, radio_rows=RADIO_ROWS))
    else:
        print(build_shipped_town(arguments.description, arguments.out))


def _check(arguments: argparse.Namespace) -> int:
    from mmw.core.device import choose_device
    from mmw.physics.materials.itu_rows import RADIO_ROWS
    from mmw.worlds.checks.check import check_stage, stage_path

    choose_device("cpu")  # and suppress Warp's own lines in the output
    wrong = [entry for entry in arguments.material_map if "=" not in entry]
    if wrong:
        raise InputError(f"--material-map {wrong[0]}: GLOB=ROW is needed, such as '/World/Wall*=itu_concrete'")
    rows = dict(entry.rsplit("=", 1) for entry in arguments.material_map)
    for glob, row in rows.items():
        if row not in RADIO_ROWS:
            raise InputError(f"--material-map {glob}={row}: no radio material; use one of {', '.join(RADIO_ROWS)}")
    report = check_stage(stage_path(arguments.stage), rows)
    if arguments.json:
        counts = {f"{severity}s": report.count(severity) for severity in ("error", "warning")}
        records = [finding.record() for finding in report.findings]
        print(json.dumps({"stage": str(report.path), **counts, "findings": records}, indent=1))
    else:
        hidden = [finding for finding in report.findings if finding.rule == "touching" and not arguments.all]
        print(*(finding for finding in report.findings if finding not in hidden), sep="\n")
        if hidden:
            print(f"info: touching: {len(hidden)} pairs of prims share hidden faces; --all lists them")
        print(report.summary)
    return 1 if report.count("error") else 0


def _render(arguments: argparse.Namespace) -> None:
    from mmw.viz.stills.town_gallery import draw_town
    from mmw.worlds.checks.check import stage_path

    path, views = stage_path(arguments.stage), [tuple(view) for view in arguments.at]
    files = draw_town(path, arguments.out, views=views, samples=arguments.samples, device=arguments.device)
    print(*files, sep="\n")
