"""One set of pictures of a dataset: the town from above, a street, a LiDAR scan, a depth image, a link over time."""

from pathlib import Path

import numpy as np

from mmw.scene import Scene
from mmw.scene_reader import read_stage
from mmw.tables.manifest import read_dataset
from mmw.viewing.plots import plot_depth, plot_lidar, plot_link, read_rows
from mmw.viewing.preview import look, map_view


def make_gallery(
    root: Path, out: Path, *, scenario: str = "", agent: str = "cav_1", frame: int = -1, device: str = "cpu"
) -> list[Path]:
    """Write pictures of one scenario of a dataset, in its first weather.

    Args:
        root: Dataset folder.
        out: Folder for the PNG files.
        scenario: Scenario name; the first one if empty.
        agent: Whose LiDAR and link are shown, and who is followed in the street view.
        frame: Frame to show; the first one if negative.
        device: Warp device that renders.

    Returns:
        The files written.

    Raises:
        ValueError: If the folder is no dataset, or it does not hold the scenario, agent or frame.
    """
    config = read_dataset(root)["config"]
    scenario = scenario or config["scenarios"][0]["name"]
    weather, carriers = config["weathers"][0], config["channel"]["carriers_hz"]
    frame = config["frames"]["start"] if frame < 0 else frame
    stage = root / "stages" / f"{scenario}.usdc"
    arrays = read_stage(stage, range(frame, frame + 1), [weather])
    scene = Scene(arrays, device, 1)
    scene.load_batch([frame])
    names = [actor.name for actor in arrays.actors]
    if agent not in names:
        raise ValueError(f"{root}: scenario {scenario!r} has no agent {agent!r}; it has {', '.join(names[:8])}, ...")
    out.mkdir(parents=True, exist_ok=True)
    low, high = arrays.points[:, :2].min(axis=0), arrays.points[:, :2].max(axis=0)
    files = {name: out / f"{scenario}_{name}.png" for name in ("above", "close", "street", "lidar", "depth", "link")}
    map_view(scene, weather, (low + high) / 2, float((high - low).max()), width=1200).save(files["above"])
    pose = arrays.poses[0, names.index(agent)]
    map_view(scene, weather, pose[:2], 120.0, width=1000).save(files["close"])
    heading = np.array([1 - 2 * (pose[4] ** 2 + pose[5] ** 2), 2 * (pose[3] * pose[4] + pose[5] * pose[6]), 0.0])
    side = np.array([-heading[1], heading[0], 0.0])
    eye = pose[:3] - 9.0 * heading + 2.5 * side + (0, 0, 3.2)
    look(scene, weather, eye, pose[:3] + 12.0 * heading + (0, 0, 1.0), samples=3).save(files["street"])
    plot_lidar(root, scenario, weather, frame, agent, files["lidar"])
    depth_agent = read_rows(root, "depth", ["agent"], scenario=scenario, weather=weather, frame=frame)["agent"][0]
    plot_depth(root, scenario, weather, frame, depth_agent, files["depth"])
    plot_link(root, scenario, weather, agent, carriers[0], files["link"])
    return list(files.values())
