"""Move a body that is on no route: where its poses are given, or where its front wheels steer it."""

from dataclasses import dataclass
from math import atan, atan2, cos, sin, tan

import numpy as np

from mmw.core.constants import FRAME_DT
from mmw.core.transforms import normalize, rotate
from mmw.traffic.ground_height import Ground
from mmw.traffic.idm.driver import JERK
from mmw.traffic.live.control import Control
from mmw.traffic.live.obstacles import Body
from mmw.traffic.vehicle_pose import Shape, tilted_poses, wheel_places

STEERING_RATE = 0.7
"""Largest rate of the front wheels' angle [rad/s]; design value: lock to lock in 2 s."""

GROUND_SHARE = 0.1
"""Share of the step to height and slopes of the road below that a body takes in 10 ms: a low pass of 0.1 s in place of
that along a route; design value."""


@dataclass
class FreeBody:
    """A vehicle that somebody steers or puts somewhere, or an actor that is put somewhere."""

    shape: Shape
    pose: np.ndarray
    """Body to world, the present row, shape [7]."""
    speed: float = 0.0
    """[m/s], >= 0."""
    heading: float = 0.0
    """[rad]."""
    velocity: tuple[float, float] = (0.0, 0.0)
    """World frame [m/s]."""
    acceleration: float = 0.0
    steering: float = 0.0
    """Angle of the front wheels [rad]."""
    control: Control | None = None
    level: np.ndarray | None = None
    """Height and slopes forward and to the left of a steered body [m, 1, 1]; None where poses are given."""

    @classmethod
    def take_over(cls, shape: Shape, before: np.ndarray, now: np.ndarray) -> "FreeBody":
        """Return a body that goes on from its last two poses at 100 Hz, shape [7] each."""
        forward, left = (rotate(now[3:], axis) for axis in np.eye(3)[:2])
        step = (now[:2] - before[:2]) / FRAME_DT
        slopes = [forward[2] / np.hypot(*forward[:2]), left[2] / max(float(np.hypot(*left[:2])), 1e-9)]
        return cls(
            shape,
            now.copy(),
            speed=float(np.hypot(*step)),
            heading=atan2(forward[1], forward[0]),
            velocity=(float(step[0]), float(step[1])),
            level=np.array([now[2], *slopes]),
        )

    def advance(self, ground: Ground | None) -> np.ndarray:
        """Return the pose one row later, shape [7]; without a control it stays where it is.

        Source: kinematic bicycle about the middle between the axles, Rajamani, Vehicle Dynamics and Control, 2nd ed.,
        section 2.2, with the mean of both ends of the row.
        """
        control = self.control
        if control is not None and self.is_steered and ground is not None:
            self._steer(control, ground)
        elif control is not None and control.pose is not None:
            given = np.array(control.pose)
            forward = rotate(normalize(given[3:]), np.array([1.0, 0.0, 0.0]))
            step = (given[:2] - self.pose[:2]) / FRAME_DT
            self.velocity, self.speed = (float(step[0]), float(step[1])), float(np.hypot(*step))
            self.heading, self.pose, self.level = atan2(forward[1], forward[0]), given, None
            self.acceleration = self.steering = 0.0
        else:
            self.velocity, self.speed = (0.0, 0.0), 0.0
        return self.pose

    @property
    def is_steered(self) -> bool:
        """Whether its front wheels are controlled."""
        return self.control is not None and self.control.steering_rad is not None

    def _steer(self, control: Control, ground: Ground) -> None:
        wanted = (control.acceleration_m_s2 or 0.0) - self.acceleration
        self.acceleration += min(max(wanted, -JERK * FRAME_DT), JERK * FRAME_DT)
        turn = (control.steering_rad or 0.0) - self.steering
        self.steering += min(max(turn, -STEERING_RATE * FRAME_DT), STEERING_RATE * FRAME_DT)
        after = self.speed + self.acceleration * FRAME_DT
        if after <= 0.0:
            after, self.acceleration = 0.0, 0.0
        mean, self.speed = 0.5 * (self.speed + after), after
        slip = atan(0.5 * tan(self.steering))
        rate = mean * cos(slip) * tan(self.steering) / self.shape.wheelbase
        course = self.heading + 0.5 * rate * FRAME_DT + slip
        x = float(self.pose[0]) + mean * cos(course) * FRAME_DT
        y = float(self.pose[1]) + mean * sin(course) * FRAME_DT
        self.heading += rate * FRAME_DT
        self.velocity = mean * cos(course), mean * sin(course)
        level = self._level()
        level += GROUND_SHARE * (self._road(ground, x, y, level) - level)
        self.level = level
        self.pose = tilted_poses(*(np.array([value]) for value in (x, y, level[0], self.heading, *level[1:])))[0]

    def _level(self) -> np.ndarray:
        """Return height and slopes that a steered body has now."""
        if self.level is None:
            self.level = FreeBody.take_over(self.shape, self.pose, self.pose).level
        assert self.level is not None
        return self.level.copy()

    def _road(self, ground: Ground, x: float, y: float, level: np.ndarray) -> np.ndarray:
        """Return height and slopes of the road under the wheels; those of the body where a wheel has no road."""
        c, s = cos(self.heading), sin(self.heading)
        places = wheel_places(self.shape)
        points = [(x + a * c - b * s, y + a * s + b * c, level[0] + a * level[1] + b * level[2]) for a, b in places]
        height = ground.heights(np.array(points))
        if np.isnan(height).any():
            return level
        front_left, front_right, rear_left, rear_right = height
        forward = (front_left + front_right - rear_left - rear_right) / (2 * self.shape.wheelbase)
        left = (front_left + rear_left - front_right - rear_right) / (2 * self.shape.track)
        return np.array([height.mean(), forward, left])

    def seen(self, time_s: float) -> Body:
        """Return the body as vehicles see it, a time ahead [s], as if it kept its velocity."""
        ahead = 0.5 * (self.shape.front - self.shape.rear)
        x, y, z = (float(value) for value in self.pose[:3])
        x, y = x + self.velocity[0] * time_s, y + self.velocity[1] * time_s
        middle = (x + ahead * cos(self.heading), y + ahead * sin(self.heading), z)
        return Body(middle, self.heading, self.velocity, (0.5 * self.shape.length, self.shape.half_width))
