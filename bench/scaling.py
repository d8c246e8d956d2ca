"""Measure how cost grows: `python -m bench.scaling --device cuda:0 --out FILE.json`, minutes on an H100.

Curves of time, rays a second and device memory over triangles, vehicles, images, LiDARs, rays, resolution, links,
frames of a batch and weathers; see `bench.scaling_frames` and `bench.scaling_towns` for what is timed. The scene is the
roundabout of Town03 with every sensor of the paper unless a curve differs. Then, on any machine with matplotlib:
`python -m bench.scaling --plot FILE.json --pictures docs/images` draws the curves.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import warp as wp

from bench.rays import PRESETS, Preset, machine
from bench.scaling_frames import FramePoint, Frames, connected, scenario_arrays, scenario_config, with_bodies
from bench.scaling_towns import TownPoint, finer_towns, larger_towns, measure_town
from mmw.config import Config
from mmw.physics.weather.weather import PRESETS as WEATHERS
from mmw.scene.scene_data import SceneData
from mmw.sensors import Lidar, RgbCamera
from mmw.sensors.batch import Batch

STEPS = Lidar().points_per_channel
"""Azimuth steps of a LiDAR's turn in the paper."""


@dataclass(frozen=True)
class Sizes:
    """Sizes of the measured curves."""

    scene: str
    recorded: int
    """Frames that the scene has."""
    frames: int
    """Frames of a batch."""
    rounds: int
    """Batches, or launches of rays, that are timed."""
    overrides: tuple[str, ...]
    """Of the configuration."""
    rays: tuple[Preset, ...]
    """Kinds of rays for the towns."""
    blocks: tuple[int, ...]
    """Blocks of the larger towns along each side."""
    finer: tuple[int, int]
    """Number of towns with finer and finer triangles, and their blocks."""
    vehicles: tuple[int, ...]
    cameras: tuple[int, ...]
    """Connected vehicles with four cameras each, beside the unit's one."""
    lidars: tuple[int, ...]
    steps: tuple[int, ...]
    """Azimuth steps of a LiDAR's turn."""
    launched: tuple[int, ...]
    """Channel rays of a transmitter."""
    widths: tuple[int, ...]
    """Columns of an image; rows are three for every four of them."""
    links: tuple[int, ...]
    """Connected vehicles that have links."""
    batches: tuple[int, ...]
    weathers: tuple[int, ...]


FULL = Sizes(
    scene="town03", recorded=100, frames=50, rounds=5, overrides=(), rays=PRESETS,
    blocks=(4, 8, 16, 32, 64), finer=(4, 8),
    vehicles=(0, 10, 20, 40, 80), cameras=(0, 1, 3, 6, 12), lidars=(1, 2, 4, 8, 16),
    steps=(STEPS // 4, STEPS, 4 * STEPS, 16 * STEPS), launched=(100_000, 300_000, 1_000_000, 3_000_000, 10_000_000),
    widths=(160, 320, 640, 1280), links=(1, 2, 4, 8, 16), batches=(1, 4, 16, 50, 100), weathers=(1, 2, 3),
)  # fmt: skip

QUICK = Sizes(
    scene="grid", recorded=3, frames=2, rounds=1,
    overrides=(
        "sensors=[{type: lidar, channels: 4, points_per_channel: 16}, {type: rgb, width_px: 16, height_px: 12}, "
        "{type: rgb, name: back, on: [cav], width_px: 16, height_px: 12}, "
        "{type: radar, azimuth_rays: 8, elevation_rays: 4}, {type: imu}]",
        "channel.samples_per_tx=1000",
    ),
    rays=tuple(replace(each, views_per_frame=1, on_cpu=min(each.on_cpu, 30_016)) for each in PRESETS[::2]),
    blocks=(1, 2), finer=(2, 1),
    vehicles=(0, 5), cameras=(0, 1), lidars=(1, 2), steps=(8, 16), launched=(1000, 2000),
    widths=(16, 32), links=(1, 2), batches=(1, 2), weathers=(1, 2),
)  # fmt: skip
"""Tiny, for tests: every curve in seconds on a CPU."""

VEHICLES = 40
"""Vehicles where a curve does not say how many, as in the paper's scenarios."""


class Curves:
    """The curves. Scenes are read once, and put on the device again only where a curve changes what lies there."""

    def __init__(self, sizes: Sizes, device: str):
        """Measure on a device.

        Args:
            sizes: What is measured.
            device: Warp device.
        """
        self._sizes, self._device = sizes, device
        self._names = list(WEATHERS)[: max(sizes.weathers)]
        self._frames = Frames(device, sizes.rounds)

    @cached_property
    def _config(self) -> Config:
        overrides = (f"frames.count={self._sizes.recorded}", *self._sizes.overrides)
        return scenario_config(overrides, self._names)

    @cached_property
    def _everything(self) -> SceneData:
        """The scene with all vehicles of a curve."""
        sizes = self._sizes
        return scenario_arrays(sizes.scene, sizes.recorded, max(sizes.vehicles), self._names)

    @cached_property
    def _arrays(self) -> SceneData:
        return with_bodies(self._everything, VEHICLES)

    @cached_property
    def _job(self) -> Batch:
        """The unchanged scenario in all weathers."""
        return self._frames.job(self._config, self._arrays, self._sizes.frames)

    def _in(self, weathers: int) -> Config:
        """Return the configuration in the first so many weathers."""
        return self._config.model_copy(update={"weathers": tuple(self._names[:weathers])})

    def _only(self, kind: type, **sensor: Any) -> Batch:
        """Return a job with the sensors of one kind alone, in one weather, without the channel.

        Args:
            kind: Section of the sensors that are left.
            sensor: Keys of these sensors.
        """
        left = [each.model_copy(update=sensor) for each in self._config.sensors if isinstance(each, kind)]
        channel = self._config.channel.model_copy(update={"enabled": False})
        config = self._in(1).model_copy(update={"sensors": tuple(left), "channel": channel})
        return replace(self._job, config=config, surfaces=None)

    def _radio(self, **channel: Any) -> Batch:
        """Return a job with the channel alone, its keys replaced."""
        found = self._config.channel.model_copy(update=channel)
        return replace(self._job, config=self._in(1).model_copy(update={"sensors": (), "channel": found}))

    def _point(self, job: Batch, value: float, frames: int | None = None) -> FramePoint:
        return self._frames.measure(job, value, frames or self._sizes.frames)

    def larger(self) -> list[TownPoint]:
        """Rays over triangles of ever larger towns."""
        return self._towns(larger_towns(self._sizes.blocks, self._town_frames))

    def finer(self) -> list[TownPoint]:
        """Rays over triangles of one town."""
        return self._towns(finer_towns(*self._sizes.finer, self._town_frames))

    @property
    def _town_frames(self) -> int:
        return min(self._sizes.frames, 16)

    def _towns(self, towns: Iterator[SceneData]) -> list[TownPoint]:
        return [measure_town(town, self._sizes.rays, 2 * self._sizes.rounds, self._device) for town in towns]

    def vehicles(self) -> list[FramePoint]:
        """Everything over vehicles."""
        scenes = [(count, with_bodies(self._everything, count)) for count in self._sizes.vehicles]
        frames = self._sizes.frames
        return [self._point(self._frames.job(self._in(1), arrays, frames), count) for count, arrays in scenes]

    def batch(self) -> list[FramePoint]:
        """Everything over frames of a batch."""
        return [
            self._point(self._frames.job(self._in(1), self._arrays, count), count, count)
            for count in self._sizes.batches
        ]

    def images(self) -> list[FramePoint]:
        """Cameras over images a frame: four on each connected vehicle, one on the unit."""
        each = sum("cav" in sensor.on for sensor in self._config.sensors if sensor.type == "rgb")
        return [
            self._point(replace(self._only(RgbCamera), arrays=connected(self._arrays, count)), each * count + 1)
            for count in self._sizes.cameras
        ]

    def resolution(self) -> list[FramePoint]:
        """Cameras over pixels of an image."""
        return [
            self._point(self._only(RgbCamera, width_px=width, height_px=width * 3 // 4), width * (width * 3 // 4))
            for width in self._sizes.widths
        ]

    def lidars(self) -> list[FramePoint]:
        """LiDARs over their number."""
        job = self._only(Lidar, on=("cav",))
        return [self._point(replace(job, arrays=connected(self._arrays, count)), count) for count in self._sizes.lidars]

    def points(self) -> list[FramePoint]:
        """LiDARs over the rays of a sweep."""
        channels = next(each.channels for each in self._config.sensors if each.type == "lidar")
        return [
            self._point(self._only(Lidar, points_per_channel=steps), channels * steps) for steps in self._sizes.steps
        ]

    def rays(self) -> list[FramePoint]:
        """Measure the channel over the rays of a transmitter."""
        return [self._point(self._radio(samples_per_tx=count), count) for count in self._sizes.launched]

    def v2i(self) -> list[FramePoint]:
        """Measure the channel over links from the roadside unit."""
        return self._links("v2i", lambda count: count)

    def v2v(self) -> list[FramePoint]:
        """Measure the channel over links between vehicles in both directions."""
        return self._links("v2v", lambda count: count * (count - 1))

    def _links(self, kind: str, links: Callable[[int], int]) -> list[FramePoint]:
        job = self._radio(links=(kind,))
        counts = [count for count in self._sizes.links if links(count)]
        return [self._point(replace(job, arrays=connected(self._arrays, count)), links(count)) for count in counts]

    def weathers(self) -> list[FramePoint]:
        """Everything over weathers of a frame."""
        return [self._point(replace(self._job, config=self._in(count)), count) for count in self._sizes.weathers]


CURVES: dict[str, tuple[str, ...]] = {
    "triangles": ("larger", "finer"), "vehicles": ("vehicles",), "batch": ("batch",), "images": ("images",),
    "resolution": ("resolution",), "lidars": ("lidars",), "points": ("points",), "rays": ("rays",),
    "links": ("v2i", "v2v"), "weathers": ("weathers",),
}  # fmt: skip
"""Value of `--only` -> curves in the file."""


def measure(names: Sequence[str], sizes: Sizes, device: str, out: Path) -> None:
    """Measure curves, and put each into the file at once: machine, sizes, curves, and the seconds that each took.

    Args:
        names: Keys of `CURVES`.
        sizes: What is measured.
        device: Warp device.
        out: The file; curves that it has and that are not measured again stay.
    """
    content: dict[str, Any] = {"seconds": {}, "curves": {}} if not out.is_file() else json.loads(out.read_text())
    content |= {"machine": machine(device), "scene": sizes.scene, "frames": sizes.frames, "rounds": sizes.rounds}
    curves = Curves(sizes, device)
    for name in (curve for key in names for curve in CURVES[key]):
        start = time.perf_counter()
        points = getattr(curves, name)()
        content["curves"][name] = [asdict(point) for point in points]
        content["seconds"][name] = time.perf_counter() - start
        out.write_text(json.dumps(content, indent=1))
        print(f"{name} ({content['seconds'][name]:.1f} s)", *(line(point) for point in points), sep="\n  ", flush=True)


def line(point: FramePoint | TownPoint) -> str:
    """Return one point as text."""
    if isinstance(point, TownPoint):
        rays = ", ".join(f"{name} {speed / 1e9:.4f}" for name, speed in point.rays_per_s.items())
        return f"{point.value:>12,} {rays} G rays/s, built in {point.build_s:.2f} s, {point.device_gb or 0:.2f} GB"
    stages = ", ".join(
        f"{name} {ms:.3f}" for name, ms in sorted(point.stages_ms.items(), key=lambda item: -item[1])[:5]
    )
    device = "" if point.device_ms is None else f", device {point.device_ms:.3f} ms, {point.device_gb:.1f} GB"
    return f"{point.value:>12,} {point.frame_ms:.3f} ms a frame ({stages}){device}"


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(prog="python -m bench.scaling", description="Measure how cost grows.")
    parser.add_argument("--device", default="cuda:0" if wp.get_cuda_device_count() else "cpu", help="cpu or cuda:N")
    parser.add_argument("--out", type=Path, help="file for the measurements, JSON; curves that it has and that are "
                        "not measured again stay")  # fmt: skip
    parser.add_argument("--only", help=f"some of {', '.join(CURVES)}, with commas")
    parser.add_argument("--quick", action="store_true", help="tiny scenes, to try it: the numbers mean nothing")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw such a file and measure nothing")
    parser.add_argument("--pictures", type=Path, default=Path("out"), help="folder for --plot")
    options = parser.parse_args(arguments)
    options.only = options.only.split(",") if options.only else list(CURVES)
    unknown = [name for name in options.only if name not in CURVES]
    if unknown:
        parser.error(f"--only {', '.join(unknown)}: there is no such curve; give some of {', '.join(CURVES)}")
    if not (options.out or options.plot):
        parser.error("--out FILE.json is missing; give it, or --plot a file that was measured before")
    return options


def main(arguments: list[str]) -> None:
    """Measure, or draw."""
    wp.config.log_level = wp.LOG_WARNING
    options = parse(arguments)
    if options.plot:
        from bench.scaling_plots import draw

        for path in draw(json.loads(options.plot.read_text()), options.pictures):
            print(path)
        return
    measure(options.only, QUICK if options.quick else FULL, options.device, options.out)


if __name__ == "__main__":
    main(sys.argv[1:])
