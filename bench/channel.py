"""Measure the radio path solver: `python -m bench.channel --scene street --device cuda:0`, or `--device cpu`.

One solve finds the paths of a batch of frames and brings them to the host. `--against sionna` runs Sionna RT on the
same meshes, materials, links and ray count in the same process, and matches the paths. `--links v2v` compares the cost
of all pairs of vehicles with that of one roadside unit.
"""

import argparse
import json
import statistics
import sys
import time
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from bench import sionna_run
from bench.channel_scenes import TRACKS, Course, arrays_of, make_course, make_links, street_objects, town_arrays
from bench.rays import machine
from bench.sionna_run import PathList, SionnaScene, compare
from mmw.channel.links import Links
from mmw.channel.path_solver.solver import solve_paths
from mmw.channel.path_solver.surface_table import SurfaceTable, make_surface_table
from mmw.channel.paths import PathSet
from mmw.config import ChannelConfig
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.scene.device_scene import DeviceScene

BATCH = "frames"
"""Every frame is solved: mmw takes all frames in one batch, Sionna RT one after the other with receivers moved."""

ONE_SOLVE = "one solve"
"""Static scene: the receivers of all frames stand there at once, the transmitter launches once."""

DEAF = 1e-9
"""A path weaker than this part of free space lies in a null of the pattern; Sionna RT does not list it."""


@dataclass(frozen=True)
class Result:
    """One measured line: a depth, a mode of candidates, and a mode of frames."""

    scene: str
    links: str
    depth: int
    candidates: str
    mode: str
    """`frames` or `one solve`, see `BATCH` and `ONE_SOLVE`."""
    frames: int
    paths: int
    ms_per_frame: float
    """Median of the timed solves."""
    best_ms_per_frame: float
    first_s: float
    """Seconds of the first solve, with compilation unless Warp's cache had the kernels."""
    sionna: dict[str, Any] | None = None
    """The same of Sionna RT, `ratio` (its median time over ours), and the fields of `Comparison`."""


class OwnSide:
    """mmw on one course: scene and surface table are made once."""

    def __init__(self, course: Course, device: str, options: argparse.Namespace):
        """Build the scene on a device.

        Args:
            course: Scene and antennas.
            device: Warp device.
            options: The command line.
        """
        self.course, self.options = course, options
        self.scene = DeviceScene(course.arrays, device, len(course.position))
        self.table: SurfaceTable = make_surface_table(self.scene)

    def config(self, depth: int, candidates: str) -> ChannelConfig:
        """Return the channel of a line: one carrier, and V dipoles, which are the default."""
        return ChannelConfig(
            carriers_hz=(self.options.carrier_hz,), samples_per_tx=self.options.rays,
            candidates=candidates, max_depth=depth,
        )  # fmt: skip

    def solve(self, links: Links, config: ChannelConfig) -> PathSet:
        """Load the batch and find its paths; everything returned lies on the host."""
        self.scene.load_batch(range(int(links.batch_index.max()) + 1))
        return solve_paths(self.scene, links, config, self.course.arrays.materials, self.table)

    def measure(self, kind: str, mode: str, depth: int, candidates: str) -> tuple[Result, PathList]:
        """Return one line, and its paths to compare."""
        links = make_links(self.course, kind, one_frame=mode == ONE_SOLVE)
        config, frames = self.config(depth, candidates), len(self.course.position)
        start = time.perf_counter()
        paths = self.solve(links, config)
        first = time.perf_counter() - start
        seconds = []
        for _ in range(self.options.repeats):
            start = time.perf_counter()
            self.solve(links, config)
            seconds.append(time.perf_counter() - start)
        median, best = (pick(seconds) / frames * 1e3 for pick in (statistics.median, min))
        line = Result(self.course.name, kind, depth, candidates, mode, frames, len(paths), median, best, first)
        return line, own_rows(paths, self.options.carrier_hz)


def own_rows(paths: PathSet, carrier_hz: float) -> PathList:
    """Return our paths to compare, without those in a null of the pattern."""
    length, gain = paths.tau * SPEED_OF_LIGHT, np.abs(next(iter(paths.a.values()))[:, 0])
    heard = gain > DEAF * SPEED_OF_LIGHT / (4.0 * np.pi * carrier_hz * length)
    order = paths.order.astype(np.int64)
    none = np.zeros(int(heard.sum()), dtype=bool)
    return PathList(paths.link[heard].astype(np.int64), order[heard], length[heard], gain[heard], none)


def run_v2v(own: OwnSide) -> list[Result]:
    """Measure three downlinks and all ordered pairs of four vehicles, and print both."""
    lines = []
    for depth in own.options.depth:
        for candidates in own.options.candidates:
            pair = [own.measure(kind, BATCH, depth, candidates)[0] for kind in ("v2i", "v2v")]
            for result in pair:
                print(row(result), flush=True)
            print(f"    V2V over V2I: {pair[1].ms_per_frame / pair[0].ms_per_frame:.2f} times the time", flush=True)
            lines += pair
    return lines


def run_v2i(own: OwnSide, other: SionnaScene | None) -> list[Result]:
    """Measure every depth, mode of frames and mode of candidates, Sionna RT once for each depth and mode."""
    lines, course, options = [], own.course, own.options
    for mode in (BATCH, ONE_SOLVE):
        rx = course.rx if mode == BATCH else course.rx.reshape(1, -1, 3)
        if other is not None:
            other.place(course.position[0, 0], rx.shape[1])
        for depth in options.depth:
            timing = None
            if other is not None:
                timing = other.time_solves(
                    rx, depth, options.rays, options.sionna_max_paths, options.sionna_repeats or options.repeats
                )
            for candidates in options.candidates:
                result, rows = own.measure("v2i", mode, depth, candidates)
                if timing is not None:
                    ms, best = (s * len(rx) / len(course.position) * 1e3 for s in (timing.median_s, timing.best_s))
                    about = {"ms_per_frame": ms, "best_ms_per_frame": best, "first_s": timing.first_s}
                    found = asdict(compare(rows, timing.rows))
                    result = replace(result, sionna={**about, "ratio": ms / result.ms_per_frame, **found})
                print(row(result), flush=True)
                lines.append(result)
    return lines


HEADER = "links depth candidates mode        paths   ms/frame  first s"
HEADER_SIONNA = (
    "   Sionna: paths repeated  ms/frame  first s   ratio | matched  ours only  Sionna only  worst |a|  median |a|"
)


def row(result: Result) -> str:
    """Return one line of the table."""
    text = (
        f"{result.links:5} {result.depth:5d} {result.candidates:10} {result.mode:9} {result.paths:7d} "
        f"{result.ms_per_frame:10.3f} {result.first_s:8.2f}"
    )
    if result.sionna is None:
        return text
    s = result.sionna
    return (
        f"{text}          {s['other']:6d} {s['repeated']:8d} {s['ms_per_frame']:9.3f} {s['first_s']:8.2f} "
        f"{s['ratio']:7.1f} | {s['matched']:7d} {s['only_own']:10d} {s['only_other']:12d} "
        f"{s['gain_worst']:10.1e} {s['gain_median']:11.1e}"
    )


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(prog="python -m bench.channel", description="Measure the radio path solver.")
    parser.add_argument("--device", default="cuda:0" if wp.get_cuda_device_count() else "cpu", help="cpu or cuda:N")
    parser.add_argument("--format", choices=("human", "json"), default="human", help="json: all results as last line")
    parser.add_argument("--scene", choices=sorted(TRACKS), default="street", help="munich needs Sionna RT")
    parser.add_argument("--frames", type=int, default=64, help="frames in a batch, 10 ms apart")
    parser.add_argument("--rays", type=int, default=1_000_000, help="rays of a transmitter and frame")
    parser.add_argument("--depth", type=_numbers, default=[1], help="largest number of reflections, such as 1,3")
    parser.add_argument(
        "--candidates", type=_modes, default=["launch"], help="launch, exhaustive, or both with a comma"
    )
    parser.add_argument("--carrier-hz", type=float, default=28e9, help="carrier frequency")
    parser.add_argument("--links", choices=("v2i", "v2v"), default="v2i", help="v2v: pairs of vehicles beside v2i")
    parser.add_argument("--repeats", type=int, default=5, help="timed solves; the median counts")
    parser.add_argument("--against", choices=("sionna",), help="run Sionna RT too and match the paths")
    parser.add_argument("--sionna-device", help="cpu or cuda:N (as --device if absent)")
    parser.add_argument("--sionna-threads", type=int, help="CPU threads of Sionna RT (all if absent)")
    parser.add_argument("--sionna-repeats", type=int, help="timed passes of Sionna RT (as --repeats if absent)")
    parser.add_argument("--sionna-max-paths", type=int, default=sionna_run.SIONNA_PATHS, help="max_num_paths_per_src")
    options = parser.parse_args(arguments)
    if options.links == "v2v" and options.against:
        parser.error("--links v2v with --against sionna: the comparison has v2i links only; leave one out")
    for name in ("frames", "repeats"):
        if getattr(options, name) < 1:
            parser.error(f"--{name} {getattr(options, name)}: at least 1 is needed")
    return options


def _numbers(text: str) -> list[int]:
    return [int(part) for part in text.split(",")]


def _modes(text: str) -> list[str]:
    modes = text.split(",")
    if not set(modes) <= {"launch", "exhaustive"}:
        raise argparse.ArgumentTypeError(f"{text!r}: launch, exhaustive, or both with a comma")
    return modes


def main(arguments: list[str]) -> None:
    """Measure and print."""
    wp.config.log_level = wp.LOG_WARNING
    options = parse(arguments)
    other = None
    if options.against or options.scene == "munich":
        reason = sionna_run.missing()
        if reason:
            print(reason)
            if options.scene == "munich":
                return
        else:
            try:
                other = SionnaScene(options.sionna_device or options.device, options.sionna_threads)
            except ImportError as error:
                raise SystemExit(
                    f"--against sionna: its back end does not start: {error}; {sionna_run.INSTALL}"
                ) from None
    if options.scene == "munich":
        assert other is not None
        arrays = arrays_of(other.builtin_objects("munich"))
    else:
        arrays = arrays_of(street_objects()) if options.scene == "street" else town_arrays(options.scene)
    course = make_course(options.scene, arrays, options.frames)
    if not options.against:
        other = None
    if other is not None and options.scene == "munich":
        other.load_builtin("munich", options.carrier_hz)
    elif other is not None:
        other.load_arrays(arrays, options.carrier_hz)
    own = OwnSide(course, options.device, options)
    about = {**machine(options.device), "rays": options.rays, "carrier_hz": options.carrier_hz}
    if other is not None:
        where = f"{other.threads} threads" if other.threads else options.sionna_device or options.device
        about |= {"sionna": f"{other.name}, {where}"}
    print(", ".join(f"{key} {value}" for key, value in about.items()))
    print(f"{options.scene}: {len(arrays.faces):,} triangles, {len(own.table):,} surfaces, {options.frames} frames")
    print(HEADER + (HEADER_SIONNA if other is not None else ""))
    lines = run_v2v(own) if options.links == "v2v" else run_v2i(own, other)
    if options.format == "json":
        print(json.dumps({**about, "results": [asdict(line) for line in lines]}))


if __name__ == "__main__":
    main(sys.argv[1:])
