"""Compare with newton's SensorCamera, which also traces with Warp: `python -m bench.newton_camera --device cuda:0`.

The same town, vehicles, views and resolution in both, one after the other in one process. newton holds the town as one
mesh of all worlds and the vehicles of each frame as the bodies of one world; each view looks into its frame's world.

- `depth`: depth along the optical axis. Both must agree, or the comparison stops: 99 % of the pixels within 1 cm.
- `colour`: one directional light without shadows. newton: one colour a shape, Lambert, hemispheric ambient light,
  packed sRGB. mmw: materials, textures, sky, tone map; one sample a pixel, no sky rays, no reflections, no shadows.
- `shadow`: the same with shadows of that light.

newton runs as it comes (its own constructor, order of pixels and block size) and with every constructor and tile size
asked for; both ratios are printed, over that and over the best of them. Always without textures and with fast math.
Neither culls back faces: single walls are seen from both sides. Times are medians, from launch to the end of the
device's work, with images that stay on the device.
"""

import argparse
import importlib
import json
import math
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from PIL import Image

from bench.camera_views import SCENARIOS, camera_scene, launch_of, rgb_camera
from bench.lidar import seconds_of
from bench.rays import machine
from mmw.core.camera_models import Intrinsics
from mmw.core.transforms import compose
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.stage.sensor_prims import SENSOR_TO_CAMERA
from mmw.scene.views import Views, view_keys
from mmw.sensors import RgbCamera
from mmw.sensors.camera_group.launches import Launch
from mmw.sensors.render.sky.sky import sun_direction
from mmw.sensors.render.visibility_buffer import depth_images, trace_samples

MODES = ("depth", "colour", "shadow")
RANGE_M = 1000.0
"""Longest depth of both [m]: newton's default."""
CLOSE_M, CLOSE_SHARE = 0.01, 0.99
"""Depths agree where they differ by less [m], and in so many of the pixels."""
GREY = (0.4, 0.4, 0.4)
AS_IT_COMES = "default"
"""Constructor and tile that are newton's own choice."""


@dataclass(frozen=True)
class Result:
    """One line of the table."""

    mode: str
    """One of `MODES`."""
    views: int
    mmw_s: float
    newton_s: float
    newton_settings: str
    """Constructor and tile of the best time."""
    mmw_images_per_s: float
    newton_images_per_s: float
    ratio: float
    """mmw's images a second over newton's best."""
    newton_default_images_per_s: float
    """newton as it comes."""
    ratio_to_default: float


def load_newton() -> Any:
    """Return the module.

    Raises:
        ValueError: If it is not there.
    """
    try:
        return importlib.import_module("newton")
    except ImportError as error:
        raise ValueError(f"newton: {error}; this comparison needs it; `pip install newton`") from None


class Newton:
    """The scene of a batch in newton."""

    def __init__(self, newton: Any, scene: DeviceScene, views: Views, intrinsics: Intrinsics, constructor: str):
        """Build worlds and views.

        Args:
            newton: The module.
            scene: Our scene, with a batch loaded.
            views: Its views.
            intrinsics: A pinhole in the middle of the image.
            constructor: Tree builder of the meshes, or `AS_IT_COMES`.
        """
        self.newton, self.shape = newton, (len(views), intrinsics.height, intrinsics.width)
        self.model, self.state = self._model(scene, constructor)
        self.camera = newton.sensors.SensorCamera(self.model, load_textures=False)
        pose = compose(views.pose, SENSOR_TO_CAMERA)
        pose[:, :3] -= scene.origin
        device = scene.device
        self.transforms = wp.array(pose.astype(np.float32), dtype=wp.transformf, device=device)
        self.worlds = wp.array(views.slot, dtype=wp.int32, device=device)
        fov = 2.0 * math.atan(0.5 * intrinsics.height / intrinsics.fy)
        self.rays = newton.sensors.SensorCamera.compute_camera_rays_pinhole(
            intrinsics.width, intrinsics.height, camera_fov=fov, device=device
        )

    def _model(self, scene: DeviceScene, constructor: str) -> tuple[Any, Any]:
        newton, arrays = self.newton, scene.arrays
        builder = newton.ModelBuilder(up_axis=newton.Axis.Z)
        if constructor != AS_IT_COMES:
            builder.default_bvh_cfg.mesh_constructor = constructor
        cfg = newton.ModelBuilder.ShapeConfig(density=0.0, has_shape_collision=False, has_particle_collision=False)
        town = newton.Mesh(arrays.points - scene.origin, arrays.faces.ravel(), compute_inertia=False)
        builder.add_shape_mesh(-1, mesh=town, cfg=cfg, color=GREY)
        models = [newton.Mesh(m.points, m.faces.ravel(), compute_inertia=False) for m in arrays.models]
        for frame in scene.batch_frames:
            builder.begin_world()
            for pose, actor in zip(arrays.poses[arrays.frame_row(frame)], arrays.actors, strict=True):
                if actor.model >= 0 and np.isfinite(pose).all():
                    at = wp.transform(wp.vec3(*(pose[:3] - scene.origin)), wp.quat(*pose[3:]))
                    body = builder.add_body(xform=at, is_kinematic=True)
                    builder.add_shape_mesh(body, mesh=models[actor.model], cfg=cfg, color=GREY)
            builder.end_world()
        model = builder.finalize(device=scene.device, skip_all_validations=True)
        return model, model.state()

    def render(self, mode: str, tile: str, image: wp.array) -> None:
        """Render all views of a batch into an image, float32 for depth and packed uint32 for colour.

        `tile` is its width and height, as in 8x8, or `AS_IT_COMES`.
        """
        camera = self.newton.sensors.SensorCamera
        order: dict[str, Any] = {}
        if tile != AS_IT_COMES:
            width, height = (int(side) for side in tile.split("x"))
            order = {
                "render_order": camera.RenderOrder.TILED, "tile_width": width, "tile_height": height,
                "block_dim": width * height,
            }  # fmt: skip
        config = camera.RenderConfig(
            enable_shadows=mode == "shadow", enable_backface_culling=False, enable_particles=False,
            max_distance=RANGE_M, **order,
        )  # fmt: skip
        image_of = {"forward_depth_image" if mode == "depth" else "color_image": image}
        self.camera.update(
            self.state, self.transforms, self.rays, world_indices=self.worlds, render_config=config, **image_of
        )

    def empty(self, mode: str) -> wp.array:
        """Return an image to render into."""
        return self.camera.allocate_image(*_turned(self.shape), wp.float32 if mode == "depth" else wp.uint32)

    def light(self, weather: Weather) -> None:
        """Let the sun of a weather shine."""
        towards = -np.asarray(sun_direction(weather))
        self.camera.create_default_light(enable_shadows=True, direction=wp.vec3(*towards.tolist()))


def _turned(shape: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return views, width, height of views, height, width."""
    return shape[0], shape[2], shape[1]


def ours(scene: DeviceScene, launch: Launch, mode: str, weather: str) -> Callable[[], Any]:
    """Return what renders a batch with mmw in one of `MODES`."""
    if mode == "depth":
        return lambda: depth_images(
            trace_samples(scene, launch.views, launch.intrinsics, RANGE_M), with_metres=True, with_objects=False
        )
    config = RgbCamera(
        width_px=launch.intrinsics.width, height_px=launch.intrinsics.height, samples=1, sky_light=False,
        reflections=False, shadows=mode == "shadow",
    )  # fmt: skip
    camera = rgb_camera(scene, [weather])
    keys = {weather: view_keys(scene.arrays, launch.views, 0, "bench", weather, "rgb")}
    return lambda: camera.render(trace_samples(scene, launch.views, launch.intrinsics, RANGE_M), config, keys)


def share_close(a: np.ndarray, b: np.ndarray) -> float:
    """Return the share of pixels whose depths agree; a miss agrees with a miss.

    Args:
        a: Our depths [m], inf for a miss.
        b: newton's depths [m], 0 for a miss.
    """
    b = np.where(b > 0.0, b, np.inf)
    with np.errstate(invalid="ignore"):
        return float(((np.abs(a - b) <= CLOSE_M) | (np.isinf(a) & np.isinf(b))).mean())


def compare(newton: Any, scene: DeviceScene, launch: Launch, options: argparse.Namespace) -> list[Result]:
    """Return the throughput of both in every mode.

    Raises:
        ValueError: If the depths do not agree.
    """
    best = dict.fromkeys(MODES, (float("inf"), ""))
    default_s = dict.fromkeys(MODES, float("nan"))
    own = {mode: ours(scene, launch, mode, options.weather) for mode in MODES}
    depth = own["depth"]().depth_m.numpy()
    for constructor in [AS_IT_COMES, *options.constructors.split(",")]:
        theirs = Newton(newton, scene, launch.views, launch.intrinsics, constructor)
        theirs.light(PRESETS[options.weather])
        for mode in MODES:
            image = theirs.empty(mode)
            for text in [AS_IT_COMES] if constructor == AS_IT_COMES else options.tiles.split(","):
                given = (mode, text, image)
                seconds = seconds_of(
                    lambda theirs=theirs, given=given: theirs.render(*given), scene.device, options.repeats
                )
                if constructor == AS_IT_COMES:
                    default_s[mode] = seconds
                best[mode] = min(best[mode], (seconds, f"{constructor} {text}"))
            if mode == "depth":
                share = share_close(depth, image.numpy())
                if share < CLOSE_SHARE:
                    raise ValueError(
                        f"depth: {share:.2%} of the pixels agree to 1 cm with newton's; {CLOSE_SHARE:.0%} must; "
                        "the two do not show the same scene"
                    )
            if options.pictures:
                _save(Path(options.pictures), mode, own[mode](), image.numpy(), options.weather)
    results = []
    for mode in MODES:
        mmw_s, (newton_s, settings) = seconds_of(own[mode], scene.device, options.repeats), best[mode]
        count = len(launch.views)
        results.append(
            Result(
                mode, count, mmw_s, newton_s, settings, count / mmw_s, count / newton_s, newton_s / mmw_s,
                count / default_s[mode], default_s[mode] / mmw_s,
            )
        )  # fmt: skip
    return results


def _save(folder: Path, mode: str, mine: Any, theirs: np.ndarray, weather: str) -> None:
    """Save the first view of both side by side."""
    folder.mkdir(parents=True, exist_ok=True)
    if mode == "depth":
        pair = [np.clip(255.0 * np.exp(-np.nan_to_num(d[0], posinf=1e9) / 40.0), 0, 255).astype(np.uint8)
                for d in (mine.depth_m.numpy(), np.where(theirs > 0.0, theirs, np.inf))]  # fmt: skip
    else:
        packed = theirs[0]
        pair = [mine[weather].rgb.numpy()[0], np.stack([packed >> s & 0xFF for s in (0, 8, 16)], -1).astype(np.uint8)]
    Image.fromarray(np.concatenate(pair, axis=1)).save(folder / f"{mode}.png")


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(prog="python -m bench.newton_camera", description="Compare with SensorCamera.")
    is_cuda = bool(wp.get_cuda_device_count())
    parser.add_argument("--device", default="cuda:0" if is_cuda else "cpu", help="cpu or cuda:N")
    parser.add_argument("--scene", default="town03", choices=("grid", *SCENARIOS), help="town with its traffic")
    parser.add_argument("--frames", type=int, default=16 if is_cuda else 1, help="frames in one launch, 13 views each")
    parser.add_argument("--vehicles", type=int, default=40, help="vehicles in every frame")
    parser.add_argument("--width", type=int, default=640, help="columns of an image")
    parser.add_argument("--height", type=int, default=480, help="rows of an image")
    parser.add_argument("--weather", default="sunny", help="preset: the sun's direction, and our materials")
    parser.add_argument("--constructors", default="cubql,sah" if is_cuda else "sah", help="newton's mesh trees to try")
    parser.add_argument("--tiles", default="8x8,16x8" if is_cuda else "8x8", help="newton's tiles to try")
    parser.add_argument("--repeats", type=int, default=10 if is_cuda else 1, help="timed rounds")
    parser.add_argument("--pictures", help="folder for the first view of both, side by side")
    parser.add_argument("--format", choices=("human", "json"), default="human", help="json: one line a result")
    return parser.parse_args(arguments)


def main(arguments: list[str]) -> None:
    """Compare and print."""
    wp.config.log_level = wp.LOG_WARNING
    options = parse(arguments)
    try:
        newton = load_newton()
    except ValueError as error:
        sys.exit(str(error))
    arrays = camera_scene(options.scene, options.frames, options.vehicles, [options.weather])
    scene = DeviceScene(arrays, options.device, options.frames)
    scene.load_batch(range(options.frames))
    launch = launch_of(arrays, options.frames, RgbCamera(width_px=options.width, height_px=options.height))
    about = {**machine(options.device), "newton": newton.__version__}
    if options.format == "human":
        print(", ".join(f"{key} {value}" for key, value in about.items()))
        print(
            f"{options.scene}: {len(arrays.faces):,} triangles, {len(scene.instance_actor)} vehicles, "
            f"{len(launch.views)} views of {options.width} x {options.height}"
        )
        print("mode      mmw images/s  newton as it comes  ratio  newton's best  ratio")
    for result in compare(newton, scene, launch, options):
        print(json.dumps({**asdict(result), **about}) if options.format == "json" else line(result), flush=True)


def line(result: Result) -> str:
    """Return one row of the table."""
    return (
        f"{result.mode:8} {result.mmw_images_per_s:13.1f} {result.newton_default_images_per_s:19.1f} "
        f"{result.ratio_to_default:6.2f} {result.newton_images_per_s:14.1f} {result.ratio:6.2f}  "
        f"{result.newton_settings}"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
