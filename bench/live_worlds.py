"""Measure steps of worlds that are traced together: `python -m bench.live_worlds --device cuda:0 --worlds 1 16 64`.

`quickstart` with the LiDAR of the paper on `cav_1`, as `bench.live`, in several worlds of a `mmw.BatchedSimulation`.
Every step of all worlds is timed from the controls to the last row on the host, after a warm-up: median, 99th
percentile, world-steps a second over all steps (the drivers of all worlds decide in every fifth step, which is longer),
and the mean time that this process had a core; drivers may decide in others. The last columns are of the look alone:
median time that the thread had a core, and calls of Python functions. Episodes start anew where their frames end.
"""

import argparse
import cProfile
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

import mmw
from bench.rays import machine

Look = Callable[[mmw.BatchedSimulation], Any]

LOOKS: dict[str, Look] = {
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


def step(simulation: mmw.BatchedSimulation, number: int) -> None:
    """Go on by a frame with a control in each world, or to the first frame where the episodes end."""
    if simulation.present[0].frame + 1 == simulation.frames.stop:
        simulation.reset()
    simulation.step([{"cav_1": mmw.Control(target_speed_m_s=4.0 + number % 5)}] * len(simulation))


def measure(simulation: mmw.BatchedSimulation, look: Look, steps: int) -> tuple[np.ndarray, float, float]:
    """Return times in seconds.

    Returns:
        That of every step with a look, shape [steps]; the mean time on all cores of the process; the median time of the
        look on the core of its thread.
    """
    times, looks, used = [], [], 0.0
    for number in range(-3, steps):
        if number == 0:
            used = time.process_time()
        start = time.perf_counter()
        step(simulation, number)
        own = time.thread_time()
        look(simulation)
        looks.append(time.thread_time() - own)
        times.append(time.perf_counter() - start)
    return np.array(times[3:]), (time.process_time() - used) / steps, float(np.median(looks[3:]))


def calls(simulation: mmw.BatchedSimulation, look: Look, steps: int = 10) -> float:
    """Return the mean number of function calls of a look, which no other load on the machine changes."""
    profile = cProfile.Profile()
    for number in range(steps):
        step(simulation, number)
        profile.enable()
        look(simulation)
        profile.disable()
    return sum(entry.callcount for entry in profile.getstats()) / steps


def main(arguments: list[str]) -> None:
    """Measure and print."""
    wp.config.log_level = wp.LOG_WARNING
    parser = argparse.ArgumentParser(prog="python -m bench.live_worlds", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--device", default="cuda:0" if wp.get_cuda_device_count() else "cpu", help="cpu or cuda:N")
    parser.add_argument("--worlds", type=int, nargs="+", default=[1, 16, 64], help="numbers of worlds")
    parser.add_argument("--steps", type=int, default=50, help="timed steps of each line")
    parser.add_argument("--processes", type=int, help="worker processes of the traffic; default: by cores and worlds")
    parser.add_argument("--look", nargs="+", choices=LOOKS, default=list(LOOKS), help="what is looked at")
    parser.add_argument("overrides", nargs="*", help="KEY=VALUE of the configuration")
    options = parser.parse_args(arguments)
    own = ["frames.count=1000", "sensors=[{type: lidar, on: [cav_1]}]", *options.overrides]
    config = mmw.load_config("quickstart", own)
    print(", ".join(f"{key} {value}" for key, value in machine(options.device).items()))
    print("worlds  looked at             median ms   99 % ms   world-steps/s    CPU ms   look ms     calls")
    for count in options.worlds:
        with mmw.BatchedSimulation(config, count, device=options.device, processes=options.processes) as simulation:
            start = time.perf_counter()
            simulation.reset()
            print(f"{count:6}  reset of all          {1e3 * (time.perf_counter() - start):9.1f}")
            for name in options.look:
                spent, cores, looked = measure(simulation, LOOKS[name], options.steps)
                middle, late = np.median(spent), np.quantile(spent, 0.99)
                print(
                    f"{count:6}  {name:20} {1e3 * middle:10.1f} {1e3 * late:9.1f} {count / spent.mean():15.0f} "
                    f"{1e3 * cores:9.1f} {1e3 * looked:9.1f} {calls(simulation, LOOKS[name]):9.0f}",
                    flush=True,
                )


if __name__ == "__main__":
    main(sys.argv[1:])
