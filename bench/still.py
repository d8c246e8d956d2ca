"""Measure flicker: `python -m bench.still --device cuda:0 --scene town03 --frames 100`.

`still`: a camera of the first roadside unit stands still, the traffic drives. For every pair of consecutive frames:
the root mean square of the difference over all pixels where nothing moves, in 255ths, which must stay below 1.
Something moves at a pixel if, in either frame,

- it shows a body that moves between the two frames, or lies within `GROW_PX` of such a pixel;
- the line to the sun passes within `NEAR_M` of the box of such a body: its shadow;
- what it shows lies within `NEAR_M` of such a box: the sky that the body hides.

Bodies farther from the camera than `FAR_M` count by the first rule alone. What bodies mirror is not left out, and
neither are rain, ripples and what sensor noise changes: they count as flicker.

`pan`: the camera turns slowly instead, 0.05 degrees a frame. Each pixel is compared with the place of the frame before
that showed the same point, read between pixels; edges and moving bodies are left out as above. The figure holds the
blur of reading between pixels too, so it says something only beside another one of the same scene.
"""

# Warp's structs are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false

import argparse
import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import warp as wp
from PIL import Image

from bench.camera_views import SCENARIOS, camera_scene, rgb_camera
from bench.rays import machine
from mmw.core.random_keys import random_keys
from mmw.core.transforms import compose, invert, pose_from_mount, rotate, transform_points
from mmw.physics.weather.weather import PRESETS
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.scene.views import Views
from mmw.sensors import RgbCamera
from mmw.sensors.camera_group.capture import TRACED_RANGE
from mmw.sensors.render.image_config import ImageConfig
from mmw.sensors.render.projection import intrinsics_of
from mmw.sensors.render.sky.sky import sun_direction
from mmw.sensors.render.visibility_buffer import depth_images, trace_samples

GROW_PX = 10
"""Pixels around what moves that the camera's filters let it change."""

NEAR_M = 2.0
"""Distance from a moving box within which light counts as changed [m]."""

FAR_M = 80.0
"""Distance from the camera beyond which the shadows of moving bodies are not looked for [m]."""

BATCH = 10
"""Frames in a batch."""

PAN_DEG = 0.05
"""Turn of the panning camera in a frame [deg]."""


@dataclass(frozen=True)
class Clip:
    """Frames of one camera."""

    rgb: np.ndarray
    """Pictures, shape [F, H, W, 3], uint8."""
    points: np.ndarray
    """What the pixels show, world frame [m], inf for the sky, shape [F, H, W, 3], float32."""
    object_id: np.ndarray
    """Objects, -1 for the sky, shape [F, H, W]."""
    poses: np.ndarray
    """Camera to world, shape [F, 7]."""


@dataclass(frozen=True)
class Result:
    """One measured line."""

    weather: str
    kind: str
    """`still` or `pan`."""
    pairs: int
    worst: float
    """Largest root mean square of a pair [255ths]."""
    median: float
    largest: int
    """Largest difference of a pixel and colour [255ths]."""
    changed: float
    """Share of the compared pixels that differ at all."""
    compared: float
    """Share of the pixels that are compared."""


def film(scene: DeviceScene, poses: np.ndarray, weather: str, config: RgbCamera) -> Clip:
    """Return what a camera films.

    Args:
        scene: Town and vehicles; batches are loaded here, frame k of the clip is frame k of the scene.
        poses: Camera to world in every frame, shape [F, 7].
        weather: Preset that the scene was read for.
        config: The camera.
    """
    camera, intrinsics = rgb_camera(scene, [weather]), intrinsics_of(config)
    parts: list[tuple[np.ndarray, ...]] = []
    for begin in range(0, len(poses), scene.max_slots):
        frames = np.arange(begin, min(begin + scene.max_slots, len(poses)))
        scene.load_batch(frames.tolist())
        none = np.full(len(frames), -1, dtype=np.int32)  # nobody carries the camera, and it sees everything
        slot = np.arange(len(frames), dtype=np.int32)
        views = Views(frames.astype(np.int64), slot, none, poses[frames], none)
        buffer = trace_samples(scene, views, intrinsics, TRACED_RANGE * config.range_m, camera.alpha_cutouts)
        keys = {weather: random_keys(("bench", weather, int(frame)) for frame in frames)}
        rgb = camera.render(buffer, config, keys)[weather].rgb.numpy()
        images = depth_images(buffer, with_metres=True, with_objects=True)
        points = _points(images.depth_m.numpy(), poses[frames], config)
        parts.append((rgb, points, images.object_id.numpy().reshape(buffer.shape)))
    rgb, points, object_id = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Clip(rgb, points, object_id, poses)


def _points(depth: np.ndarray, poses: np.ndarray, config: RgbCamera) -> np.ndarray:
    """Return the points of depths along the optical axis of a pinhole, world frame, inf where there is none."""
    rays = _rays(config)
    points = np.full((*depth.shape, 3), np.inf, dtype=np.float32)
    for k, pose in enumerate(poses):
        hit = np.isfinite(depth[k])
        points[k][hit] = transform_points(pose, rays[hit] * depth[k][hit][:, None])
    return points


def _rays(config: RgbCamera) -> np.ndarray:
    """Return directions of the pixel centres whose x is 1, sensor frame, shape [H, W, 3]."""
    lens = intrinsics_of(config)
    u, v = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    return np.stack([np.ones_like(u), (lens.cx - u) / lens.fx, (lens.cy - v) / lens.fy], axis=-1)


def moving_actors(arrays: SceneData, row: int) -> list[int]:
    """Return the actors with a body that are elsewhere, or not there, one row of poses later."""
    before, after = arrays.poses[row], arrays.poses[row + 1]
    return [
        i for i, actor in enumerate(arrays.actors)
        if actor.model >= 0 and np.isfinite([before[i], after[i]]).any()
        and not np.allclose(before[i], after[i], rtol=0.0, atol=1e-9)
    ]  # fmt: skip


def moving_mask(arrays: SceneData, clip: Clip, k: int, to_sun: np.ndarray) -> np.ndarray:
    """Return where something moves between frames k and k + 1 of a clip; see the module. Shape [H, W], bool."""
    row = arrays.frame_row(k)
    actors = moving_actors(arrays, row)
    ids = [arrays.actors[i].object_id for i in actors]
    shown = np.isin(clip.object_id[k], ids) | np.isin(clip.object_id[k + 1], ids)
    shown |= clip.object_id[k] != clip.object_id[k + 1]
    first = np.cross((0.0, 0.0, 1.0) if abs(to_sun[2]) < 0.9 else (1.0, 0.0, 0.0), to_sun)
    plane = np.stack([first, np.cross(to_sun, first)]) / np.linalg.norm(first)
    seen = np.where(np.isfinite(clip.points[k]), clip.points[k], 1e9)  # the sky is no one's shadow
    flat = seen @ plane.T  # seen from the sun
    for i in actors:
        size = np.linalg.norm(arrays.actors[i].size) + np.linalg.norm(arrays.actors[i].center) + 4.0 * NEAR_M
        for frame in (k, k + 1):
            pose = arrays.poses[arrays.frame_row(frame), i]
            if np.isfinite(pose).all() and np.linalg.norm(pose[:3] - clip.poses[k, :3]) < FAR_M:
                near = np.square(flat - plane @ pose[:3]).sum(axis=-1) < size**2
                shown[near] |= is_reached(clip.points[k][near], pose, arrays, i, to_sun)
    return grow(shown, GROW_PX)


def is_reached(points: np.ndarray, pose: np.ndarray, arrays: SceneData, actor: int, to_sun: np.ndarray) -> np.ndarray:
    """Return which points, shape [N, 3], lie near an actor's box, or have it between themselves and the sun."""
    body, half = arrays.actors[actor], 0.5 * np.array(arrays.actors[actor].size) + NEAR_M
    inverse = invert(pose)
    hit = np.isfinite(points[..., 0])
    local = transform_points(inverse, points[hit].astype(np.float64)) - body.center
    direction = rotate(inverse[3:], to_sun)
    reached = np.zeros(hit.shape, dtype=bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort((np.stack([-half, half])[:, None] - local) / direction, axis=0)
    enters, leaves = np.nanmax(ends[0], axis=-1), np.nanmin(ends[1], axis=-1)
    reached[hit] = (enters <= leaves) & (leaves >= 0.0)  # a point within the box is reached too
    return reached


def grow(mask: np.ndarray, pixels: int) -> np.ndarray:
    """Return a mask with all pixels of a square around each of its own, shape [H, W]."""
    for axis in (0, 1):
        padded = np.pad(mask.astype(np.int32), [(pixels + 1, pixels) if a == axis else (0, 0) for a in (0, 1)])
        total = padded.cumsum(axis=axis)
        window = np.arange(mask.shape[axis])
        mask = total.take(window + 2 * pixels + 1, axis=axis) > total.take(window, axis=axis)
    return mask


def still_differences(arrays: SceneData, clip: Clip, weather: str) -> list[np.ndarray]:
    """Return the differences of each pair of frames where nothing moves, each of shape [n, 3], int."""
    to_sun = sun_direction(PRESETS[weather])
    rgb = clip.rgb.astype(np.int32)
    return [
        (rgb[k + 1] - rgb[k])[~moving_mask(arrays, clip, k, to_sun)] for k in range(len(rgb) - 1)
    ]  # fmt: skip


def pan_differences(arrays: SceneData, clip: Clip, weather: str, config: RgbCamera) -> list[np.ndarray]:
    """Return what each frame differs from the one before at the same points, each of shape [n, 3], float."""
    to_sun, lens = sun_direction(PRESETS[weather]), intrinsics_of(config)
    found = []
    for k in range(len(clip.rgb) - 1):
        points = clip.points[k + 1]
        hit = np.isfinite(points[..., 0])
        edge = grow(_has_edge(clip.object_id[k]) | _has_edge(clip.object_id[k + 1]), 3)
        keep = hit & ~edge & ~moving_mask(arrays, clip, k, to_sun)
        local = transform_points(invert(clip.poses[k]), points[keep].astype(np.float64))
        u = lens.cx - lens.fx * local[:, 1] / local[:, 0] - 0.5
        v = lens.cy - lens.fy * local[:, 2] / local[:, 0] - 0.5
        inside = (u >= 0) & (v >= 0) & (u < lens.width - 1) & (v < lens.height - 1)
        found.append(clip.rgb[k + 1][keep][inside] - _between(clip.rgb[k], u[inside], v[inside]))
    return found


def _has_edge(object_id: np.ndarray) -> np.ndarray:
    """Return where the right or lower neighbour is another object."""
    edge = np.zeros(object_id.shape, dtype=bool)
    edge[:, :-1] |= object_id[:, 1:] != object_id[:, :-1]
    edge[:-1] |= object_id[1:] != object_id[:-1]
    return edge


def _between(image: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return an image at places between its pixels, shape [n, 3]."""
    column, row = u.astype(int), v.astype(int)
    a, b = (u - column)[:, None], (v - row)[:, None]
    upper = image[row, column] * (1 - a) + image[row, column + 1] * a
    return upper * (1 - b) + (image[row + 1, column] * (1 - a) + image[row + 1, column + 1] * a) * b


def result_of(weather: str, kind: str, differences: list[np.ndarray], pixels: int) -> Result:
    """Return the figures of a clip; `pixels` is the number of an image."""
    rms = [float(np.sqrt(np.mean(np.square(d, dtype=np.float64)))) if len(d) else 0.0 for d in differences]
    count = sum(len(d) for d in differences)
    changed = sum(int((np.abs(d) >= 0.5).any(axis=-1).sum()) for d in differences)
    largest = max((float(np.abs(d).max()) for d in differences if len(d)), default=0.0)
    return Result(
        weather, kind, len(rms), max(rms), float(np.median(rms)), round(largest), changed / max(count, 1),
        count / (pixels * len(rms)),
    )  # fmt: skip


def camera_pose(arrays: SceneData, config: RgbCamera) -> np.ndarray:
    """Return where the camera of the first roadside unit is, shape [7], or of the first carrier where there is none."""
    carriers = sorted((a.role != "rsu", i) for i, a in enumerate(arrays.actors) if a.role in config.on)
    actor = carriers[0][1]
    mount = config.mount_on(arrays.actors[actor].role)
    pose = pose_from_mount(mount.position_m, mount.yaw_deg, mount.pitch_deg, mount.roll_deg)
    return compose(arrays.poses[arrays.frame_row(0), actor], pose)


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(prog="python -m bench.still", description="Measure flicker of RGB images.")
    is_cuda = bool(wp.get_cuda_device_count())
    parser.add_argument("--device", default="cuda:0" if is_cuda else "cpu", help="cpu or cuda:N")
    parser.add_argument("--format", choices=("human", "json"), default="human", help="json: one line a result")
    parser.add_argument("--scene", default="town03", choices=tuple(SCENARIOS), help="town with its traffic")
    parser.add_argument("--frames", type=int, default=100 if is_cuda else 4, help="frames of a clip")
    parser.add_argument("--vehicles", type=int, default=40, help="vehicles in every frame")
    parser.add_argument("--weathers", default="sunny", help="presets")
    parser.add_argument("--width", type=int, default=640, help="columns of an image")
    parser.add_argument("--height", type=int, default=480, help="rows of an image")
    parser.add_argument("--no-streaks", action="store_false", dest="streaks", help="without falling drops")
    parser.add_argument("--pictures", help="folder for the first and the last picture, and what is left out in black")
    return parser.parse_args(arguments)


def main(arguments: list[str]) -> None:
    """Measure and print."""
    wp.config.log_level = wp.LOG_WARNING
    options = parse(arguments)
    weathers = options.weathers.split(",")
    arrays = camera_scene(options.scene, options.frames, options.vehicles, weathers)
    scene = DeviceScene(arrays, options.device, min(BATCH, options.frames))
    config = RgbCamera(
        width_px=options.width, height_px=options.height, image=ImageConfig(streaks=options.streaks)
    )  # fmt: skip
    still = np.tile(camera_pose(arrays, config), (options.frames, 1))
    turn = np.stack([pose_from_mount((0, 0, 0), PAN_DEG * k) for k in range(options.frames)])
    about = machine(options.device)
    if options.format == "human":
        print(", ".join(f"{key} {value}" for key, value in about.items()))
        print("weather     clip   pairs  worst rms  median rms  largest  changed  compared   (255ths, shares)")
    for weather in weathers:
        clip = film(scene, still, weather, config)
        if options.pictures:
            _save(Path(options.pictures), weather, arrays, clip)
        pixels = options.width * options.height
        results = [result_of(weather, "still", still_differences(arrays, clip, weather), pixels)]
        clip = film(scene, compose(still, turn), weather, config)
        results.append(result_of(weather, "pan", pan_differences(arrays, clip, weather, config), pixels))
        for result in results:
            print(json.dumps({**asdict(result), **about}) if options.format == "json" else line(result), flush=True)


def _save(folder: Path, weather: str, arrays: SceneData, clip: Clip) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    mask = moving_mask(arrays, clip, 0, sun_direction(PRESETS[weather]))
    compared = np.where(mask[..., None], 0, clip.rgb[0]).astype(np.uint8)
    Image.fromarray(np.concatenate([clip.rgb[0], clip.rgb[-1], compared], axis=1)).save(folder / f"{weather}.png")


def line(result: Result) -> str:
    """Return one row of the table."""
    return (
        f"{result.weather:11} {result.kind:6} {result.pairs:5} {result.worst:10.4f} {result.median:11.4f} "
        f"{result.largest:8} {result.changed:8.4%} {result.compared:9.1%}"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
