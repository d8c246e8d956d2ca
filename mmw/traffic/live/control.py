"""Command actors of a live simulation: by acceleration, speed, lane, steering or pose."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, Literal

import numpy as np

from mmw.core.errors import InputError
from mmw.core.transforms import normalize
from mmw.traffic.vehicle_pose import MAX_STEER

HARDEST = 6.0
"""Largest acceleration and deceleration that may be asked for [m/s^2]; the drivers of `mmw.traffic.idm` brake no
harder."""

FASTEST = 70.0
"""Largest target speed [m/s]: 252 km/h, above any road; design value."""


@dataclass(frozen=True)
class Control:
    """A command to one actor; it holds until the next one for the same actor. An empty one gives a vehicle back.

    On its route a vehicle follows its lanes, and one of `acceleration_m_s2` and `target_speed_m_s` drives it.
    `steering_rad` and `pose` take it off its route until the next reset: others see it as an obstacle wherever it is.

    Examples:
        >>> Control(target_speed_m_s=8.0, lane_change="left").lane_change
        'left'
        >>> Control(acceleration_m_s2=float("nan"))
        Traceback (most recent call last):
        mmw.core.errors.InputError: Control: acceleration_m_s2 = nan; a number from -6 to 6 is needed
    """

    acceleration_m_s2: float | None = None
    """Acceleration along the path, -6 to 6 [m/s^2]; reached with a jerk of 5 m/s^3 at most. The vehicle does not brake
    for others, bends or junctions, and never drives backward."""
    target_speed_m_s: float | None = None
    """Speed that the driver wants [m/s], >= 0. The driver still keeps to limits, bends, gaps and right of way."""
    lane_change: Literal["left", "right"] | None = None
    """Change lanes once, as soon as it is safe and there is such a lane; a later control without it withdraws it."""
    steering_rad: float | None = None
    """Angle of the front wheels, positive to the left, -0.7 to 0.7 [rad]; goes with an acceleration or none (0)."""
    pose: Any = None
    """Body to world (x, y, z, qx, qy, qz, qw), or (x, y, z, yaw): where the actor is, whatever is in its way."""

    def __post_init__(self) -> None:
        _check("acceleration_m_s2", self.acceleration_m_s2, -HARDEST, HARDEST)
        _check("target_speed_m_s", self.target_speed_m_s, 0.0, FASTEST)
        _check("steering_rad", self.steering_rad, -MAX_STEER, MAX_STEER)
        if self.lane_change not in (None, "left", "right"):
            raise InputError(f"Control: lane_change = {self.lane_change!r}; left, right or None is needed")
        given = [name for name in self.__dataclass_fields__ if getattr(self, name) is not None]
        for name, others in _ALONE.items():
            clash = [other for other in others if name in given and other in given]
            if clash:
                raise InputError(f"Control: {name} and {clash[0]} are both given; they exclude each other; give one")
        if self.pose is not None:
            object.__setattr__(self, "pose", unit_pose(self.pose, "Control"))

    @property
    def is_empty(self) -> bool:
        """Whether it commands nothing."""
        drives = self.acceleration_m_s2 is not None or self.target_speed_m_s is not None
        return not drives and self.lane_change is None and self.steering_rad is None and self.pose is None


_ALONE = {
    "pose": ("acceleration_m_s2", "target_speed_m_s", "lane_change", "steering_rad"),
    "acceleration_m_s2": ("target_speed_m_s",),
    "steering_rad": ("target_speed_m_s", "lane_change"),
}
"""Keys that exclude others."""


def _check(name: str, value: Any, low: float, high: float) -> None:
    if value is None:
        return
    is_number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not is_number or not isfinite(value) or not low <= value <= high:
        raise InputError(f"Control: {name} = {value}; a number from {low:g} to {high:g} is needed")


def unit_pose(value: Sequence[float], call: str) -> tuple[float, ...]:
    """Return a pose of seven numbers with a unit quaternion.

    Args:
        value: x, y, z and a quaternion or a yaw.
        call: Start of the message.

    Raises:
        InputError: If it is none.
    """
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.shape == (4,) and np.isfinite(numbers).all():
        half = 0.5 * numbers[3]
        numbers = np.array([*numbers[:3], 0.0, 0.0, np.sin(half), np.cos(half)])
    if numbers.shape != (7,) or not np.isfinite(numbers).all() or np.linalg.norm(numbers[3:]) < 1e-6:
        raise InputError(
            f"{call}: pose = {value}; seven finite numbers x, y, z, qx, qy, qz, qw, or four x, y, z, yaw, are needed"
        )
    return (*numbers[:3].tolist(), *normalize(numbers[3:]).tolist())
