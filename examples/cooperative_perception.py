"""Cooperative perception: one moment as OPV2V files, read back, all agents' points in the ego's frame, and a picture.

    python -m examples.cooperative_perception out/quickstart --frame 0 --out out/cooperative

writes the folder that OpenCOOD's loaders read and `bev.png`, and prints which vehicles the ego sees alone and which it
sees with the help of the others. Only the exported files are read, as by a detector's data loader.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from matplotlib.figure import Figure

from mmw.dataset import open_dataset
from mmw.dataset.camera_geometry import box_corners, from_world, to_world
from mmw.dataset.export.carla_frames import carla_point, pose_from_carla
from mmw.dataset.export.exporter import Selection, export
from mmw.dataset.export.pcd import RGB
from mmw.viz.plots.bird_eye import FRONT, OUTLINE
from mmw.viz.plots.style import BLUE, DARK, GREEN, GREY, ORANGE, PURPLE, RED, SKY

MIN_POINTS = 5
"""LiDAR returns from which a vehicle counts as seen. Design value."""

AGENT_COLORS = (SKY, GREEN, PURPLE, BLUE)


@dataclass(frozen=True)
class View:
    """Data of one agent."""

    name: str
    """Its folder."""
    pose: np.ndarray
    """LiDAR to world, shape [7]."""
    points: np.ndarray
    """Returns in its LiDAR's frame [m], x forward, y left, z up, shape [N, 3]."""
    vehicles: dict[int, dict]
    """Object -> its entry in the YAML file."""


def read_view(folder: Path, frame: int) -> View:
    """Read one agent's files of one frame, and turn CARLA's left-handed axes into ours."""
    content = yaml.safe_load((folder / f"{frame:06d}.yaml").read_text())
    data = (folder / f"{frame:06d}.pcd").read_bytes()
    cloud = np.frombuffer(data[data.index(b"DATA binary\n") + len(b"DATA binary\n") :], RGB)
    points = carla_point(np.stack([cloud[axis] for axis in "xyz"], axis=1))
    return View(folder.name, pose_from_carla(content["lidar_pose"]), points, content["vehicles"])


def corners_of(vehicle: dict) -> np.ndarray:
    """Return the corners of a vehicle's box in the world [m], shape [8, 3]."""
    pose = carla_point(np.add(vehicle["location"], vehicle["center"]))
    roll, yaw, pitch = np.radians(vehicle["angle"])
    size = 2.0 * np.array(vehicle["extent"])
    columns = ("x", "y", "z", "yaw", "pitch", "roll", "length", "width", "height")
    return box_corners(
        {name: [value] for name, value in zip(columns, (*pose, -yaw, -pitch, roll, *size), strict=True)}
    )[0]


def seen_points(views: Sequence[View]) -> dict[int, int]:
    """Return how many returns all views together have of every vehicle but the ego, whose view is the first."""
    count: dict[int, int] = {}
    for view in views:
        for number, vehicle in view.vehicles.items():
            count[number] = count.get(number, 0) + vehicle["lidar_points"]
    count.pop(int(views[0].name), None)
    return count


def draw(views: Sequence[View], extent_m: float) -> Figure:
    """Draw all points and boxes from above in the frame of the first view's LiDAR."""
    ego, figure = views[0], Figure(figsize=(8, 8), layout="constrained")
    axes = figure.subplots()
    axes.set_facecolor(DARK)
    for view, color in zip(views, AGENT_COLORS * len(views), strict=False):
        x, y, _ = from_world(ego.pose, to_world(view.pose, view.points)).T
        axes.scatter(-y, x, s=0.6, linewidths=0, color=color, label=f"LiDAR of {view.name}", rasterized=True)
    alone, together = seen_points([ego]), seen_points(views)
    for number, vehicle in {n: v for view in views for n, v in view.vehicles.items()}.items():
        by_ego, by_all = alone.get(number, 0) >= MIN_POINTS, together.get(number, 0) >= MIN_POINTS
        floor = from_world(ego.pose, corners_of(vehicle))
        color = ORANGE if by_ego else RED if by_all else GREY
        axes.plot(-floor[OUTLINE, 1], floor[OUTLINE, 0], color=color, lw=1.6)
        front = np.stack([floor[[0, 2, 4, 6]].mean(axis=0), floor[FRONT].mean(axis=0)])
        axes.plot(-front[:, 1], front[:, 0], color=color, lw=1.6)
    for color, text in ((ORANGE, "seen by the ego"), (RED, "seen by the others"), (GREY, "the ego, or hardly seen")):
        axes.plot([], [], color=color, label=text)
    limits = (-extent_m, extent_m)
    axes.set(xlim=limits, ylim=limits, aspect="equal", xlabel="right of the ego [m]", ylabel="ahead of the ego [m]")
    axes.legend(loc="upper right", fontsize="small", markerscale=8)
    return figure


def main(argv: Sequence[str] | None = None) -> None:
    """Export, read back, count, draw."""
    parser = argparse.ArgumentParser(prog="python -m examples.cooperative_perception")
    parser.add_argument("root", type=Path, help="dataset with LiDAR")
    parser.add_argument("--out", type=Path, required=True, help="folder of the export")
    parser.add_argument("--scenario", help="scenario (the first)")
    parser.add_argument("--weather", help="weather (the first)")
    parser.add_argument("--frame", type=int, default=0, help="frame")
    parser.add_argument("--extent", type=float, default=80.0, help="half of the picture's side [m]")
    given = parser.parse_args(argv)
    first = open_dataset(given.root).read("frames", columns=["scenario", "weather"]).slice(0, 1).to_pylist()[0]
    scenario, weather = given.scenario or first["scenario"], given.weather or first["weather"]
    moment = Selection((scenario,), (weather,), frames=range(given.frame, given.frame + 1))
    export(given.root, "opv2v", given.out, moment, {"rate": "100", "images": "none"})
    folders = [path for path in (given.out / "train" / f"{scenario}_{weather}").iterdir() if path.is_dir()]
    folders.sort(
        key=lambda path: (path.name == "-1", path.name)
    )  # vehicles first, as OpenCOOD; -1 is the roadside unit
    views = [read_view(folder, given.frame) for folder in folders]
    draw(views, given.extent).savefig(given.out / "bev.png", dpi=150)
    known = [sum(points >= MIN_POINTS for points in seen_points(some).values()) for some in (views[:1], views)]
    print(f"{scenario}, {weather}, frame {given.frame}: {', '.join(view.name for view in views)}; the first is the ego")
    alone, together = known
    print(
        f"vehicles with {MIN_POINTS} returns or more: {alone} by the ego alone, {together} by all {len(views)} agents"
    )
    print(f"picture: {given.out / 'bev.png'}")


if __name__ == "__main__":
    main(sys.argv[1:])
