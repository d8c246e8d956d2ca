"""Measure steps of a live simulation: `python -m bench.live --device cuda:0`, or `--device cpu`.

`quickstart` with the LiDAR of the paper on `cav_1`. Every step is timed from its control to the last row on the host;
median and 99th percentile count, after a warm-up, and the mean time that the process had a core, which tells what a
machine without other work would take. The episode starts anew where its frames end.
"""

import argparse
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

import mmw
from bench.rays import machine

LOOKS: dict[str, Callable[[mmw.Frame], Any]] = {
    "nothing": lambda frame: None,
    "poses": lambda frame: frame.agents,
    "channel": lambda frame: frame.paths(28e9),
    "LiDAR": lambda frame: frame.agents["cav_1"].sensor("lidar"),
    "channel and LiDAR": lambda frame: (frame.paths(28e9), frame.agents["cav_1"].sensor("lidar")),
}
"""Name -> look at a frame."""


def measure(simulation: mmw.Simulation, look: Callable[[mmw.Frame], Any], steps: int) -> tuple[np.ndarray, float]:
    """Return the time of every step with a look, shape [steps], and the mean time on all cores of the process [s]."""
    times, used, frame = [], 0.0, simulation.reset()
    for step in range(-5, steps):
        if frame.frame + 1 == simulation.frames.stop:
            frame = simulation.reset()
        if step == 0:
            used = time.process_time()
        start = time.perf_counter()
        frame = simulation.step({"cav_1": mmw.Control(target_speed_m_s=4.0 + step % 5)})
        look(frame)
        times.append(time.perf_counter() - start)
    return np.array(times[5:]), (time.process_time() - used) / steps


def main(arguments: list[str]) -> None:
    """Measure and print."""
    wp.config.log_level = wp.LOG_WARNING
    parser = argparse.ArgumentParser(prog="python -m bench.live", description="Measure steps of a live simulation.")
    parser.add_argument("--device", default="cuda:0" if wp.get_cuda_device_count() else "cpu", help="cpu or cuda:N")
    parser.add_argument("--steps", type=int, default=200, help="timed steps of each line")
    options = parser.parse_args(arguments)
    config = mmw.load_config("quickstart", ["frames.count=1000", "sensors=[{type: lidar, on: [cav_1]}]"])
    print(", ".join(f"{key} {value}" for key, value in machine(options.device).items()))
    with mmw.Simulation(config, mode="live", device=options.device) as simulation:
        print("looked at             median ms   99 % ms   steps/s    CPU ms")
        for name, look in LOOKS.items():
            spent, cores = measure(simulation, look, options.steps)
            middle, late = np.median(spent), np.quantile(spent, 0.99)
            print(f"{name:20} {1e3 * middle:10.1f} {1e3 * late:9.1f} {1 / middle:9.0f} {1e3 * cores:9.1f}")


if __name__ == "__main__":
    main(sys.argv[1:])
