"""Read mounts, poses, boxes, sweeps and images frame by frame, for the perception formats."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from mmw.core.errors import InputError
from mmw.core.transforms import compose, make_pose, pose_from_ypr
from mmw.dataset import Dataset

BLOCK_FRAMES = 100
"""Frames of the dataset that one task covers, about a shard: 1 s; design value."""

PEOPLE = ("pedestrian",)
"""Categories that are no vehicle."""


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


def sensors_of(dataset: Dataset, scenario: str) -> dict[tuple[str, str], Sensor]:
    """Return the sensors of a scenario by agent and name."""
    result = {}
    for row in dataset.read("sensors", scenario=scenario).to_pylist():
        matrix = None
        if row["fx"] is not None:
            matrix = np.array([[row["fx"], 0.0, row["cx"]], [0.0, row["fy"], row["cy"]], [0.0, 0.0, 1.0]])
        result[row["agent"], row["sensor"]] = Sensor(
            row["agent"], row["sensor"], row["type"], pose_of(row), matrix, (row["width"] or 0, row["height"] or 0),
            row["lens"] or "", tuple(row["coefficients"] or ()), row["params"],
        )  # fmt: skip
    return result


def pick_sensor(sensors: dict[tuple[str, str], Sensor], agent: str, kind: str, name: str, where: str) -> Sensor:
    """Return the sensor of a kind on an agent: the named one, or the only one if no name is given.

    Args:
        sensors: What `sensors_of` returns.
        agent: Agent.
        kind: lidar, rgb, ...
        name: Its name; empty for the only one.
        where: Format and option, for the error.

    Raises:
        InputError: If there is none, or several and no name.
    """
    found = [sensor for (owner, _), sensor in sensors.items() if owner == agent and sensor.type == kind]
    if name:
        found = [sensor for sensor in found if sensor.name == name]
    if len(found) == 1:
        return found[0]
    have = ", ".join(
        sensor.name for (owner, _), sensor in sorted(sensors.items()) if owner == agent and sensor.type == kind
    )
    raise InputError(
        f"{where}{name}: agent {agent} has {have or 'none'} of type {kind}; exactly one is needed; "
        "name it, or leave the agent out by agent=..."
    )


def pose_of(row: dict[str, Any]) -> np.ndarray:
    """Return the pose [7] that a row's x, y, z, qx, qy, qz, qw give."""
    return make_pose([row["x"], row["y"], row["z"]], [row["qx"], row["qy"], row["qz"], row["qw"]])


def box_pose(row: dict[str, Any]) -> np.ndarray:
    """Return the pose [7] of a row of `boxes`: box (x forward, origin in the middle) to world."""
    return pose_from_ypr([row["x"], row["y"], row["z"]], row["yaw"], row["pitch"], row["roll"])


def box_corners(row: dict[str, Any]) -> np.ndarray:
    """Return the corners of a row of `boxes` in its own frame [m], shape [8, 3]."""
    signs = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5], indexing="ij")).reshape(3, 8).T
    return signs * [row["length"], row["width"], row["height"]]


def blocks(frames: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """Yield frames in groups of the same `BLOCK_FRAMES` frames of the dataset."""
    for number in sorted({frame // BLOCK_FRAMES for frame in frames}):
        yield tuple(frame for frame in frames if frame // BLOCK_FRAMES == number)


def rows_of(
    dataset: Dataset,
    table: str,
    scenario: str,
    weather: str,
    frames: Sequence[int],
    columns: Sequence[str] | None = None,
    agent: str | None = None,
) -> list[dict[str, Any]]:
    """Return the rows of some frames as dictionaries, sorted by frame; nothing if the table has no file."""
    if table not in dataset.tables or not frames:
        return []
    names = None if columns is None else [*dict.fromkeys(["frame", *columns])]
    found = dataset.read(
        table, columns=names, scenario=scenario, weather=weather, frames=frame_range(frames), agent=agent
    )
    wanted = set(frames)
    return sorted((row for row in found.to_pylist() if row["frame"] in wanted), key=lambda row: row["frame"])


def by_frame(rows: Sequence[dict[str, Any]]) -> dict[int, list[dict[str, Any]]]:
    """Return rows grouped by their frame."""
    result: dict[int, list[dict[str, Any]]] = {}
    for row in rows:
        result.setdefault(row["frame"], []).append(row)
    return result


def frame_range(frames: Sequence[int]) -> range:
    """Return the shortest range that holds all frames; it may hold others between them."""
    step = reduce(math.gcd, (frame - frames[0] for frame in frames), 0) or 1
    return range(min(frames), max(frames) + 1, step)


def sweeps(
    dataset: Dataset, scenario: str, weather: str, frames: Sequence[int], sensor: Sensor, extra: Sequence[str] = ()
) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
    """Yield frame and columns of each sweep of a LiDAR: x, y, z, intensity and `extra`, each of shape [N]."""
    names = ["x", "y", "z", "intensity", *extra]
    table = dataset.read(
        "lidar", columns=["frame", "sensor", *names], scenario=scenario, weather=weather,
        frames=frame_range(frames), agent=sensor.agent,
    )  # fmt: skip
    wanted = set(frames)
    for index, (frame, name) in enumerate(zip(table["frame"].to_pylist(), table["sensor"].to_pylist(), strict=True)):
        if name == sensor.name and frame in wanted:
            yield frame, {column: table[column][index].values.to_numpy(zero_copy_only=False) for column in names}


def recorded(
    dataset: Dataset, table: str, scenario: str, weather: str, frames: Sequence[int], agent: str
) -> dict[str, set[int]]:
    """Return the frames of each sensor of an agent that have a row in a table."""
    result: dict[str, set[int]] = {}
    for row in rows_of(dataset, table, scenario, weather, frames, ["sensor"], agent):
        result.setdefault(row["sensor"], set()).add(row["frame"])
    return result


def sensor_to_world(agent_pose: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Return the pose [7] of a sensor in the world."""
    return compose(agent_pose, sensor.mount)
