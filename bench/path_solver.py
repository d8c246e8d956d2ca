"""Time repeated calls of `mmw.PathSolver` on a receiver that moves: `python -m bench.path_solver [--device cuda:0]`.

The first call builds trees and the table of surfaces; the others only search for paths. Prints one line a setting.
"""

import argparse
import json
import time

import numpy as np

import mmw

CALLS = 200
"""Calls that are timed."""

SETTINGS = {
    "exhaustive, depth 1": {"max_depth": 1, "candidates": "exhaustive"},
    "launch, depth 1": {"max_depth": 1},
    "launch, depth 3": {"max_depth": 3},
}


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", default="town03", help="a shipped town, or a file that mmw.load_scene reads")
    for name, default in (("tx", (13.5, -29.5, 10.0)), ("rx", (-2.0, 45.0, 1.5))):
        parser.add_argument(
            f"--{name}", type=float, nargs=3, default=default, metavar=("X", "Y", "Z"), help="place [m]"
        )
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N")
    parser.add_argument("--calls", type=int, default=CALLS, help="timed calls a setting")
    arguments = parser.parse_args()
    began = time.perf_counter()
    scene = mmw.load_scene(arguments.scene, device=arguments.device)
    loaded = time.perf_counter() - began
    scene.add(mmw.Transmitter("bs", position=arguments.tx))
    receiver = scene.add(mmw.Receiver("ue", position=arguments.rx))
    for name, options in SETTINGS.items():
        solver = mmw.PathSolver(**options)
        began = time.perf_counter()
        paths = solver(scene)
        first = time.perf_counter() - began
        wall = []
        for call in range(arguments.calls if "launch" not in name else max(arguments.calls // 10, 5)):
            x, y, z = arguments.rx
            receiver.position = (x, y + 0.01 * (call + 1), z)
            began = time.perf_counter()
            paths = solver(scene)
            wall.append(time.perf_counter() - began)
        began = time.perf_counter()
        solver(scene)
        same = time.perf_counter() - began
        milliseconds = {
            "load": loaded, "first": first, "best": min(wall), "median": float(np.median(wall)), "unchanged": same
        }  # fmt: skip
        shown = {key: round(1e3 * value, 2) for key, value in milliseconds.items()}
        print(json.dumps({"scene": arguments.scene, "device": scene.device, "setting": name, "paths": len(paths),
                          "ms": shown}))  # fmt: skip


if __name__ == "__main__":
    main()
