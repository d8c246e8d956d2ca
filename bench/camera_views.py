"""Scenes and views that the camera benchmarks share: a scenario's town and traffic, the paper's cameras."""

import atexit
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from bench.scenes import grid_town, with_vehicles
from mmw.config import load_config
from mmw.physics.weather.weather import PRESETS
from mmw.scene.device_scene import DeviceScene
from mmw.scene.prepare import prepare_scenario, read_scenario
from mmw.scene.scene_data import SceneData
from mmw.scene.views import sample_views
from mmw.sensors import RgbCamera
from mmw.sensors.camera_group.launches import Launch, make_launches
from mmw.sensors.rgb.config import paper_cameras
from mmw.sensors.rgb.simulate import RgbRenderer

SCENARIOS = {
    "town03": "town03_roundabout",
    "town05": "town05_cbd_crossroad",
    "town07": "town07_crossroad",
    "town10": "town10_crossroad",
}
"""Town -> its shipped scenario."""

CARRIERS = 3
"""Vehicles with cameras in the procedural town, as many as a scenario has."""


def camera_scene(name: str, frames: int, vehicles: int, weathers: Sequence[str]) -> SceneData:
    """Return a scene with moving vehicles.

    Args:
        name: `grid`, the procedural town with its 40 vehicles, or a town of `SCENARIOS`, with the real models and the
            traffic of its scenario.
        frames: Frames from 0 on.
        vehicles: Vehicles of a scenario.
        weathers: Presets.

    Raises:
        ValueError: If the scenario cannot be made with so many vehicles.
    """
    if name == "grid":
        arrays = with_vehicles(grid_town(), frames)
        actors = tuple(replace(a, role="cav") if i < CARRIERS else a for i, a in enumerate(arrays.actors))
        return replace(arrays, actors=actors, materials=dict.fromkeys(weathers, arrays.materials["sunny"]))
    path = Path(__file__).resolve().parent.parent / "configs" / "scenarios" / f"{SCENARIOS[name]}.yaml"
    config = load_config(
        path,
        [
            f"frames.count={frames}", f"weathers=[{', '.join(weathers)}]",
            f"scenarios.0.traffic.vehicle_count={vehicles}",
        ],
    )  # fmt: skip
    scenario = config.scenarios[0]
    folder = tempfile.mkdtemp(prefix="mmw_bench_")
    atexit.register(shutil.rmtree, folder)  # the camera reads textures from it later
    return read_scenario(config, scenario, prepare_scenario(config, scenario, path.parent, Path(folder)))


def rgb_camera(scene: DeviceScene, weathers: Sequence[str]) -> RgbRenderer:
    """Return what renders images of a scene in some presets.

    Raises:
        ValueError: If a texture is missing: images without it are cheaper.
    """
    camera = RgbRenderer(scene, {name: PRESETS[name] for name in weathers}, seed=0)
    if camera.notes:
        raise ValueError(f"textures: {camera.notes[0]}; a benchmark needs all of them")
    return camera


def launch_of(arrays: SceneData, frames: int, settings: RgbCamera, max_views: int | None = None) -> Launch:
    """Return the views of the paper's cameras in all frames: four on each CAV, one on each roadside unit.

    Args:
        arrays: The scene.
        frames: Frames from 0 on.
        settings: Settings of the cameras; carriers and mounts are replaced.
        max_views: Take only so many views, the first of them.
    """
    cameras = [
        settings.model_copy(update={"name": camera.name, "on": camera.on, "mount": camera.mount})
        for camera in paper_cameras()
    ]
    (launch,) = make_launches(cameras, partial(sample_views, arrays, range(frames)))
    if max_views is not None and max_views < len(launch.views):
        side = settings.width_px * settings.height_px
        launch = next(iter(launch.pieces(max_views * side)))
    return launch
