"""Move people along lines, at a pace of their own, all in one direction; faster ones slow down behind slower ones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmw.core.constants import FRAME_RATE_HZ
from mmw.traffic.polyline import arc_length, sample_polyline
from mmw.traffic.route import PATH_STEP
from mmw.traffic.smoothing import gaussian_smooth

RELAXATION = 0.5
"""Time in which a person reaches the desired speed [s]. Source: Helbing and Molnar, Phys. Rev. E 51 (1995), 4282."""


MOTION_SIGMA = 0.1
"""Gaussian on the motion of people who carry an IMU, standard deviation [s]: lines are polygons, whose corners would be
jumps of the velocity. Design value."""


@dataclass(frozen=True)
class FollowedLine:
    """A line, smoothed and equally spaced."""

    points: np.ndarray
    """Shape [N, 3] [m]."""
    heading: np.ndarray
    """Direction of motion [rad], continuous, shape [N]."""
    length: float
    is_closed: bool

    def at(self, station: np.ndarray) -> np.ndarray:
        """Return poses at stations [m], shape [F, 7]."""
        x, y, z = (self.sample(self.points[:, axis], station) for axis in range(3))
        heading = self.sample(self.heading, station)
        level = np.zeros_like(x)
        return np.stack([x, y, z, level, level, np.sin(0.5 * heading), np.cos(0.5 * heading)], axis=1)

    def smooth_at(self, station: np.ndarray) -> np.ndarray:
        """Return poses at the stations [m] of all frames at 100 Hz, smooth in time by `MOTION_SIGMA`, shape [F, 7]."""
        poses, sigma = self.at(station), MOTION_SIGMA * FRAME_RATE_HZ
        heading = np.unwrap(2.0 * np.arctan2(poses[:, 5], poses[:, 6]))
        place, half = gaussian_smooth(poses[:, :3], sigma), 0.5 * gaussian_smooth(heading, sigma)
        return np.column_stack([place, poses[:, 3:5], np.sin(half), np.cos(half)])

    def sample(self, values: np.ndarray, station: np.ndarray) -> np.ndarray:
        """Return values of the points, shape [N], at stations [m]."""
        station = station % self.length if self.is_closed else station
        return np.interp(station, PATH_STEP * np.arange(len(self.points)), values)


def smooth_line(points: np.ndarray, is_closed: bool, sigma_m: float) -> FollowedLine:
    """Return a line with rounded corners, sampled every `PATH_STEP`.

    Args:
        points: Shape [N, 3] [m]; a closed line does not repeat its first point.
        is_closed: Whether the last point is joined to the first.
        sigma_m: Standard deviation of the Gaussian that rounds corners [m].
    """
    points = np.concatenate([points, points[:1]]) if is_closed else points
    along = arc_length(points[:, :2])
    count = max(2, int(np.floor(along[-1] / PATH_STEP)))
    station = along[-1] * np.arange(count) / count if is_closed else PATH_STEP * np.arange(count + 1)
    fine = sample_polyline(points, along, station)
    sigma = sigma_m / PATH_STEP
    if is_closed:
        reach = min(count, int(6 * sigma))
        padded = np.concatenate([fine[-reach:], fine, fine[:reach]])
        fine = gaussian_smooth(padded, sigma)[reach : reach + count]
        fine = np.concatenate([fine, fine[:1]])
    else:
        fine = gaussian_smooth(fine, sigma)
    move = np.diff(fine[:, :2], axis=0)
    direction = np.unwrap(np.arctan2(move[:, 1], move[:, 0]))
    return FollowedLine(fine, np.append(direction, direction[-1]), PATH_STEP * (len(fine) - 1), is_closed)


def start_places(lines: Sequence[FollowedLine], reach_m: float, spacing_m: float) -> list[tuple[int, float]]:
    """Return line and station [m] of every start, `spacing_m` apart; on open lines with `reach_m` to go on."""
    places = []
    for line, path in enumerate(lines):
        room = 0.0 if path.is_closed else reach_m + 1.0
        places += [(line, float(station)) for station in np.arange(0.0, path.length - spacing_m - room, spacing_m)]
    return places


def nearest_places(
    lines: Sequence[FollowedLine], places: Sequence[tuple[int, float]], center: Sequence[float], count: int
) -> list[tuple[int, float]]:
    """Return the `count` starts that are nearest to a center [m], nearest first."""
    position = np.array([lines[line].at(np.array([station]))[0, :3] for line, station in places]).reshape(-1, 3)
    distance = np.linalg.norm(position - np.asarray(center, np.float64), axis=1)
    return [places[index] for index in np.lexsort((np.arange(len(places)), distance))[:count]]


def follow_lines(
    chosen: Sequence[tuple[int, float]],
    lines: Sequence[FollowedLine],
    speeds: np.ndarray,
    frame_count: int,
    space_m: float,
    limits: Sequence[np.ndarray] | None = None,
    first_speeds: np.ndarray | None = None,
) -> np.ndarray:
    """Return the station of every person in every frame [m], shape [F, P].

    Source: relaxation to the desired speed, Helbing and Molnar 1995, equation 2, in one dimension; the speed desired
    behind another person falls linearly to zero over one second of distance ahead of the personal space.

    Args:
        chosen: Line and station of each start.
        lines: The lines.
        speeds: Free speed of each person [m/s], shape [P].
        frame_count: F, frames at 100 Hz.
        space_m: Gap between the middles of two people at which the one behind stands still.
        limits: Largest speed at each point of each line [m/s]; none if absent.
        first_speeds: Speed of each person in frame 0 [m/s]; the free one if absent.
    """
    line = np.array([where for where, _ in chosen])
    station = np.array([start for _, start in chosen])
    length = np.array([lines[where].length if lines[where].is_closed else np.inf for where, _ in chosen])
    speed, step = (speeds if first_speeds is None else first_speeds).copy(), 1.0 / FRAME_RATE_HZ
    same = (line[:, None] == line[None, :]) & ~np.eye(len(line), dtype=bool)
    out = np.empty((frame_count, len(line)))
    for frame in range(frame_count):
        out[frame] = station
        ahead = station[None, :] - station[:, None]
        ahead = np.where(np.isfinite(length)[:, None], ahead % length[:, None], np.where(ahead > 0, ahead, np.inf))
        gap = np.where(same, ahead, np.inf).min(axis=1, initial=np.inf)
        desired = np.minimum(speeds, np.maximum(0.0, gap - space_m))
        if limits is not None:
            here = [float(lines[k].sample(limits[k], at)) for k, at in zip(line.tolist(), station, strict=True)]
            desired = np.minimum(desired, here)
        speed = speed + step / RELAXATION * (desired - speed)
        station = station + step * speed
    return out
