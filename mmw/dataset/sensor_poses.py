"""Place the sensors of all agents of a frame in the world, at once."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mmw.core.remember import remembered
from mmw.core.transforms import compose
from mmw.dataset.camera_geometry import poses_from_rows

Row = dict[str, Any]


class SensorPoses:
    """Poses of the sensors and antennas of some agents in the world, composed when one is asked for."""

    def __init__(self, agents: Mapping[str, np.ndarray]) -> None:
        """Take the pose of each agent by its name, shape [7]."""
        self._agents = agents
        self._found: dict[tuple[str, str], np.ndarray] | None = None

    def of(self, agent: str, sensor: str, rows: list[Row]) -> np.ndarray:
        """Return the pose of a sensor of an agent, shape [7]; `rows` are those of table `sensors`."""
        if self._found is None:
            names, mounts = _mounts(rows)
            here = [index for index, (name, _) in enumerate(names) if name in self._agents]
            poses = np.array([self._agents[names[index][0]] for index in here])
            placed = compose(poses, mounts[here])
            self._found = {names[index]: pose for index, pose in zip(here, placed, strict=True)}
        return self._found[agent, sensor]


@remembered(size=8)
def mounted_sensors(rows: list[Row]) -> dict[str, dict[str, Row]]:
    """Return the rows of table `sensors` by agent and sensor."""
    found: dict[str, dict[str, Row]] = {}
    for row in rows:
        found.setdefault(row["agent"], {})[row["sensor"]] = row
    return found


@remembered(size=8)
def sensors_of_types(rows: list[Row]) -> dict[tuple[str, str], list[str]]:
    """Return the names of the sensors of each agent and type in table `sensors`."""
    found: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        found.setdefault((row["agent"], row["type"]), []).append(row["sensor"])
    return found


@remembered(size=8)
def _mounts(rows: list[Row]) -> tuple[list[tuple[str, str]], np.ndarray]:
    """Return agent and sensor of each row of table `sensors`, and the pose of the sensor on the agent, shape [N, 7]."""
    return [(row["agent"], row["sensor"]) for row in rows], poses_from_rows(rows)
