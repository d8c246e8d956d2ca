"""Read links, paths and antenna poses, for the radio formats."""

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from mmw.core.errors import InputError
from mmw.core.transforms import compose, make_pose, normalize, rotate
from mmw.dataset import Dataset
from mmw.dataset.camera_geometry import POSE_COLUMNS
from mmw.dataset.export.exporter import Part
from mmw.dataset.export.read_sensors import Block


@dataclass(frozen=True)
class Antennas:
    """Antennas of agents in frames, row by row of table `poses`."""

    row: dict[tuple[int, str], int]
    """(frame, agent) -> row."""
    pose: np.ndarray
    """Antenna to world, shape [n, 7]."""
    velocity: np.ndarray
    """World frame [m/s], shape [n, 3]."""
    role: list[str]

    def at(self, keys: list[tuple[int, str]]) -> tuple[np.ndarray, np.ndarray]:
        """Return poses [k, 7] and velocities [k, 3]; NaN where an agent is absent."""
        rows = np.array([self.row.get(key, -1) for key in keys], dtype=np.int64)
        absent = (rows < 0)[:, None]
        return np.where(absent, np.nan, self.pose[rows]), np.where(absent, np.nan, self.velocity[rows])


def read_antennas(dataset: Dataset, part: Part) -> Antennas:
    """Return the poses and velocities of the antennas.

    Raises:
        InputError: If an agent has no antenna in table `sensors`, or several, which the radio formats do not know.
    """
    sensors = dataset.read("sensors", scenario=part.scenario)
    sensors = sensors.filter(pc.equal(sensors["type"].cast(pa.string()), "antenna")).to_pylist()
    mounts = {row["agent"]: np.array([row[name] for name in POSE_COLUMNS]) for row in sensors}
    if len(mounts) < len(sensors):
        raise InputError(
            f"{dataset.root}: table sensors has {len(sensors)} antennas of {len(mounts)} agents; radio formats know "
            "one antenna an agent; read `paths` with mmw.open, or make a dataset with one antenna"
        )
    rows = Block(dataset, part.scenario, part.weather, part.frames).table("poses")
    agents = rows["agent"].to_pylist()
    lost = sorted(set(agents) - set(mounts))
    if lost:
        raise InputError(f"{dataset.root}: table sensors has no antenna of {', '.join(lost)}; record the channel again")
    columns = {
        name: rows[name].to_numpy() for name in rows.column_names if rows.schema.field(name).type == pa.float64()
    }
    q = normalize(np.stack([columns[name] for name in POSE_COLUMNS[3:]], axis=-1))
    agent_pose = make_pose(np.stack([columns[name] for name in "xyz"], axis=-1), q)
    mount = np.array([mounts[agent] for agent in agents])
    arm = np.cross(np.stack([columns[f"w{axis}"] for axis in "xyz"], axis=-1), mount[:, :3])
    keys = zip(rows["frame"].to_pylist(), agents, strict=True)
    return Antennas(
        row={key: index for index, key in enumerate(keys)},
        pose=compose(agent_pose, mount),
        velocity=np.stack([columns[f"v{axis}"] for axis in "xyz"], axis=-1) + rotate(q, arm),
        role=rows["role"].to_pylist(),
    )
