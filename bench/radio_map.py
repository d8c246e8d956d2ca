"""Time radio maps on a plane: `python -m bench.radio_map [--device cuda:0] [--cells 1e4,1e5] [--depth 1,2]`.

Prints one line of JSON a setting: seconds of one call, seconds of the processor in it (what a busy machine does not
change), cells a second of all transmitters, and the share of cells that is reached. Kernels are compiled and the tables
of the scene made before.
"""

import argparse
import json
import time

import mmw
from mmw.channel import plane_grid

CENTER_M = (13.5, -29.5, 1.5)
"""Middle of the plane, below the first transmitter [m]: the roundabout of Town03."""

CELL_M = 2.0
"""Side of a cell [m]."""

PLACES_M = ((13.5, -29.5, 10.0), (-60.0, 8.0, 4.0), (2.0, 60.0, 6.0), (70.0, -6.0, 6.0))
"""Transmitters, in the order in which `--transmitters` takes them [m]."""


def measure(scene: mmw.Scene, cells: int, options: dict) -> dict:
    """Return the figures of one map of about `cells` cells."""
    side = CELL_M * round(cells**0.5)
    solver = mmw.RadioMapSolver(**options)
    surface = plane_grid(CENTER_M, (side, side), CELL_M)
    began, worked = time.perf_counter(), time.process_time()
    result = solver(scene, carrier_hz=28e9, surface=surface)
    seconds, worked = time.perf_counter() - began, time.process_time() - worked
    count = len(surface) * len(result.tx_names)
    return {
        "scene": scene.name, "device": scene.device, "cells": len(surface), "transmitters": len(result.tx_names),
        **options, "s": round(seconds, 3), "cpu_s": round(worked, 3), "cells_per_s": round(count / seconds),
        "reached": round(float((result.path_gain > 0.0).mean()), 4),
    }  # fmt: skip


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", default="town03", help="a shipped town, or a file that mmw.load_scene reads")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N")
    parser.add_argument("--cells", default="1e4", help="cells of each map, separated by commas")
    parser.add_argument("--depth", default="1,2", help="most interactions on a path, separated by commas")
    parser.add_argument("--diffraction", action="store_true", help="diffraction, too")
    parser.add_argument("--transmitters", type=int, default=1, choices=range(1, len(PLACES_M) + 1))
    parser.add_argument("--points-per-cell", type=int, default=1, metavar="N")
    parser.add_argument("--samples-per-tx", type=int, default=1_000_000, metavar="N", help="rays of a transmitter")
    arguments = parser.parse_args()
    scene = mmw.load_scene(arguments.scene, device=arguments.device)
    scene.tx_array = mmw.PlanarArray()
    for number, place in enumerate(PLACES_M[: arguments.transmitters]):
        scene.add(mmw.Transmitter(f"tx_{number}", position=place))
    for depth in map(int, arguments.depth.split(",")):
        options = {
            "max_depth": depth, "diffraction": arguments.diffraction, "points_per_cell": arguments.points_per_cell,
            "samples_per_tx": arguments.samples_per_tx,
        }  # fmt: skip
        few = {**options, "samples_per_tx": 1000}
        measure(scene, 1024, few if not arguments.diffraction else {**few, "max_depth": 1})
        for cells in arguments.cells.split(","):
            print(json.dumps(measure(scene, int(float(cells)), options)), flush=True)


if __name__ == "__main__":
    main()
