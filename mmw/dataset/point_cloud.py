"""Hold the points of one LiDAR or radar at one instant; they and their place in the world are made when asked for."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mmw.dataset.camera_geometry import to_world

XYZ = dict.fromkeys("xyz").keys()
"""Columns that place points."""
DIRECTED = dict.fromkeys(("range", "azimuth", "elevation")).keys()
"""Columns that place points otherwise."""


@dataclass(frozen=True)
class PointCloud:
    """Points of one LiDAR or radar at one instant."""

    agent: str
    sensor: str
    pose: np.ndarray
    """Sensor to world, shape [7]."""
    points: np.ndarray
    """Sensor frame [m], shape [N, 3], float32."""
    columns: dict[str, np.ndarray]
    """Columns of each point, shape [N] each: of a LiDAR intensity, ring, object_id, label, time_offset,
    return_number and, if configured, flow_x ...; of a radar range, azimuth, elevation, velocity, power_db, ..."""

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, column: str) -> np.ndarray:
        return self.columns[column]

    @property
    def world(self) -> np.ndarray:
        """The points in the world [m], shape [N, 3], float64."""
        return to_world(self.pose, self.points)


def has_points(columns: Mapping[str, np.ndarray]) -> bool:
    """Return whether columns place points, see `points_of`."""
    return columns.keys() >= XYZ or columns.keys() >= DIRECTED


def points_of(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return points [N, 3] by their x, y and z, or by range, azimuth (to the left) and elevation."""
    if columns.keys() >= XYZ:
        return np.stack([columns[axis] for axis in XYZ], axis=1)
    distance, azimuth, elevation = (columns[name] for name in DIRECTED)
    across = distance * np.cos(elevation)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), distance * np.sin(elevation)], axis=1)


class SampledCloud(PointCloud):
    """Points of a row of a table, a `PointCloud` in all else: most are looked at in part, or not at all."""

    def __init__(self, agent: str, sensor: str, columns: Mapping[str, np.ndarray], pose: Callable[[], np.ndarray]):
        """Take the columns of each point, which `has_points`, and what returns the pose of the sensor."""
        own = dict(columns)
        if columns.keys() >= XYZ:
            for axis in XYZ:
                del own[axis]
        self.__dict__.update(agent=agent, sensor=sensor, columns=own, _given=columns, _pose=pose)

    def __len__(self) -> int:
        return len(next(iter(self._given.values())))

    @cached_property
    def pose(self) -> np.ndarray:
        """Sensor to world, shape [7]."""
        return self._pose()

    @cached_property
    def points(self) -> np.ndarray:
        """Sensor frame [m], shape [N, 3], float32."""
        return points_of(self._given)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and send the points alone, as what they were made from may belong to a simulation."""
        return PointCloud, (self.agent, self.sensor, self.pose, self.points, self.columns)
