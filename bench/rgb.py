"""Measure RGB images: `python -m bench.rgb --device cuda:0 --weathers sunny,rainy,foggy`, or `--device cpu`.

The paper's cameras look from their carriers in every frame: four from each CAV, one from each roadside unit, 13 images
a frame in a scenario. Rays are shared by all weathers. `on the device`: from launch to the end of the device's work;
`with copy`: all images as NumPy arrays, through page-locked memory (`--copy`); `as JPEG files`: as bytes on the host,
encoded on the device (`--files`). The median of several rounds counts,
after a warm-up. Images are rendered in pieces of as many as a run of `mmw` takes at once.

`--stages` also times each kernel alone, with waits between them, and counts the threads of those that trace. A thread
casts one ray at most: none where a pixel shows the sky, a surface faces away from the sun, a tile sticks out or a list
has room left.
"""

import argparse
import json
import re
import statistics
import sys
from collections import defaultdict
from dataclasses import asdict, dataclass
from typing import Any

import warp as wp

from bench.camera_views import SCENARIOS, camera_scene, launch_of, rgb_camera
from bench.kernel_times import KernelTimes
from bench.lidar import seconds_of
from bench.rays import machine
from mmw.core.cuda import retain_memory
from mmw.core.device import GPU_BYTES_PER_WORKER
from mmw.core.transfer import to_host
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import view_keys
from mmw.sensors import RgbCamera
from mmw.sensors.camera_group.launches import Launch, max_pixels, trace_launch
from mmw.sensors.render.jpeg import jpeg_files
from mmw.sensors.rgb.simulate import RgbRenderer

STAGES = {
    "visibility": ("visibility", "tile_candidates"),
    "edges": ("edge", "flag", "guess", "source"),
    "reflections": ("reflection", "water"),
    "smoothing": ("smooth", "gather"),
    "shade": ("shade", "surface", "lights_kernel", "resolve", "put_back"),
    "light": ("sun", "sky", "light"),
    "tone_mapping": ("tone_mapping", "meter", "exposure"),
}
"""Stage -> parts of the names of its kernels; the first stage that fits counts. Another kernel is its own stage."""

DEVICE, COPY, FILES = "on the device", "with copy", "as JPEG files"
"""Destination of the images of a round."""

TRACING = re.compile(r"visibility|further_sun|^sun_(between_)?kernel|^sky_|reflection_(trace|sun)")
"""Names of kernels that cast one ray a thread."""


@dataclass(frozen=True)
class Result:
    """One measured line."""

    weathers: str
    where: str
    """`on the device`, `with copy` or `as JPEG files`."""
    images: int
    """Images that come out of a round, all weathers together."""
    seconds: float
    images_per_s: float
    cost: float
    """Time over that of the first weather alone."""


@dataclass(frozen=True)
class Stages:
    """Time of a round by stages."""

    weathers: str
    milliseconds: dict[str, float]
    """Stage -> median time of a round [ms]."""
    rays: dict[str, int]
    """Kernel that traces -> its threads in a round, each a ray at most."""
    tracing_ms: float
    """Median time of those kernels together [ms]."""


def render(
    scene: DeviceScene, camera: RgbRenderer, launch: Launch, config: RgbCamera, weathers: list[str], where: str
) -> list[Any]:
    """Render a launch piece by piece, as a run does.

    Args:
        scene: The scene, with the frames of the launch loaded.
        camera: Renders it in some weathers.
        launch: The views.
        config: The cameras' settings.
        weathers: The camera's weathers.
        where: `on the device`, `with copy` or `as JPEG files`.

    Returns:
        Images of each piece and weather, shape [A, H, W, 3], uint8, or files.
    """
    images: list[Any] = []
    for piece in launch.pieces(max_pixels(scene.device)):
        buffer = trace_launch(scene, piece, camera.alpha_cutouts)
        keys = {name: view_keys(scene.arrays, piece.views, 0, "bench", name, config.name) for name in weathers}
        found = camera.render(buffer, config, keys)
        device = [found[name].rgb for name in weathers]
        if where == FILES:
            images += jpeg_files(device, config.jpeg_quality, config.jpeg_subsampling)
        else:
            images += to_host(device) if where == COPY else device
    return images


def measure(
    scene: DeviceScene, launch: Launch, config: RgbCamera, weathers: list[str], repeats: int, ends: list[str]
) -> list[Result]:
    """Return the throughput of the first weather, and of all together if there are more.

    Args:
        scene: The scene, with the frames of the launch loaded.
        launch: The views.
        config: The cameras' settings.
        weathers: Presets.
        repeats: Timed rounds.
        ends: Where images end, each measured by itself.
    """
    results: list[Result] = []
    for where in ends:
        first_s = 0.0
        for some in [weathers[:1], weathers] if len(weathers) > 1 else [weathers]:
            camera = rgb_camera(scene, some)
            seconds = seconds_of(
                lambda camera=camera, some=some, where=where: render(scene, camera, launch, config, some, where),
                scene.device, repeats,
            )  # fmt: skip
            first_s = first_s or seconds
            images = len(launch.views) * len(some)
            results.append(Result("+".join(some), where, images, seconds, images / seconds, seconds / first_s))
    return results


def measure_stages(scene: DeviceScene, launch: Launch, config: RgbCamera, weathers: list[str], repeats: int) -> Stages:
    """Return where the time of a round goes; see `measure`."""
    camera = rgb_camera(scene, weathers)
    render(scene, camera, launch, config, weathers, DEVICE)
    rounds: dict[str, list[float]] = defaultdict(list)
    tracing: list[float] = []
    rays: dict[str, int] = {}
    for _ in range(repeats):
        with KernelTimes(scene.device) as times:
            render(scene, camera, launch, config, weathers, DEVICE)
        spent = dict.fromkeys(STAGES, 0.0)
        for kernel, seconds in times.seconds.items():
            stage = stage_of(kernel)
            spent[stage] = spent.get(stage, 0.0) + 1e3 * seconds
        for stage, milliseconds in spent.items():
            rounds[stage].append(milliseconds)
        rays = {kernel: threads for kernel, threads in times.threads.items() if TRACING.search(kernel)}
        tracing.append(sum(1e3 * times.seconds[kernel] for kernel in rays))
    medians = {stage: statistics.median(milliseconds) for stage, milliseconds in rounds.items()}
    return Stages("+".join(weathers), medians, rays, statistics.median(tracing))


def stage_of(kernel: str) -> str:
    """Return the stage of a kernel by its name."""
    return next((stage for stage, parts in STAGES.items() if any(part in kernel for part in parts)), kernel)


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(prog="python -m bench.rgb", description="Measure RGB images a second.")
    parser.add_argument("--device", default="cuda:0" if wp.get_cuda_device_count() else "cpu", help="cpu or cuda:N")
    parser.add_argument("--format", choices=("human", "json"), default="human", help="json: one line a result")
    parser.add_argument("--scene", default="town03", choices=("grid", *SCENARIOS), help="town with its traffic")
    parser.add_argument("--frames", type=int, help="frames in a round (16 on CUDA, 1 on the CPU)")
    parser.add_argument("--views", type=int, help="only so many of the views, the first ones")
    parser.add_argument("--vehicles", type=int, default=40, help="vehicles in every frame of a scenario")
    parser.add_argument("--weathers", default="sunny", help="presets; cost counts from the first")
    parser.add_argument("--width", type=int, default=640, help="columns of an image")
    parser.add_argument("--height", type=int, default=480, help="rows of an image")
    parser.add_argument("--samples", type=int, default=4, choices=(1, 4, 9), help="rays in a pixel on an edge")
    for name in ("shadows", "sky-light", "reflections"):
        parser.add_argument(f"--no-{name}", action="store_false", dest=name.replace("-", "_"), help=f"without {name}")
    parser.add_argument("--copy", action="store_true", help="measure with the copy to the host too")
    parser.add_argument("--files", action="store_true", help="measure with encoding on the device too")
    parser.add_argument("--stages", action="store_true", help="time each step alone, and count rays")
    parser.add_argument("--repeats", type=int, help="timed rounds (10 on CUDA, 2 on the CPU)")
    options = parser.parse_args(arguments)
    is_cuda = wp.get_device(options.device).is_cuda
    options.frames = options.frames or (16 if is_cuda else 1)
    options.repeats = options.repeats or (10 if is_cuda else 2)
    return options


def main(arguments: list[str]) -> None:
    """Measure and print."""
    wp.config.log_level = wp.LOG_WARNING
    options = parse(arguments)
    weathers = options.weathers.split(",")
    retain_memory(options.device, GPU_BYTES_PER_WORKER)
    arrays = camera_scene(options.scene, options.frames, options.vehicles, weathers)
    config = RgbCamera(
        width_px=options.width, height_px=options.height, samples=options.samples, shadows=options.shadows,
        sky_light=options.sky_light, reflections=options.reflections,
    )  # fmt: skip
    scene = DeviceScene(arrays, options.device, options.frames)
    scene.load_batch(range(options.frames))
    launch = launch_of(arrays, options.frames, config, options.views)
    about = machine(options.device)
    is_human = options.format == "human"
    if is_human:
        print(", ".join(f"{key} {value}" for key, value in about.items()))
        print(
            f"{options.scene}: {len(arrays.faces):,} triangles, {len(scene.instance_actor)} vehicles, "
            f"{len(launch.views)} views of {options.width} x {options.height} in {options.frames} frames"
        )
        print("weathers            where           images        ms   images/s   s/image   cost")
    ends = [DEVICE, *([COPY] if options.copy else []), *([FILES] if options.files else [])]
    for result in measure(scene, launch, config, weathers, options.repeats, ends):
        print(line(result) if is_human else json.dumps({**asdict(result), **about}), flush=True)
    if options.stages:
        for some in [weathers[:1], weathers] if len(weathers) > 1 else [weathers]:
            stages = measure_stages(scene, launch, config, some, options.repeats)
            print(stage_lines(stages) if is_human else json.dumps({**asdict(stages), **about}), flush=True)


def line(result: Result) -> str:
    """Return one row of the table."""
    return (
        f"{result.weathers:19} {result.where:14} {result.images:7} {result.seconds * 1e3:9.2f} "
        f"{result.images_per_s:10.1f} {1.0 / result.images_per_s:9.5f} {result.cost:6.2f}"
    )


def stage_lines(stages: Stages) -> str:
    """Return the stages as text: one line a stage, and one of rays."""
    total = sum(stages.milliseconds.values())
    lines = [f"{stages.weathers}, each stage alone:"]
    lines += [f"  {stage:20} {ms:9.2f} ms {ms / total:6.1%}" for stage, ms in stages.milliseconds.items()]
    lines += [f"  {kernel:32} {count / 1e6:9.3f} M rays at most" for kernel, count in stages.rays.items()]
    speed = sum(stages.rays.values()) / stages.tracing_ms * 1e-6
    return "\n".join([*lines, f"  tracing {stages.tracing_ms:.2f} ms, at most {speed:.4f} G rays/s"])


if __name__ == "__main__":
    main(sys.argv[1:])
