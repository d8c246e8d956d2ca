"""Measure ray throughput: `python -m bench.rays --device cuda:0`, or `--device cpu`.

Every ray kind runs over the static town alone and over town and vehicles. All frames go in one launch. After a warm-up
the launch is captured in a CUDA graph, replayed, and timed with events; the median counts. Compilation is timed apart.

`MMW_BVH` chooses the trees; with `--against warp` rays walk our own, a second process casts the same rays through
Warp's, and hits that differ are counted.
"""

# Warp's structs are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false

import argparse
import itertools
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np
import warp as wp

from bench import first_hit
from bench.scenes import grid_town, shipped_town, with_vehicles
from mmw import __version__
from mmw.config.foliage import FoliageModel
from mmw.config.lens import LensConfig
from mmw.core.bvh_default import BVH_VARIABLE
from mmw.core.bvh_kind import kind_to_build, select_bvh
from mmw.core.transforms import compose, pose_from_mount
from mmw.kernels.core import structs
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.sensors import Lidar
from mmw.sensors.lidar.scan_pattern import lidar_order, lidar_pattern


@dataclass(frozen=True)
class Preset:
    """One kind of rays."""

    name: str
    views_per_frame: int
    rays_per_view: int
    on_cpu: int
    """Rays of a view on the CPU, which needs fewer for the same figure."""


MAX_APART_M = 1e-3
"""Hits of the same object at distances that differ by more [m] count as different."""


@dataclass(frozen=True)
class Result:
    """One measured line."""

    scene: str
    bvh: str
    """Trees that the rays walk: `wide` or `warp`."""
    rays: str
    levels: str
    """`static` for the town alone, `two-level` with vehicles."""
    triangles: int
    vehicles: int
    frames: int
    ray_count: int
    hit_share: float
    vehicle_share: float
    """Share of rays that end on a vehicle."""
    median_s: float
    best_s: float
    grays_per_s: float
    jit_s: float
    """First launch, with compilation unless Warp's cache had the kernel."""


CAMERA = LensConfig().intrinsics(640, 480, 110.0)
LIDAR_PATTERN = (64, 469)
LIDAR = lidar_pattern(Lidar())
PRESETS = (
    Preset("sphere", 1, 1_000_000, 100_000),
    Preset("camera", 4, CAMERA.width * CAMERA.height, CAMERA.width * CAMERA.height),
    Preset("lidar", 4, len(LIDAR), len(LIDAR)),
)

MOUNTS = {
    "sphere": pose_from_mount((0.0, 0.0, 4.0)),
    "camera": pose_from_mount((1.5, 0.0, 2.4)),
    "lidar": pose_from_mount((0.0, 0.0, 2.5)),
}
"""Origin of the rays in a vehicle's body frame."""


def make_views(arrays: SceneData, preset: Preset, device: str) -> structs.Views:
    """Return one row a frame and sensor: sensors sit on the first vehicles and do not see their own."""
    frames = len(arrays.frames)
    pose = compose(arrays.poses[:, : preset.views_per_frame], MOUNTS[preset.name]).reshape(-1, 7)
    views = structs.Views()
    batch_index = np.repeat(np.arange(frames, dtype=np.int32), preset.views_per_frame)
    ignore = np.tile(np.arange(preset.views_per_frame, dtype=np.int32), frames)
    views.batch_index = wp.array(batch_index, dtype=wp.int32, device=device)
    views.pose = wp.array(pose.astype(np.float32), dtype=wp.transformf, device=device)
    views.ignore = wp.array(ignore, dtype=wp.int32, device=device)
    return views


def lidar_tables(device: str) -> list[wp.array]:
    """Return directions and tracing order of the LiDAR pattern on a device."""
    directions = wp.array(LIDAR.astype(np.float32), dtype=wp.vec3, device=device)
    return [directions, wp.array(lidar_order(*LIDAR_PATTERN), dtype=wp.int32, device=device)]


def time_launches(launch: Callable[[], None], device: str, repeats: int) -> list[float]:
    """Return the seconds of each of several launches; on a CPU those of the thread that traces, whatever else runs."""
    if not wp.get_device(device).is_cuda:
        seconds = []
        for _ in range(repeats):
            start = time.thread_time()
            launch()
            seconds.append(time.thread_time() - start)
        return seconds
    with wp.ScopedCapture(device) as capture:
        launch()
    graph = capture.graph
    if graph is None:
        raise RuntimeError(f"{device}: the launch was not captured; a CUDA device with graphs is needed")
    wp.capture_launch(graph)
    marks = [wp.Event(device, enable_timing=True) for _ in range(repeats + 1)]
    wp.record_event(marks[0])
    for mark in marks[1:]:
        wp.capture_launch(graph)
        wp.record_event(mark)
    wp.synchronize_device(device)
    return [wp.get_event_elapsed_time(a, b) * 1e-3 for a, b in itertools.pairwise(marks)]


def measure(
    scene: DeviceScene,
    views: structs.Views,
    preset: Preset,
    levels: str,
    options: argparse.Namespace,
    hits_folder: Path | None = None,
) -> Result:
    """Return the throughput of one kind of rays in one scene; put what they find into a folder, if one is given."""
    device = scene.device
    is_cuda = wp.get_device(device).is_cuda
    rays = preset.rays_per_view if is_cuda else preset.on_cpu
    shape = (len(views.batch_index), rays)
    t = wp.empty(shape, dtype=float, device=device)
    object_id = wp.empty(shape, dtype=int, device=device)
    kernels = {
        "sphere": (first_hit.sphere_kernel, [rays, options.sphere_arm]),
        "camera": (first_hit.camera_kernel, [CAMERA.width, CAMERA.fx]),
        "lidar": (first_hit.lidar_kernel, lidar_tables(device)),
    }
    kernel, values = kernels[preset.name]

    def launch() -> None:
        wp.launch(
            kernel, dim=shape, inputs=[scene.struct, views, *values], outputs=[t, object_id], device=device,
            block_dim=options.block_dim,
        )  # fmt: skip

    start = time.perf_counter()
    launch()
    wp.synchronize_device(device)
    jit = time.perf_counter() - start
    seconds = time_launches(launch, device, options.repeats)
    found = object_id.numpy()
    vehicles = [scene.arrays.actors[k].object_id for k in scene.instance_actor]
    median = statistics.median(seconds)
    if hits_folder is not None:
        np.save(hits_folder / f"{preset.name}-{levels}-t.npy", t.numpy())
        np.save(hits_folder / f"{preset.name}-{levels}-object.npy", found)
    return Result(
        options.scene, kind_to_build(), preset.name, levels, len(scene.arrays.faces), len(vehicles),
        scene.batch_size, found.size,
        float((found >= 0).mean()), float((found >= min(vehicles)).mean()) if vehicles else 0.0,
        median, min(seconds), found.size / median * 1e-9, jit,
    )  # fmt: skip


def machine(device: str) -> dict[str, Any]:
    """Return what the figures depend on: GPU or CPU, driver, Warp, source."""
    found = wp.get_device(device)
    commands = {"git": ["git", "rev-parse", "--short", "HEAD"]}
    if found.is_cuda:
        commands["driver"] = [
            "nvidia-smi",
            "--query-gpu=driver_version",
            "--format=csv,noheader",
            "-i",
            str(found.ordinal),
        ]
    answers = {}
    for name, command in commands.items():
        try:
            answers[name] = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
        except (OSError, subprocess.CalledProcessError):
            answers[name] = "unknown"
    return {
        "device": found.name if found.is_cuda else cpu_name(),
        "warp": wp.config.version, "mmw": __version__, "python": platform.python_version(), **answers,
    }  # fmt: skip


def cpu_name() -> str:
    """Return the model of the CPU, or its architecture where the system does not report it."""
    info = Path("/proc/cpuinfo")
    rows = info.read_text().splitlines() if info.is_file() else []
    names = [row.split(":")[1].strip() for row in rows if row.startswith("model name")]
    return f"{len(names)} x {names[0]}" if names else platform.machine()


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(prog="python -m bench.rays", description="Measure ray throughput.")
    parser.add_argument("--device", default="cuda:0" if wp.get_cuda_device_count() else "cpu", help="cpu or cuda:N")
    parser.add_argument("--format", choices=("human", "json"), default="human", help="json: one line a result")
    parser.add_argument("--frames", type=int, help="frames in one launch (64 on CUDA, 2 on the CPU)")
    parser.add_argument("--scene", default="grid", help="grid (procedural), or a shipped town such as town03")
    parser.add_argument("--foliage", choices=get_args(FoliageModel), default="hull", help="crowns of trees")
    parser.add_argument("--rays", choices=[preset.name for preset in PRESETS], help="only this kind")
    parser.add_argument("--repeats", type=int, default=10, help="timed launches")
    parser.add_argument("--block-dim", type=int, default=64, help="threads in a block")
    parser.add_argument("--instance-constructor", choices=("sah", "lbvh", "median"), help="tree over vehicles")
    parser.add_argument("--sphere-arm", type=int, default=987, help="1: rays in lattice order; 987: along spirals")
    parser.add_argument("--max-registers", type=int, help="registers of a thread on CUDA (as in the sensors if absent)")
    parser.add_argument("--against", choices=("warp",), help="same rays through Warp's trees too")
    parser.add_argument("--hits", type=Path, help=argparse.SUPPRESS)  # folder for what rays find
    options = parser.parse_args(arguments)
    if options.frames is None:
        options.frames = 64 if wp.get_device(options.device).is_cuda else 2
    return options


def main(arguments: list[str]) -> None:
    """Measure and print."""
    wp.config.log_level = wp.LOG_WARNING
    options = parse(arguments)
    if not options.against:
        run(options)
        return
    select_bvh("wide")
    with tempfile.TemporaryDirectory() as folder:
        options.hits = Path(folder) / "wide"
        there = Path(folder) / "warp"
        options.hits.mkdir()
        there.mkdir()
        ours = run(options)
        # Last options count: the child is no parent, and its lines can be read.
        rest = [a for a in arguments if a not in ("--against", "warp", "--against=warp")]
        command = [sys.executable, "-m", "bench.rays", *rest, "--format", "json", "--hits", str(there)]
        environment = {**os.environ, BVH_VARIABLE: "warp"}
        lines = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True).stdout
        theirs = [json.loads(line) for line in lines.splitlines()]
        if options.format == "human":
            print(
                "rays     levels     wide Grays/s  warp Grays/s  ratio  hits that differ  largest other difference [m]"
            )
        for own, other in zip(ours, theirs, strict=True):
            differing, apart = compare(options.hits, there, f"{own.rays}-{own.levels}")
            if options.format == "json":
                print(json.dumps({**other, "differing": differing, "apart_m": apart}))
                continue
            ratio = own.grays_per_s / other["grays_per_s"]
            print(
                f"{own.rays:8} {own.levels:10} {own.grays_per_s:12.4f} {other['grays_per_s']:13.4f} {ratio:6.2f} "
                f"{differing:9,} of {own.ray_count:,} {apart:16.1e}"
            )


def compare(one: Path, other: Path, name: str) -> tuple[int, float]:
    """Return how many rays hit another object or the same more than `MAX_APART_M` away, and how far apart the hits
    of the others are at most [m]."""
    distance = [np.load(folder / f"{name}-t.npy", mmap_mode="r") for folder in (one, other)]
    is_same = np.load(one / f"{name}-object.npy") == np.load(other / f"{name}-object.npy")
    is_met = np.isfinite(distance[0]) & np.isfinite(distance[1])
    apart = np.abs(np.subtract(*distance, where=is_met, out=np.zeros(is_met.shape, np.float32)))
    is_same &= apart <= MAX_APART_M
    return int(np.count_nonzero(~is_same)), float(apart.max(initial=0.0, where=is_same))


def run(options: argparse.Namespace) -> list[Result]:
    """Measure with the trees of this process, print and return the results."""
    if options.max_registers:
        kernels: tuple[Any, ...] = (first_hit.sphere_kernel, first_hit.camera_kernel, first_hit.lidar_kernel)
        for kernel in kernels:
            kernel.options["cuda_max_registers"] = options.max_registers
    town = grid_town() if options.scene == "grid" else shipped_town(options.scene, options.foliage)
    arrays = with_vehicles(town, options.frames)
    scenes = (without_vehicles(arrays), arrays)
    static, full = (
        DeviceScene(
            a,
            options.device,
            options.frames,
            instance_constructor=options.instance_constructor,
        )
        for a in scenes
    )
    about = machine(options.device)
    if options.format == "human":
        print(", ".join(f"{key} {value}" for key, value in about.items()))
        triangles = len(static.optical.arrays.faces)
        print(f"{triangles:,} triangles, {len(arrays.actors)} vehicles, {options.frames} frames in one launch")
        print("rays     levels        Mrays  median ms  Grays/s   hits  vehicle   JIT s")
    results = []
    for scene, levels in ((static, "static"), (full, "two-level")):
        scene.load_batch(list(arrays.frames))
        for preset in PRESETS:
            if options.rays in (None, preset.name):
                result = measure(
                    scene.optical, make_views(arrays, preset, options.device), preset, levels, options, options.hits
                )
                results.append(result)
                print(json.dumps({**asdict(result), **about}) if options.format == "json" else line(result), flush=True)
    return results


def without_vehicles(arrays: SceneData) -> SceneData:
    """Return the town of a scene alone, over the same frames."""
    return SceneData(
        arrays.points, arrays.faces, arrays.material, arrays.object_id, arrays.surface, (), (), arrays.frames,
        np.zeros((len(arrays.frames), 0, 7)), arrays.materials, arrays.objects,
        foliage=arrays.foliage,
    )  # fmt: skip


def line(result: Result) -> str:
    """Return one row of the table."""
    return (
        f"{result.rays:8} {result.levels:10} {result.ray_count / 1e6:8.2f} {result.median_s * 1e3:10.2f} "
        f"{result.grays_per_s:8.4f} {result.hit_share:6.1%} {result.vehicle_share:8.1%} {result.jit_s:7.2f}"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
