"""Measure LiDAR sweeps in sun, rain and fog: `python -m bench.lidar --device cuda:0`, or `--device cpu`.

Four LiDARs of the paper ride on four vehicles; one batch holds all frames. Geometry is traced once, then each weather
finds, places and gathers its returns (`on the device`) and copies them to NumPy arrays (`with copy`). The median of
several rounds counts, after a warm-up; each part is timed from launch to the end of the device's work.
"""

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from bench.rays import machine
from bench.scenes import grid_town, shipped_town, with_vehicles
from mmw.physics.weather.weather import PRESETS
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.scene.views import make_views, view_keys
from mmw.sensors import Lidar
from mmw.sensors.lidar.returns import LidarHits, shade_on_device
from mmw.sensors.lidar.simulate import find_lidar_returns, trace_lidar_hits

LIDARS = 4
"""Sensors of a frame."""


@dataclass(frozen=True)
class Result:
    """One measured line."""

    weather: str
    """Its name, or `all` for every weather of one trace."""
    where: str
    """`on the device` or `with copy`."""
    scans: int
    """Sweeps of a round."""
    returns: int
    """Their returns."""
    echoes: float
    """Share of returns that are rain or fog."""
    trace_s: float
    shade_s: float
    """Everything after tracing."""
    scans_per_s: float
    cost: float
    """Time over that of the first weather, less one."""


def with_sensors(arrays: SceneData) -> SceneData:
    """Return the scene with LiDARs on its first vehicles."""
    actors = tuple(replace(a, role="cav") if i < LIDARS else a for i, a in enumerate(arrays.actors))
    return replace(arrays, actors=actors)


def seconds_of(work: Callable[[], Any], device: str, repeats: int) -> float:
    """Return the median seconds of some work, to the end of the device's part of it."""
    work()
    wp.synchronize_device(device)
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        result = work()  # freed after the clock has stopped
        wp.synchronize_device(device)
        seconds.append(time.perf_counter() - start)
        del result
    return statistics.median(seconds)


def measure(scene: DeviceScene, config: Lidar, weathers: list[str], repeats: int) -> list[Result]:
    """Return the throughput of each weather and of all together."""
    views = make_views(scene.arrays, scene.batch_frames, config)
    device, materials = scene.device, scene.arrays.materials["sunny"]
    trace_s = seconds_of(lambda: trace_lidar_hits(scene, views, config), device, repeats)
    hits: LidarHits = trace_lidar_hits(scene, views, config)
    results: list[Result] = []
    for where, shade in (("on the device", shade_on_device), ("with copy", find_lidar_returns)):
        rows = []
        for name in weathers:
            keys = view_keys(scene.arrays, views, 1, "bench", name, config.name)
            given = (hits, materials, PRESETS[name], keys, (0, 0))
            shade_s = seconds_of(lambda given=given, shade=shade: shade(*given), device, repeats)
            label = find_lidar_returns(*given).label
            clear_s = trace_s + (rows[0].shade_s if rows else shade_s)
            rows.append(
                Result(
                    name, where, len(views), len(label), float(np.mean(label > 0)), trace_s, shade_s,
                    len(views) / (trace_s + shade_s), (trace_s + shade_s) / clear_s - 1.0,
                )
            )  # fmt: skip
        shade_s, scans, returns = (sum(getattr(row, name) for row in rows) for name in ("shade_s", "scans", "returns"))
        echoes = sum(row.echoes * row.returns for row in rows) / max(returns, 1)
        clear_s = trace_s + len(rows) * rows[0].shade_s
        together = Result(
            "all", where, scans, returns, echoes, trace_s, shade_s, scans / (trace_s + shade_s),
            (trace_s + shade_s) / clear_s - 1.0,
        )  # fmt: skip
        results += [*rows, together]
    return results


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(prog="python -m bench.lidar", description="Measure LiDAR sweeps in weather.")
    parser.add_argument("--device", default="cuda:0" if wp.get_cuda_device_count() else "cpu", help="cpu or cuda:N")
    parser.add_argument("--format", choices=("human", "json"), default="human", help="json: one line a result")
    parser.add_argument("--frames", type=int, help="frames in one batch (64 on CUDA, 2 on the CPU)")
    parser.add_argument("--scene", default="town03", help="grid (procedural), or a shipped town such as town03")
    parser.add_argument("--weathers", default="sunny,rainy,foggy", help="presets; the first is what cost counts from")
    parser.add_argument("--preset", default="hdl64", help="laser and receiver")
    parser.add_argument("--returns", default="strongest", help="strongest, last or dual")
    parser.add_argument("--repeats", type=int, default=10, help="timed rounds")
    options = parser.parse_args(arguments)
    if options.frames is None:
        options.frames = 64 if wp.get_device(options.device).is_cuda else 2
    return options


def main(arguments: list[str]) -> None:
    """Measure and print."""
    wp.config.log_level = wp.LOG_WARNING
    options = parse(arguments)
    town = grid_town() if options.scene == "grid" else shipped_town(options.scene)
    arrays = with_sensors(with_vehicles(town, options.frames))
    scene = DeviceScene(arrays, options.device, options.frames)
    scene.load_batch(list(arrays.frames))
    config = Lidar(on=("cav",), preset=options.preset, returns=options.returns)
    about = machine(options.device)
    if options.format == "human":
        print(", ".join(f"{key} {value}" for key, value in about.items()))
        print(f"{options.scene}: {LIDARS} LiDARs x {options.frames} frames, {options.preset}, {options.returns}")
        print("weather     where           scans   returns  echoes  trace ms  shade ms   scans/s    cost")
    for result in measure(scene, config, options.weathers.split(","), options.repeats):
        print(json.dumps({**asdict(result), **about}) if options.format == "json" else line(result), flush=True)


def line(result: Result) -> str:
    """Return one row of the table."""
    return (
        f"{result.weather:11} {result.where:13} {result.scans:7} {result.returns:9} {result.echoes:7.1%} "
        f"{result.trace_s * 1e3:9.2f} {result.shade_s * 1e3:9.2f} {result.scans_per_s:9.0f} {result.cost:7.1%}"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
