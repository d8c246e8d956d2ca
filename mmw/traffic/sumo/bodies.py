"""Make bodies on the road from the points at which SUMO sees vehicles, step by step.

SUMO moves front bumpers along the middles of lanes, with kinks where a change of lanes begins and ends, and with jumps
of the acceleration. A body is pulled by its front bumper: the front axle follows it, the rear axle follows the front
axle, neither slips sideways, and four wheels stand on the road. Then place, heading, height and slopes are smoothed
over time with the weights of a uniform cubic B-spline: changes of lanes begin with a kink, whose jerk is least where
the weights have no step. SUMO is ahead of the bodies by the reach of these weights.

Source: B-splines as repeated moving averages, M. Unser, IEEE Signal Process. Mag. 16 (1999), 22-38.
"""

from collections.abc import Sequence

import numpy as np

from mmw.core.constants import FRAME_RATE_HZ
from mmw.traffic.ground_height import Ground
from mmw.traffic.live.causal import ROWS_PER_STEP
from mmw.traffic.vehicle_pose import Shape, directions, wheel_plane

KNOTS_S = 0.2
"""Distance between the knots of the B-spline [s], a whole number of steps; standard deviation 0.12 s, the least of
recorded traffic. A change of lanes begins with 0.9 m/s aside; the middle of a sedan, which its bumper pulls, gets a
jerk of 8.7 m/s^3, within the 9.5 of recorded traffic (`mmw.traffic.replay.poses.MAX_JERK`). Design value."""


def _weights() -> np.ndarray:
    """Return the weights of the rows at 100 Hz around a row, shape [2 * REACH + 1]."""
    box = np.full(round(KNOTS_S * FRAME_RATE_HZ), 1.0)
    weights = box
    for _ in range(3):
        weights = np.convolve(weights, box)
    return weights / weights.sum()


REACH = len(_weights()) // 2
"""Rows before and after a row that it depends on."""


def step_weights() -> np.ndarray:
    """Return the weights of SUMO's steps for a row, by the row's place in its step, shape [ROWS_PER_STEP, N].

    Between steps, motion is linear; the knots are a whole number of steps apart, so that no trace of the steps is left.
    The first of the N steps is that at or before `REACH` rows before the row.
    """
    rows = _weights()
    count = (2 * REACH + 2 * ROWS_PER_STEP - 2) // ROWS_PER_STEP + 1
    out = np.zeros((ROWS_PER_STEP, count))
    for phase in range(ROWS_PER_STEP):
        first = (phase - REACH) // ROWS_PER_STEP
        for row, weight in enumerate(rows, phase - REACH):
            step, share = divmod(row, ROWS_PER_STEP)
            out[phase, step - first] += weight * (1.0 - share / ROWS_PER_STEP)
            if share:
                out[phase, step - first + 1] += weight * share / ROWS_PER_STEP
    return out


class PulledBodies:
    """Bodies whose front bumpers are moved."""

    def __init__(self, shapes: Sequence[Shape], ground: Ground) -> None:
        """Take the bodies; the first `pull` places them."""
        self._ground = ground
        self._front = np.array([shape.front for shape in shapes])
        self._wheelbase = np.array([shape.wheelbase for shape in shapes])
        self._track = np.array([shape.track for shape in shapes])
        self._bumper = np.zeros((len(shapes), 2))
        self._course, self._heading = np.zeros(len(shapes)), np.zeros(len(shapes))
        self._axle = np.zeros((len(shapes), 2))
        self._columns = np.zeros((len(shapes), 6))

    def place(self, bumper: np.ndarray, height: np.ndarray, heading: np.ndarray) -> np.ndarray:
        """Put front bumpers at places [m], shape [V, 2], at heights [m] and headings [rad]; return as `pull`."""
        self._bumper, self._course, self._heading = bumper.copy(), heading.copy(), heading.copy()
        self._axle = bumper - self._front[:, None] * directions(heading)
        self._columns = np.column_stack([np.zeros((len(bumper), 3)), height, np.zeros((len(bumper), 2))])
        return self._stand(np.ones(len(bumper), dtype=bool))

    def pull(self, bumper: np.ndarray) -> np.ndarray:
        """Move front bumpers to places [m], shape [V, 2].

        Returns:
            Middle x, y, heading, height [m, m, rad, m], slopes forward and to the left, shape [V, 6]; those of a body
            that does not move are the same, bit for bit.
        """
        moved = (bumper != self._bumper).any(axis=1)
        self._course = _follow(self._course, bumper - self._bumper, self._front)
        axle = np.where(moved[:, None], bumper - self._front[:, None] * directions(self._course), self._axle)
        self._heading = _follow(self._heading, axle - self._axle, self._wheelbase)
        self._bumper, self._axle = bumper.copy(), axle
        return self._stand(moved)

    def _stand(self, moved: np.ndarray) -> np.ndarray:
        """Put the wheels of the bodies that moved on the road; one without a road keeps height and slopes."""
        half, side = 0.5 * self._wheelbase, 0.5 * self._track
        forward = directions(self._heading)
        center = self._axle - half[:, None] * forward
        left = np.stack([-forward[:, 1], forward[:, 0]], axis=1)
        level = self._columns[:, 3:]
        wheels = []
        for x, y in ((half, side), (half, -side), (-half, side), (-half, -side)):
            place = center + x[:, None] * forward + y[:, None] * left
            wheels.append(np.column_stack([place, level[:, 0] + x * level[:, 1] + y * level[:, 2]]))
        height = np.full((4, len(moved)), np.nan)
        some = np.stack(wheels)[:, moved]
        height[:, moved] = self._ground.heights(some.reshape(-1, 3)).reshape(4, -1)
        plane = wheel_plane(height, self._wheelbase, self._track)
        level = np.where(np.isnan(plane).any(axis=1, keepdims=True), level, plane)
        columns = np.column_stack([center, self._heading, level])
        self._columns = np.where(moved[:, None], columns, self._columns)
        return self._columns


def _follow(angle: np.ndarray, step: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Return the directions of links whose heads were moved by straight steps [m], shape [V, 2].

    Source: the exact tractrix, tan(d/2) = tan(d0/2) exp(-s/b) for the angle d between path and link; the solution of
    heading' = sin(path - heading) / b, Rajamani, Vehicle Dynamics and Control, 2nd ed., section 2.2.
    """
    way = np.hypot(step[:, 0], step[:, 1])
    off = np.arctan2(step[:, 1], step[:, 0]) - angle
    off = np.where(way > 0.0, np.arctan2(np.sin(off), np.cos(off)), 0.0)
    return angle + off - 2.0 * np.arctan(np.tan(0.5 * off) * np.exp(-way / length))
