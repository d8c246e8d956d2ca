"""A small real dataset for the tests of the exporters: tilted sensors, people, rain, cameras at half the rate.

Poses are turned into matrices here by trimesh, not by `mmw.poses`, so that the tests have their own word for them.
"""

import atexit
import shutil
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import trimesh.transformations as tf

from mmw.dataset import Dataset, open_dataset
from mmw.run import main

CONFIG = Path(__file__).parent.parent / "configs" / "quickstart.yaml"
FRAMES = range(6)
IMAGE_FRAMES = (0, 2, 4)
SIZE = (160, 120)
"""Width and height of the images [px]."""
MOUNT = "mount: {cav: {position_m: [%s], yaw_deg: %s, pitch_deg: %s, roll_deg: %s}, rsu: {position_m: [0, 0, 4], %s}}"
SENSORS = ", ".join(
    (
        "[{type: lidar, channels: 48, points_per_channel: 360, "
        + MOUNT % ("0.2, 0.1, 2.4", 20, 3, -2, "yaw_deg: 15, pitch_deg: 8")
        + "}",
        "{type: rgb, name: front, every_frames: 2, width_px: 160, height_px: 120, samples: 1, on: [cav, rsu], "
        + MOUNT % ("1.5, 0, 2.2", 5, 4, 3, "pitch_deg: 10")
        + "}",
        "{type: rgb, name: left, every_frames: 2, width_px: 160, height_px: 120, samples: 1, format: png, on: [cav], "
        "mount: {cav: {position_m: [0, 0.7, 2.2], yaw_deg: 90}}}",
        "{type: gnss, mount: {cav: {position_m: [0.5, 0.2, 1.5], yaw_deg: 10}}}]",
    )
)


@cache
def dataset() -> Dataset:
    """Make the dataset, once a process; it takes some seconds."""
    root = Path(mkdtemp(prefix="mmw_export_")) / "d"
    atexit.register(shutil.rmtree, root.parent, ignore_errors=True)
    code = main(
        ["--config", str(CONFIG), "--out", str(root), "--device", "cpu", f"frames.count={len(FRAMES)}",
         "weathers=[rainy]", "channel.enabled=false", f"sensors={SENSORS}",
         "scenarios.0.traffic.pedestrian_count=6"]
    )  # fmt: skip
    assert code == 0
    return open_dataset(root)


def rows(table: str, **where: object) -> list[dict]:
    """Return the rows of a table whose columns have the given values."""
    return [found for found in _table(table) if all(found[name] == value for name, value in where.items())]


@cache
def _table(name: str) -> list[dict]:
    return dataset().read(name).to_pylist()


def row(table: str, **where: object) -> dict:
    """Return the only such row."""
    (found,) = rows(table, **where)
    return found


def matrix(row: dict) -> np.ndarray:
    """Return the transform that x, y, z, qx, qy, qz, qw of a row give, shape [4, 4]."""
    result = tf.quaternion_matrix([row["qw"], row["qx"], row["qy"], row["qz"]])
    result[:3, 3] = row["x"], row["y"], row["z"]
    return result


def box_matrix(box: dict) -> np.ndarray:
    """Return the transform box to world, shape [4, 4]."""
    result = tf.euler_matrix(box["yaw"], box["pitch"], box["roll"], "rzyx")
    result[:3, 3] = box["x"], box["y"], box["z"]
    return result


def corners(length: float, width: float, height: float) -> np.ndarray:
    """Return the corners of a box about the origin, shape [8, 3]."""
    return np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * [
        length,
        width,
        height,
    ]


def sensor_matrix(weather: str, frame: int, agent: str, sensor: str) -> np.ndarray:
    """Return the transform sensor to world, shape [4, 4]."""
    pose = row("poses", weather=weather, frame=frame, agent=agent)
    return matrix(pose) @ matrix(row("sensors", agent=agent, sensor=sensor))


def move(transform: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return points [N, 3] moved by a transform [4, 4]."""
    return points @ transform[:3, :3].T + transform[:3, 3]


def cloud(sweep: dict) -> np.ndarray:
    """Return x, y, z of a row of `lidar`, shape [N, 3]."""
    return np.stack([sweep[axis] for axis in "xyz"], axis=-1)
