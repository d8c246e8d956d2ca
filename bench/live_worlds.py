"""Measure steps of worlds that are traced together: `python -m bench.live_worlds --device cuda:0 --worlds 1 16 64`.

`quickstart` with the LiDAR of the paper on `cav_1`, as `bench.live`, in several worlds of a `mmw.BatchedSimulation`.
Every step of all worlds is timed from the controls to the last row on the host, after a warm-up: median, 99th
percentile, world-steps a second over all steps (the drivers of all worlds decide in every fifth step, which is longer),
and the mean time that this process had a core; drivers may decide in others. Episodes start anew where their frames
end.
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

LOOKS: dict[str, Callable[[mmw.BatchedSimulation], Any]] = {
    "nothing": lambda worlds: None,
    "poses": lambda worlds: worlds.table("poses"),
    "channel": lambda worlds: worlds.paths(28e9),
    "LiDAR": lambda worlds: worlds.table("lidar"),
    "channel and LiDAR": lambda worlds: (worlds.paths(28e9), worlds.table("lidar")),
    "the same by world": lambda worlds: [
        (frame.paths(28e9), frame.agents["cav_1"].sensor("lidar")) for frame in worlds.present
    ],
}
"""Name -> look at the present frames."""


def measure(
    simulation: mmw.BatchedSimulation, look: Callable[[mmw.BatchedSimulation], Any], steps: int
) -> tuple[np.ndarray, float]:
    """Return the time of every step with a look, shape [steps], and the mean time on all cores of the process [s]."""
    times, used = [], 0.0
    number = simulation.present[0].frame
    for step in range(-3, steps):
        if number + 1 == simulation.frames.stop:
            simulation.reset()
            number = simulation.frames.start
        if step == 0:
            used = time.process_time()
        start = time.perf_counter()
        simulation.step([{"cav_1": mmw.Control(target_speed_m_s=4.0 + step % 5)}] * len(simulation))
        look(simulation)
        times.append(time.perf_counter() - start)
        number += 1
    return np.array(times[3:]), (time.process_time() - used) / steps


def main(arguments: list[str]) -> None:
    """Measure and print."""
    wp.config.log_level = wp.LOG_WARNING
    parser = argparse.ArgumentParser(prog="python -m bench.live_worlds", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--device", default="cuda:0" if wp.get_cuda_device_count() else "cpu", help="cpu or cuda:N")
    parser.add_argument("--worlds", type=int, nargs="+", default=[1, 16, 64], help="numbers of worlds")
    parser.add_argument("--steps", type=int, default=50, help="timed steps of each line")
    parser.add_argument("--processes", type=int, help="worker processes of the traffic; default: by cores and worlds")
    parser.add_argument("--look", nargs="+", choices=LOOKS, default=list(LOOKS), help="what is looked at")
    options = parser.parse_args(arguments)
    config = mmw.load_config("quickstart", ["frames.count=1000", "sensors=[{type: lidar, on: [cav_1]}]"])
    print(", ".join(f"{key} {value}" for key, value in machine(options.device).items()))
    print("worlds  looked at             median ms   99 % ms   world-steps/s    CPU ms")
    for count in options.worlds:
        with mmw.BatchedSimulation(config, count, device=options.device, processes=options.processes) as simulation:
            start = time.perf_counter()
            simulation.reset()
            print(f"{count:6}  reset of all          {1e3 * (time.perf_counter() - start):9.1f}")
            for name in options.look:
                spent, cores = measure(simulation, LOOKS[name], options.steps)
                middle, late = np.median(spent), np.quantile(spent, 0.99)
                print(
                    f"{count:6}  {name:20} {1e3 * middle:10.1f} {1e3 * late:9.1f} {count / spent.mean():15.0f} "
                    f"{1e3 * cores:9.1f}"
                )


if __name__ == "__main__":
    main(sys.argv[1:])
