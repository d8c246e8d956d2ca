"""Read mounts, poses, boxes, sweeps and images frame by frame, for the perception formats."""

import json
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from mmw.core.errors import InputError
from mmw.core.file_names import check_file_name
from mmw.core.geodesy import world_from_mercator, world_from_wgs84
from mmw.core.transforms import compose, make_pose, pose_from_ypr
from mmw.dataset import Dataset
from mmw.dataset.camera_geometry import CORNERS

BLOCK_FRAMES = 100
"""Frames of the dataset that one task covers, about a shard: 1 s; design value."""

PEOPLE = ("pedestrian",)
"""Categories that are no vehicle."""

NAMES = ("agent", "peer", "sensor")
"""Columns whose values may become names of files."""

Row = dict[str, Any]
"""Row of a table: column -> value."""


@dataclass(frozen=True)
class Sensor:
    """One sensor of one agent."""

    agent: str
    name: str
    type: str
    mount: np.ndarray
    """Pose sensor to agent, shape [7]."""
    intrinsic: np.ndarray | None
    """Camera matrix [px], shape [3, 3], columns counted from the left edge; None if not a camera."""
    size: tuple[int, int]
    """Width and height [px]; 0, 0 if not a camera."""
    lens: str
    coefficients: tuple[float, ...]
    params: str
    """JSON: the sensor's section of the configuration."""


def sensors_of(dataset: Dataset, scenario: str) -> dict[str, dict[str, Sensor]]:
    """Return the sensors of a scenario by agent, then by name; those of an agent without any are empty.

    Raises:
        InputError: If a name cannot be that of a file, or an RGB camera has no intrinsic parameters.
    """
    result: dict[str, dict[str, Sensor]] = defaultdict(dict)
    for row in dataset.read("sensors", scenario=scenario).to_pylist():
        check_file_name(row["sensor"], "sensor", dataset.root)
        lost = [name for name in ("fx", "fy", "cx", "cy") if row[name] is None]
        if lost and (row["type"] == "rgb" or len(lost) < 4):
            raise InputError(
                f"{dataset.root}: table 'sensors': {', '.join(lost)} of {row['agent']} {row['sensor']} is null; a "
                "camera needs a number; put the old table back"
            )
        matrix = None
        if row["fx"] is not None:
            matrix = np.array([[row["fx"], 0.0, row["cx"]], [0.0, row["fy"], row["cy"]], [0.0, 0.0, 1.0]])
        result[row["agent"]][row["sensor"]] = Sensor(
            row["agent"], row["sensor"], row["type"], pose_of(row), matrix, (row["width"] or 0, row["height"] or 0),
            row["lens"] or "", tuple(row["coefficients"] or ()), row["params"],
        )  # fmt: skip
    return result


def pick_sensor(sensors: Mapping[str, Sensor], agent: str, type_: str, name: str, where: str) -> Sensor:
    """Return the sensor of a type among those of an agent: the named one, or the only one if no name is given.

    Raises:
        InputError: If there is none, or several and no name; it begins with `where`, the format and option.
    """
    own = sorted(known for known, sensor in sensors.items() if sensor.type == type_)
    found = [known for known in own if name in ("", known)]
    if len(found) == 1:
        return sensors[found[0]]
    raise InputError(
        f"{where}{name}: agent {agent} has {', '.join(own) or 'none'} of type {type_}; "
        "exactly one is needed; name it, or leave the agent out by agent=..."
    )


def pose_of(row: Row) -> np.ndarray:
    """Return the pose [7] that a row's x, y, z, qx, qy, qz, qw give."""
    return make_pose([row["x"], row["y"], row["z"]], [row["qx"], row["qy"], row["qz"], row["qw"]])


def box_pose(row: Row) -> np.ndarray:
    """Return the pose [7] of a row of `boxes`: box (x forward, origin at the center) to world."""
    return pose_from_ypr([row["x"], row["y"], row["z"]], row["yaw"], row["pitch"], row["roll"])


def box_corners(row: Row) -> np.ndarray:
    """Return the corners of a row of `boxes` in its own frame [m], shape [8, 3]."""
    return CORNERS * [row["length"], row["width"], row["height"]]


def gnss_position(row: Row, sensor: Sensor) -> np.ndarray:
    """Return the position of a row of `gnss` in the world [m], shape [3], by the reference point of its sensor.

    Raises:
        InputError: If the parameters of the sensor do not hold it.
    """
    try:
        params = json.loads(sensor.params)
        reference = [float(params[f"reference_{name}"]) for name in ("latitude_deg", "longitude_deg", "altitude_m")]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise InputError(
            f"table sensors: params of {sensor.agent} {sensor.name} hold no reference point ({type(error).__name__}: "
            f"{error}); the table was changed; put the old one back"
        ) from error
    to_world = world_from_mercator if params["mode"] == "carla" else world_from_wgs84
    return to_world([row["latitude_deg"], row["longitude_deg"], row["altitude_m"]], reference)


def by_frame(rows: Sequence[Row]) -> dict[int, list[Row]]:
    """Return rows grouped by their frame."""
    result: dict[int, list[Row]] = {}
    for row in rows:
        result.setdefault(row["frame"], []).append(row)
    return result


def _frame_range(frames: Sequence[int]) -> range:
    """Return the shortest range that holds all frames; it may hold others between them."""
    step = reduce(math.gcd, (frame - frames[0] for frame in frames), 0) or 1
    return range(min(frames), max(frames) + 1, step)


@dataclass(frozen=True)
class Block:
    """Frames of one scenario in one weather, and an agent whose rows are read."""

    dataset: Dataset
    scenario: str
    weather: str
    frames: Sequence[int]
    agent: str | None = None
    """None reads the rows of all agents."""

    def split(self) -> "Iterator[Block]":
        """Yield the frames in groups of the same `BLOCK_FRAMES` frames of the dataset."""
        for number in sorted({frame // BLOCK_FRAMES for frame in self.frames}):
            yield replace(self, frames=tuple(frame for frame in self.frames if frame // BLOCK_FRAMES == number))

    def rows(self, table: str, columns: Sequence[str] | None = None) -> list[Row]:
        """Return the rows of a table as dictionaries, sorted by frame; nothing if the table has no file."""
        if table not in self.dataset.tables or not self.frames:
            return []
        names = None if columns is None else [*dict.fromkeys(["frame", *columns])]
        return sorted(self.table(table, names).to_pylist(), key=lambda row: row["frame"])

    def boxes(self) -> dict[int, list[Row]]:
        """Return the rows of table `boxes` of each frame, whatever the agent."""
        return by_frame(replace(self, agent=None).rows("boxes"))

    def vehicles(self) -> dict[int, list[Row]]:
        """Return the boxes of vehicles in each frame, whatever the agent: no people and no drones."""
        poses = replace(self, agent=None).rows("poses", ["agent", "role"])
        drones = {row["agent"] for row in poses if row["role"] == "uav"}
        return {
            frame: [row for row in rows if row["category"] not in PEOPLE and row["agent"] not in drones]
            for frame, rows in self.boxes().items()
        }

    def recorded(self, table: str) -> dict[str, set[int]]:
        """Return the frames of each sensor of the agent that have a row in a table."""
        result: dict[str, set[int]] = {}
        for row in self.rows(table, ["sensor"]):
            result.setdefault(row["sensor"], set()).add(row["frame"])
        return result

    def sweeps(self, lidar: Sensor, extra: Sequence[str] = ()) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
        """Yield frame and columns of each sweep of a LiDAR: x, y, z, intensity and `extra`, each of shape [N]."""
        names = ["x", "y", "z", "intensity", *extra]
        table = self.table("lidar", ["frame", "sensor", *names])
        keys = zip(table["frame"].to_pylist(), table["sensor"].to_pylist(), strict=True)
        for index, (frame, name) in enumerate(keys):
            if name == lidar.name:
                yield frame, {column: table[column][index].values.to_numpy(zero_copy_only=False) for column in names}

    def sweep_of_each(self, lidar: Sensor) -> dict[int, dict[str, np.ndarray]]:
        """Return the columns of the sweep of every frame, see `sweeps`.

        Raises:
            InputError: If a frame has none.
        """
        found = dict(self.sweeps(lidar))
        if missing := sorted(set(self.frames) - set(found)):
            raise InputError(
                f"{self.dataset.root}: {self.scenario}, {self.weather}, frame {missing[0]}: {lidar.agent} has no sweep "
                f"of {lidar.name}; every frame needs one; pick other frames"
            )
        return found

    def table(self, name: str, columns: Sequence[str] | None = None) -> pa.Table:
        """Return the rows of a table; `frame` is among the columns.

        Raises:
            InputError: If the name of an agent or sensor cannot be that of a file, or an image is null.
        """
        rows = self.dataset.read(
            name, columns=columns, scenario=self.scenario, weather=self.weather, frames=_frame_range(self.frames),
            agent=self.agent,
        )  # fmt: skip
        rows = rows.filter(pc.is_in(rows["frame"], value_set=pa.array(self.frames, pa.int32())))
        for kind in set(NAMES) & set(rows.column_names):
            for text in rows[kind].unique().drop_null().to_pylist():
                check_file_name(text, kind, self.dataset.root)
        if "image" in rows.column_names and (count := rows["image"].null_count):
            raise InputError(
                f"{self.dataset.root}: table {name!r}: image is null in {count} rows of {self.weather}; "
                "an export needs each; pick other frames"
            )
        return rows


def sensor_to_world(agent_pose: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Return the pose [7] of a sensor in the world."""
    return compose(agent_pose, sensor.mount)
