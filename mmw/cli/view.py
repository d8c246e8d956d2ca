"""Open a dataset in the Rerun viewer, or draw one picture of a configuration or a town without a run: `mmw view`."""

import argparse
import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from mmw.cli.command import run_command
from mmw.config.shipped import CONFIG_HELP
from mmw.core.errors import InputError

SUFFIXES = (".png", ".jpg", ".jpeg")
"""Endings of a picture's file."""

DATASET_ONLY = ("frames", "agents", "lidar_color", "save", "web", "port", "no_town", "no_beams")
"""Options that go with a dataset."""

STILL_ONLY = (
    "config", "town", "frame", "agent", "camera", "eye", "look_at", "follow", "width", "height", "samples", "device",
)  # fmt: skip
"""Options that go with `--still`."""


def main(argv: Sequence[str], prog: str = "mmw view") -> int:
    """Run `mmw view` and return its exit code."""
    return run_command(_parser(prog), lambda given: _still(given) if given.root is None else _dataset(given), argv)


def _parser(prog: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=prog,
        description="Open a dataset in the Rerun viewer (docs/guides/viewer.md), or draw one picture by the RGB "
        "camera, straight from a configuration or a stage, without a run (docs/getting-started/gallery.md).",
    )
    parser.add_argument("root", nargs="?", metavar="ROOT", help="dataset folder, or a URI such as s3://bucket/folder")
    parser.add_argument("--scenario", default="", help="scenario; the first by default")
    parser.add_argument(
        "--weather", default="", help="weather of the dataset or configuration, or of a picture a preset"
    )

    shown = parser.add_argument_group("a dataset (needs the extra viz)")
    shown.add_argument("--frames", metavar="A:B[:STEP]", help="frames A to B - 1; all by default, thinned to 200")
    shown.add_argument("--agents", metavar="A,B", help="agents whose sensors and links are shown; all by default")
    shown.add_argument("--lidar-color", metavar="BY", help="object (default), class, intensity or label")
    shown.add_argument("--no-town", action="store_true", help="leave the town's buildings and roads out")
    shown.add_argument("--no-beams", action="store_true", help="leave the search for best beams out")
    shown.add_argument("--save", type=Path, metavar="FILE.rrd", help="write a recording, open nothing")
    shown.add_argument("--web", action="store_true", help="serve the web viewer on 127.0.0.1 until Ctrl+C")
    shown.add_argument("--port", type=int, help="of the web viewer; data come over the next; 9090 by default")

    still = parser.add_argument_group("one picture")
    still.add_argument("--still", type=Path, metavar="OUT", help="file of the picture, .png or .jpg")
    still.add_argument("--config", type=Path, metavar="FILE", help=f"{CONFIG_HELP}: its town with its traffic")
    still.add_argument("--town", metavar="NAME", help="shipped town or USD file, as it is")
    still.add_argument("--frame", type=int, help="frame; the first by default")
    still.add_argument("--agent", help="agent through whose --camera the picture is seen, such as cav_1")
    still.add_argument("--camera", help="RGB camera of the configuration, such as front")
    still.add_argument("--eye", nargs=3, type=float, metavar=("X", "Y", "Z"), help="position of the eye [m]")
    still.add_argument("--look-at", nargs=3, type=float, metavar=("X", "Y", "Z"), help="point it looks at [m]")
    still.add_argument(
        "--follow", metavar="ACTOR",
        help="actor that is followed from behind; the first CAV by default, of a town the view that sees most",
    )  # fmt: skip
    still.add_argument("--width", type=int, help="image width [px]; the camera's, or 1280, by default")
    still.add_argument("--height", type=int, help="image height [px]; the camera's, or 720, by default")
    still.add_argument("--samples", type=int, choices=(1, 4, 9), help="rays in a pixel on an edge, 4 by default")
    still.add_argument("--device", help="auto (default), cpu or cuda:N")
    return parser


def _refuse(arguments: argparse.Namespace, names: Sequence[str], where: str) -> None:
    """Raise for the first option that was given and does not belong here."""
    for name in names:
        if getattr(arguments, name) not in (None, False):
            raise InputError(f"view: --{name.replace('_', '-')} goes with {where}; leave it out")


def _dataset(arguments: argparse.Namespace) -> None:
    if arguments.still is not None:
        raise InputError(
            "view: --still draws a picture of --config FILE or --town NAME, not of a dataset; leave one out"
        )
    _refuse(arguments, STILL_ONLY, "--still")
    if arguments.save is not None and arguments.web:
        raise InputError("view: --save and --web: a recording is written or served; give one")
    if arguments.port is not None and not arguments.web:
        raise InputError(f"view: --port {arguments.port} goes with --web; add it")
    from mmw.cli.export import frames_of
    from mmw.dataset import BeamSearch, open_dataset
    from mmw.viz.rerun.recording import Looks
    from mmw.viz.rerun.selection import choose_scope
    from mmw.viz.rerun.viewer import PORT, native_viewer, save, web_viewer

    looks = Looks(
        arguments.lidar_color or "object", not arguments.no_town, None if arguments.no_beams else BeamSearch()
    )
    scope = choose_scope(
        open_dataset(arguments.root),
        scenario=arguments.scenario,
        weather=arguments.weather,
        frames=frames_of(arguments.frames) if arguments.frames else None,
        agents=[name for name in (arguments.agents or "").split(",") if name],
    )
    if arguments.save is not None:
        _note(save(scope, looks, arguments.save))
        print(arguments.save)
        return
    opened = web_viewer(PORT if arguments.port is None else arguments.port) if arguments.web else native_viewer()
    with opened as viewer, suppress(KeyboardInterrupt):  # Ctrl+C is how the web viewer is ended
        if viewer.url:
            print(viewer.url, flush=True)
        _note(viewer.send(scope, looks))
        viewer.wait()


def _note(lines: Iterable[str]) -> None:
    for line in lines:
        print(f"mmw: {line}", file=sys.stderr, flush=True)


def _still(arguments: argparse.Namespace) -> None:
    if arguments.still is None:
        raise InputError("view: a dataset folder or --still OUT.png is needed; give one")
    _refuse(arguments, DATASET_ONLY, "a dataset folder")
    if arguments.still.suffix.lower() not in SUFFIXES:
        raise InputError(f"--still {arguments.still}: the file must end in {', '.join(SUFFIXES)}; rename it")
    if (arguments.config is None) == (not arguments.town):
        raise InputError("view: exactly one of --config FILE and --town NAME is needed; give one")
    if arguments.town and arguments.scenario:
        raise InputError(f"--scenario {arguments.scenario}: goes with --config, not with --town; leave it out")
    from mmw.viz.stills.still import Viewpoint, draw_scenario, draw_stage

    viewpoint = Viewpoint(
        arguments.agent or "", arguments.camera or "", arguments.eye, arguments.look_at, arguments.follow or ""
    )
    given = {"width_px": arguments.width, "height_px": arguments.height, "samples": arguments.samples}
    size = {key: value for key, value in given.items() if value is not None}
    common = {"weather": arguments.weather, "device": arguments.device or "auto"}
    if arguments.town:
        image, notes = draw_stage(arguments.town, viewpoint, size, frame=arguments.frame or 0, **common)
    else:
        image, notes = draw_scenario(
            arguments.config, viewpoint, size, scenario=arguments.scenario, frame=arguments.frame, **common
        )
    _note(notes)
    arguments.still.parent.mkdir(parents=True, exist_ok=True)
    image.save(arguments.still, quality=90)  # of JPEG; PNG has none
    print(arguments.still)
