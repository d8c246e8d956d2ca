"""One set of pictures of a dataset: the town from above, a street, every sensor, weathers side by side, a link."""

from pathlib import Path
from typing import Any

from mmw.config import load_config
from mmw.core.device import choose_device
from mmw.core.errors import InputError
from mmw.dataset import open_dataset
from mmw.scene.device_scene import DeviceScene
from mmw.scene.prepare import stored_stage
from mmw.scene.reader import read_stage
from mmw.storage.manifest import CONFIG, read_dataset
from mmw.viz.stills.jpeg import save_jpeg
from mmw.viz.stills.plots import (
    plot_camera,
    plot_depth,
    plot_lidar,
    plot_link,
    plot_radar,
    plot_rgb,
    read_rows,
    segmented_cameras,
)
from mmw.viz.stills.renderer import StillRenderer, follow_view, map_frame, street_camera
from mmw.viz.stills.weather_plots import plot_lidar_weathers, plot_radar_weathers

PICTURES = (
    "above", "close", "street", "lidar", "lidar_weathers", "radar", "radar_weathers", "rgb", "depth", "camera",
    "link",
)  # fmt: skip
"""Names of the pictures."""

RENDERED = ("above", "close", "street")
"""Those that the RGB camera takes, as JPEG files."""

MAP_PX = 1200
"""Side of the maps [px]."""

STREET_PX = (1280, 720)
"""Width and height of the street view [px]."""

MAX_BYTES = 400_000
"""Size of one of them at most [bytes]. Design value."""


def make_gallery(
    root: Path,
    out: Path,
    *,
    scenario: str = "",
    agent: str = "",
    frame: int = -1,
    samples: int = 4,
    device: str = "auto",
) -> list[Path]:
    """Write pictures of one scenario of a dataset, in its first weather, and LiDAR and radar in all of them.

    Args:
        root: Dataset folder.
        out: Folder for the files.
        scenario: Scenario name; the first one if empty.
        agent: Whose sensors and link are shown, and who is followed in the street view; the first CAV if empty. Of a
            sensor that it does not carry the first agent's is shown.
        frame: Frame to show; the first one if negative.
        samples: Rays in a pixel on an edge, for the rendered pictures: 1, 4 or 9.
        device: Warp device that renders: `auto`, `cpu` or `cuda:N`.

    Returns:
        The files written; none for a table that the dataset does not have.

    Raises:
        InputError: If the folder is no dataset, or it does not hold the scenario, agent or frame.
    """
    read_dataset(root)
    config = load_config(root / CONFIG)
    names = [found.name for found in config.scenarios]
    if scenario and scenario not in names:
        raise InputError(f"{root}: has no scenario {scenario!r}; it has {', '.join(names)}")
    found = config.scenarios[names.index(scenario) if scenario else 0]
    scenario, weather, carriers = found.name, config.weathers[0], config.channel.carriers_hz
    frame = config.frames_of(found).start if frame < 0 else frame
    arrays = read_stage(
        stored_stage(root, found),
        range(frame, frame + 1),
        {weather: config.variants[weather]},
        roles=found.actor_roles,
        material_map=found.material_map,
    )
    scene = DeviceScene(arrays, choose_device(device), 1)
    scene.load_batch([frame])
    names = [actor.name for actor in arrays.actors]
    agent = agent or next((actor.name for actor in arrays.actors if actor.role == "cav"), "")
    if agent not in names:
        raise InputError(f"{root}: scenario {scenario!r} has no agent {agent!r}; it has {', '.join(names[:8])}, ...")
    out.mkdir(parents=True, exist_ok=True)
    files = {name: out / f"{scenario}_{name}.{'jpg' if name in RENDERED else 'png'}" for name in PICTURES}
    pictures = StillRenderer(scene, {weather: config.air[weather].weather(weather)}, seed=config.seed)
    pose = arrays.poses[0, names.index(agent)]
    town = pictures.map_view(weather, *map_frame(scene), width=MAP_PX, samples=samples)
    close = pictures.map_view(weather, pose[:2], 120.0, width=MAP_PX, samples=samples)
    street = pictures.look(weather, *follow_view(pose), street_camera(*STREET_PX, samples))
    for name, image in zip(RENDERED, (town, close, street), strict=True):
        save_jpeg(image, files[name], MAX_BYTES)
    tables = open_dataset(root).tables
    at = {"scenario": scenario, "weather": weather, "frame": frame}
    for table, plot in (("lidar", plot_lidar), ("radar", plot_radar), ("depth", plot_depth)):
        if table in tables:
            plot(root, scenario, weather, frame, _owner(root, table, agent, at), files[table])
    cameras = [owner for owner, _ in segmented_cameras(root, **at)]
    if cameras:
        plot_camera(root, scenario, weather, frame, agent if agent in cameras else cameras[0], files["camera"])
    if "rgb" in tables:
        owner = _owner(root, "rgb", agent, {"scenario": scenario, "weather": weather})
        plot_rgb(root, scenario, config.weathers, frame, owner, files["rgb"])
    for table, plot in (("lidar", plot_lidar_weathers), ("radar", plot_radar_weathers)):
        if table in tables and len(config.weathers) > 1:
            owner = _owner(root, table, agent, at)
            plot(root, scenario, config.weathers, frame, owner, files[f"{table}_weathers"])
    if "links" in tables:
        plot_link(root, scenario, weather, agent, carriers[0], files["link"])
    return [path for path in files.values() if path.is_file()]


def _owner(root: Path, table: str, agent: str, at: dict[str, Any]) -> str:
    """Return the agent if the table has a row of it in a frame, else the first that has one."""
    owners = read_rows(root, table, ["agent"], **at)["agent"]
    return agent if agent in owners else owners[0]
