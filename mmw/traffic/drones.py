"""Fly the drones of a scenario through their waypoints.

A drone flies the path of least snap (`mmw.core.minimum_snap`). It tilts so that its thrust, along its own z, gives the
acceleration of the path; drag is left out, so that it is level at a steady speed.

Source: D. Mellinger, V. Kumar, Minimum snap trajectory generation and control for quadrotors, ICRA 2011: z_B along
a + g e_z; M. Faessler, A. Franchi, D. Scaramuzza, Differential flatness of quadrotor dynamics subject to rotor drag,
RA-L 3 (2018): x_B along y_C x z_B, so that the yaw of the body is the heading.
"""

from collections.abc import Sequence

import numpy as np

from mmw.config import UavConfig
from mmw.core.constants import FRAME_RATE_HZ, GRAVITY
from mmw.core.minimum_snap import minimum_snap
from mmw.core.transforms import continuous, quaternion_from_matrix
from mmw.traffic.demand import VehicleTrack
from mmw.usd.vehicle_catalog import load_drones

COURSE_M = 0.1
"""Waypoints nearer to each other in plan than this give no course. Design value."""


def fly_drones(uavs: Sequence[UavConfig], frame_count: int) -> list[VehicleTrack]:
    """Return the tracks of drones, role `uav`.

    Args:
        uavs: The drones.
        frame_count: F, frames at 100 Hz.

    Raises:
        InputError: If the asset of the drone is missing.
    """
    if not uavs:
        return []
    (model,) = load_drones().values()
    times = np.arange(frame_count) / FRAME_RATE_HZ
    return [VehicleTrack(uav.name, "uav", model.name, model.paints[0], drone_poses(uav, times)) for uav in uavs]


def drone_poses(uav: UavConfig, times: np.ndarray) -> np.ndarray:
    """Return the poses of a drone's body at times [s] of shape [T], shape [T, 7]."""
    if uav.position_m is not None:
        position, acceleration = np.tile(uav.position_m, (len(times), 1)), np.zeros((len(times), 3))
        heading = np.full(len(times), np.radians(uav.yaw_deg))
    else:
        position, _, acceleration = minimum_snap(uav.times_s, uav.points_m, times)
        heading = _headings(uav, times)
    return np.concatenate([position, _attitude(acceleration, heading)], axis=1)


def _attitude(acceleration: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Return the quaternions of a body that thrusts along its z and has a heading, shape [T, 4]."""
    thrust = acceleration + np.array([0.0, 0.0, GRAVITY])
    z = thrust / np.linalg.norm(thrust, axis=1, keepdims=True)
    left = np.stack([-np.sin(heading), np.cos(heading), np.zeros_like(heading)], axis=1)
    x = np.cross(left, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return continuous(quaternion_from_matrix(np.stack([x, np.cross(z, x), z], axis=-1)))


def _headings(uav: UavConfig, times: np.ndarray) -> np.ndarray:
    """Return the heading at times [rad], shape [T]: of each waypoint, and smooth between them, the shorter way round.

    A waypoint without a heading has that of the straight line to the next one, the last that of the line to it.
    """
    points, knots = uav.points_m, uav.times_s
    moves = np.diff(points[:, :2], axis=0)
    given = [None if point.yaw_deg is None else float(np.radians(point.yaw_deg)) for point in uav.waypoints]
    lines = [float(np.arctan2(y, x)) if np.hypot(x, y) > COURSE_M else None for x, y in moves]
    lines = [*lines, lines[-1]]
    last = next((yaw for yaw in (one if one is not None else line for one, line in zip(given, lines, strict=True))
                 if yaw is not None), 0.0)  # fmt: skip
    headings = []
    for yaw, line in zip(given, lines, strict=True):
        last = yaw if yaw is not None else line if line is not None else last
        headings.append(last)
    turns = np.unwrap(headings)
    leg = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(knots) - 2)
    share = np.clip((times - knots[leg]) / np.diff(knots)[leg], 0.0, 1.0)
    smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)  # velocity and acceleration are zero at both ends
    return turns[leg] + smooth * (turns[leg + 1] - turns[leg])
