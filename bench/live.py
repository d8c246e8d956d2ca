"""Measure steps of a live simulation: `python -m bench.live --device cuda:0`, or `--device cpu`.

`quickstart` with the LiDAR of the paper on `cav_1`; with `--suite` all sensors of `configs/full.yaml`. Every step is
timed from its control to the last row on the host; median and 99th percentile count, after a warm-up, and the mean time
that the process had a core, which tells what a machine without other work would take. `alone` is the median without
that of `poses`, which every look begins with: the step of the traffic, and the frame on the device. The episode starts
anew where its frames end.
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
from mmw.storage.schemas import table_spec

LOOKS: dict[str, Callable[[mmw.Frame], Any]] = {
    "nothing": lambda frame: None,
    "poses": lambda frame: frame.agents,
    "channel": lambda frame: frame.paths(28e9),
    "LiDAR": lambda frame: frame.agents["cav_1"].sensor("lidar"),
    "channel and LiDAR": lambda frame: (frame.paths(28e9), frame.agents["cav_1"].sensor("lidar")),
}
"""Name -> look at a frame of `quickstart`."""

Look = Callable[[mmw.Frame], Any]


def samples(frame: mmw.Frame, *types: str) -> list[Any]:
    """Return the samples of all sensors of some types on all agents, traced at once; images as files or not yet."""
    frame.trace(*types)
    return [sample for agent in frame.agents.values() for kind in types for sample in agent.samples(kind).values()]


def everything(frame: mmw.Frame, types: tuple[str, ...], carriers_hz: tuple[float, ...]) -> Any:
    """Return agents, boxes, the samples of all sensors and the paths at all carriers, traced at once."""
    frame.trace()
    return frame.boxes, samples(frame, *types), [frame.paths(carrier) for carrier in carriers_hz]


def tables(frame: mmw.Frame) -> list[Any]:
    """Return all tables, with encoded images."""
    frame.trace()
    return [frame.table(name) for name in frame.data.tables if table_spec(name).framed]


def suite_looks(config: mmw.Config) -> dict[str, Look]:
    """Return name -> look at a frame with the sensors of a configuration."""
    types = tuple(dict.fromkeys(sensor.type for sensor in config.sensors))
    carriers = config.channel.carriers_hz
    return {
        "nothing": lambda frame: None,
        "poses": lambda frame: frame.agents,
        "boxes": lambda frame: frame.boxes,
        **{f"all of type {kind}": (lambda frame, kind=kind: samples(frame, kind)) for kind in types},
        "channel": lambda frame: [frame.paths(carrier) for carrier in carriers],
        "everything": lambda frame: everything(frame, types, carriers),
        "everything as tables": tables,
    }


def measure(simulation: mmw.Simulation, look: Look, steps: int) -> tuple[np.ndarray, float]:
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


def calls(simulation: mmw.Simulation, look: Look, steps: int = 10) -> float:
    """Return the mean number of function calls of a step with a look, which no other load on the machine changes."""
    frame, profile = simulation.reset(), cProfile.Profile()
    for step in range(-2, steps):
        if step == 0:
            profile.enable()
        frame = simulation.step()
        look(frame)
    profile.disable()
    return sum(entry.callcount for entry in profile.getstats()) / steps


def main(arguments: list[str]) -> None:
    """Measure and print."""
    wp.config.log_level = wp.LOG_WARNING
    parser = argparse.ArgumentParser(prog="python -m bench.live", description="Measure steps of a live simulation.")
    parser.add_argument("--device", default="cuda:0" if wp.get_cuda_device_count() else "cpu", help="cpu or cuda:N")
    parser.add_argument("--steps", type=int, default=200, help="timed steps of each line")
    parser.add_argument("--suite", action="store_true", help="all sensors of configs/full.yaml, in town03_roundabout")
    parser.add_argument("--scenario", help="one of the configuration's; the first by default")
    parser.add_argument("--look", action="append", help="only this line of the table; may be repeated")
    parser.add_argument("overrides", nargs="*", help="KEY=VALUE of the configuration")
    options = parser.parse_args(arguments)
    own = [] if options.suite else ["sensors=[{type: lidar, on: [cav_1]}]"]
    config = mmw.load_config("full" if options.suite else "quickstart", ["frames.count=1000", *own, *options.overrides])
    looks = suite_looks(config) if options.suite else LOOKS
    print(", ".join(f"{key} {value}" for key, value in machine(options.device).items()))
    with mmw.Simulation(config, mode="live", device=options.device, scenario=options.scenario) as simulation:
        print("looked at               median ms  alone ms   99 % ms   steps/s    CPU ms     calls")
        poses = 0.0
        for name in options.look or looks:
            look = looks[name]
            spent, cores = measure(simulation, look, options.steps)
            middle, late = np.median(spent), np.quantile(spent, 0.99)
            poses = middle if name == "poses" else poses
            alone = f"{1e3 * (middle - poses):9.2f}" if poses else f"{'-':>9}"
            numbers = f"{1e3 * middle:10.2f} {alone} {1e3 * late:9.1f} {1 / middle:9.0f} {1e3 * cores:9.1f}"
            print(f"{name:22} {numbers} {calls(simulation, look):9.0f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
