"""One picture of a scenario or a town by the RGB camera, straight from its configuration or stage, without a run."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image
from pydantic import ValidationError

from mmw.config import Config, config_path, load_config
from mmw.core.bvh_kind import select_bvh
from mmw.core.errors import InputError
from mmw.generation.estimate import check_inputs
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.scene.prepare import prepare_scenario
from mmw.scene.reader import read_stage
from mmw.scene.scene_data import SceneData
from mmw.scene.views import make_views, view_keys
from mmw.sensors.rgb.config import RgbCamera
from mmw.viz.stills.renderer import StillRenderer, follow_view, load_renderer, street_camera
from mmw.viz.stills.street_views import FOV_DEG, choose_views, view_direction
from mmw.viz.stills.town_gallery import selected_weather
from mmw.worlds.checks.check import stage_path
from mmw.worlds.checks.stage_model import open_stage_model

Point = Sequence[float]


@dataclass(frozen=True)
class Viewpoint:
    """Viewpoint of a picture: one of three kinds, or none."""

    agent: str = ""
    """Agent that carries `camera`."""
    camera: str = ""
    """An RGB camera of the configuration."""
    eye: Point | None = None
    """Position of the eye, world frame [m]."""
    target: Point | None = None
    """Point that the eye looks at, world frame [m]."""
    follow: str = ""
    """Actor that is followed from behind."""

    def __post_init__(self) -> None:
        for one, other, first, second in (
            (self.agent, self.camera, "--agent", "--camera"),
            (self.eye, self.target, "--eye", "--look-at"),
        ):
            if bool(one) != bool(other):
                given, missing = (first, second) if one else (second, first)
                raise InputError(f"{given} is given without {missing}; a view needs both; add {missing}")
        if sum((bool(self.agent), bool(self.eye), bool(self.follow))) > 1:
            raise InputError(
                "more than one of --agent, --eye and --follow is given; a picture has one view; leave the others out"
            )


def resized(camera: RgbCamera, size: Mapping[str, int]) -> RgbCamera:
    """Return a camera with some of `width_px`, `height_px` and `samples` replaced.

    Raises:
        InputError: If the camera cannot have this size.
    """
    try:
        return RgbCamera.model_validate({**camera.model_dump(), **size})
    except ValidationError as error:
        problem = error.errors()[0]
        key = ".".join(map(str, problem["loc"])) or "lens"
        raise InputError(
            f"camera {camera.name!r} with {dict(size)}: {key}: {problem['msg']}; change the size"
        ) from None


def draw_scenario(
    path: str | Path,
    viewpoint: Viewpoint,
    size: Mapping[str, int],
    *,
    scenario: str = "",
    frame: int | None = None,
    weather: str = "",
    device: str = "auto",
) -> tuple[Image.Image, tuple[str, ...]]:
    """Return a picture of a configured scenario, with its traffic, and notes on its textures.

    From a camera of the configuration it is the very image that a run stores, before compression.

    Args:
        path: Configuration file, or the name of a shipped one.
        viewpoint: Viewpoint; the first CAV, else the first VRU or drone, is followed if it is empty.
        size: Values of `width_px`, `height_px` and `samples` instead of the camera's.
        scenario: Its name; the first if empty.
        frame: Frame; the first that the configuration makes if None.
        weather: One of the configuration's weathers or a preset; the first weather if empty.
        device: Warp device that renders: `auto`, `cpu` or `cuda:N`.

    Raises:
        InputError: If there is no such scenario, frame, weather, agent or camera, or the configuration cannot be used.
    """
    path = config_path(path)
    config = load_config(path)
    select_bvh(config.compute.bvh)
    found = config.scenario(scenario)
    frame = config.frames_of(found).start if frame is None else frame
    weather = weather or config.weathers[0]
    values, variants = _configured_weather(config, weather)
    cameras = {sensor.name: sensor for sensor in config.sensors if sensor.type == "rgb"}
    if viewpoint.camera and viewpoint.camera not in cameras:
        listed = f"it has {', '.join(cameras)}" if cameras else "it has none"
        raise InputError(f"{path}: has no RGB camera {viewpoint.camera!r}; {listed}; name one, or use --eye")
    check_inputs(config, path.parent)
    with tempfile.TemporaryDirectory() as folder:
        stage = prepare_scenario(config, found, path.parent, Path(folder))
        arrays = read_stage(
            stage, _frames(frame), {weather: variants}, margin=1, rate_hz=config.frame_rate_of(found),
            roles=found.actor_roles, material_map=config.materials_of(found), foliage=config.foliage,
        )  # fmt: skip
        pictures = load_renderer(arrays, frame, {weather: values}, seed=config.seed_of_scene, device=device)
        if not viewpoint.camera:
            followed = viewpoint.follow or first_agent(arrays)
            image = _from_eye(pictures, frame, weather, viewpoint, followed, size)
            return image, pictures.notes
        camera, stream = resized(cameras[viewpoint.camera], size), (config.seed, found.name)
        images = camera_images(pictures, frame, [weather], camera, viewpoint.agent, stream)
        return Image.fromarray(images[weather]), pictures.notes


def first_agent(arrays: SceneData) -> str:
    """Return the first CAV, else the first agent that moves; empty without one."""
    for roles in (("cav",), ("vru", "uav")):
        for actor in arrays.actors:
            if actor.role in roles:
                return actor.name
    return ""


def camera_images(
    pictures: StillRenderer, frame: int, weathers: Sequence[str], camera: RgbCamera, agent: str, stream: tuple[int, str]
) -> dict[str, np.ndarray]:
    """Return what a camera of an agent sees in some weathers, as a run stores it: sRGB, shape [H, W, 3], uint8.

    Args:
        pictures: Renderer of the scene.
        frame: Frame.
        weathers: Weathers.
        camera: The camera.
        agent: Agent that carries it.
        stream: Seed and scenario of the random numbers.

    Raises:
        InputError: If no such agent carries the camera in the frame.
    """
    arrays = pictures.scene.arrays
    views = make_views(arrays, [frame], camera)
    carriers = [arrays.actors[actor].name for actor in views.actor]
    if agent not in carriers:
        raise InputError(
            f"no agent {agent!r} carries camera {camera.name!r} in frame {frame}; those that do: "
            f"{', '.join(carriers) or 'none'}; name one of them"
        )
    views = views.take(np.array([carriers.index(agent)]))
    keys = {weather: view_keys(arrays, views, *stream, weather, camera.name) for weather in weathers}
    return {weather: images[0] for weather, images in pictures.render(views, camera, keys).items()}


def draw_stage(
    name: str, viewpoint: Viewpoint, size: Mapping[str, int], *, frame: int = 0, weather: str = "", device: str = "auto"
) -> tuple[Image.Image, tuple[str, ...]]:
    """Return a picture of a town or of any other stage, and notes on its textures.

    Args:
        name: A shipped town, or a USD file.
        viewpoint: Viewpoint; the street view that sees most if it is empty.
        size: Values of `width_px`, `height_px` and `samples` instead of the camera's.
        frame: Frame of an animated stage.
        weather: A preset; the one that the stage has selected if empty.
        device: Warp device that renders: `auto`, `cpu` or `cuda:N`.

    Raises:
        InputError: If there is no such town, frame, weather or actor, the stage cannot be read, or a camera is named.
    """
    if viewpoint.camera:
        raise InputError(
            f"--camera {viewpoint.camera}: a town has no cameras, a configuration has; use --config, or --eye"
        )
    path = stage_path(name)
    selected = selected_weather(path)
    weather = weather or selected
    if weather not in PRESETS and weather != selected:
        raise InputError(f"--weather {weather}: no preset; presets are {', '.join(PRESETS)}; use one of them")
    values = PRESETS.get(weather, Weather())
    arrays = read_stage(path, _frames(frame), {weather: values.variants(weather)})
    pictures = load_renderer(arrays, frame, {weather: values}, device=device)
    if viewpoint.eye is None and not viewpoint.follow:
        view = choose_views(pictures.scene, open_stage_model(path).lanes)[0]
        eye = np.array(view[:3])
        camera = resized(street_camera(fov_deg=FOV_DEG), size)
        return pictures.look(weather, eye, eye + view_direction(view[3]), camera), pictures.notes
    return _from_eye(pictures, frame, weather, viewpoint, viewpoint.follow, size), pictures.notes


def _frames(frame: int) -> range:
    if frame < 0:
        raise InputError(f"--frame {frame}: frames count from 0; give 0 or more")
    return range(frame, frame + 1)


def _configured_weather(config: Config, name: str) -> tuple[Weather, tuple[str, ...]]:
    """Return the values of a weather of a configuration or of a preset, and the variants that may replace it."""
    if name in config.weathers:
        return config.air[name].weather(name), config.variants[name]
    if name in PRESETS:
        return PRESETS[name], PRESETS[name].variants(name)
    raise InputError(
        f"--weather {name}: neither a weather of the configuration ({', '.join(config.weathers)}) nor a preset "
        f"({', '.join(PRESETS)}); use one of them"
    )


def _from_eye(
    pictures: StillRenderer, frame: int, weather: str, viewpoint: Viewpoint, followed: str, size: Mapping[str, int]
) -> Image.Image:
    """Return the picture from the given eye, or of the followed actor."""
    camera = resized(street_camera(), size)
    if viewpoint.eye is not None and viewpoint.target is not None:
        return pictures.look(weather, viewpoint.eye, viewpoint.target, camera)
    arrays = pictures.scene.arrays
    pose = arrays.poses[arrays.frame_row(frame)]
    present = [actor.name for actor, own in zip(arrays.actors, pose, strict=True) if np.isfinite(own).all()]
    if followed not in present:
        listed = f"{', '.join(present[:8])}{', ...' if len(present) > 8 else ''}" if present else "none"
        what = f"no actor {followed!r}" if followed else "no CAV to follow"
        raise InputError(f"{what} in frame {frame}; it has {listed}; name one with --follow, or use --eye")
    eye, target = follow_view(pose[[actor.name for actor in arrays.actors].index(followed)])
    return pictures.look(weather, eye, target, camera)
