"""`mmw view`: one picture of a configuration or a town, without a run."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from mmw.command import run_command

SUFFIXES = (".png", ".jpg", ".jpeg")
"""Endings of a picture's file."""


def main(argv: Sequence[str], prog: str = "mmw view") -> int:
    """Run `mmw view` and return its exit code."""
    parser = argparse.ArgumentParser(
        prog=prog,
        description="Take one picture by the RGB camera, straight from a configuration or a stage, without a run.",
    )
    parser.add_argument("--still", type=Path, metavar="OUT", help="file of the picture, .png or .jpg; needed")
    parser.add_argument("--config", type=Path, metavar="FILE", help="configuration: its town with its traffic")
    parser.add_argument("--town", default="", metavar="NAME", help="shipped town or USD file, as it is")
    parser.add_argument("--scenario", default="", help="scenario of the configuration; the first by default")
    parser.add_argument("--frame", type=int, help="frame; the first by default")
    parser.add_argument("--weather", default="", help="weather of the configuration, or preset; the first by default")
    parser.add_argument("--agent", default="", help="agent through whose --camera the picture is seen, such as cav_1")
    parser.add_argument("--camera", default="", help="RGB camera of the configuration, such as front")
    parser.add_argument("--eye", nargs=3, type=float, metavar=("X", "Y", "Z"), help="position of the eye [m]")
    parser.add_argument("--look-at", nargs=3, type=float, metavar=("X", "Y", "Z"), help="point it looks at [m]")
    parser.add_argument(
        "--follow", default="", metavar="ACTOR",
        help="actor that is followed from behind; the first CAV by default, of a town the view that sees most",
    )  # fmt: skip
    parser.add_argument("--width", type=int, help="image width [px]; the camera's, or 1280, by default")
    parser.add_argument("--height", type=int, help="image height [px]; the camera's, or 720, by default")
    parser.add_argument("--samples", type=int, choices=(1, 4, 9), help="rays in a pixel on an edge, 4 by default")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N")
    arguments = parser.parse_args(argv)
    return run_command(lambda: _view(arguments), "mmw")


def _view(arguments: argparse.Namespace) -> int:
    if arguments.still is None:
        raise ValueError("view: --still OUT.png is needed: there is no window yet, only single pictures; add it")
    if arguments.still.suffix.lower() not in SUFFIXES:
        raise ValueError(f"--still {arguments.still}: the file must end in {', '.join(SUFFIXES)}; rename it")
    if (arguments.config is None) == (not arguments.town):
        raise ValueError("view: exactly one of --config FILE and --town NAME is needed; give one")
    if arguments.town and arguments.scenario:
        raise ValueError(f"--scenario {arguments.scenario}: goes with --config, not with --town; leave it out")
    from mmw.viewing.still import PictureSize, Viewpoint, draw_scenario, draw_stage

    viewpoint = Viewpoint(arguments.agent, arguments.camera, arguments.eye, arguments.look_at, arguments.follow)
    size = PictureSize(arguments.width, arguments.height, arguments.samples)
    common = {"weather": arguments.weather, "device": arguments.device}
    if arguments.town:
        image, notes = draw_stage(arguments.town, viewpoint, size, frame=arguments.frame or 0, **common)
    else:
        image, notes = draw_scenario(
            arguments.config, viewpoint, size, scenario=arguments.scenario, frame=arguments.frame, **common
        )
    for note in notes:
        print(f"mmw: {note}", file=sys.stderr)
    arguments.still.parent.mkdir(parents=True, exist_ok=True)
    image.save(arguments.still, quality=90)  # of JPEG; PNG has none
    print(arguments.still)
    return 0
