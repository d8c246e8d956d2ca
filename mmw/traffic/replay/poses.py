"""Turn samples of a recorded vehicle into 6-DoF poses of a body on the road, as smooth as generated traffic."""

from dataclasses import replace

import numpy as np

from mmw.core.constants import FRAME_DT, FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.traffic.polyline import arc_length
from mmw.traffic.replay.path_fit import BacktrackError, FittedPath, fill_stations, fit_path
from mmw.traffic.replay.road_level import Decks
from mmw.traffic.replay.trajectory_table import Trajectory
from mmw.traffic.roads.lane_graph import Lane
from mmw.traffic.route import PATH_STEP, Line, join_lanes
from mmw.traffic.smoothing import gaussian_smooth
from mmw.traffic.vehicle_pose import GROUND_REACH, Shape, Track, directions, follow_line, place_on_ground, sample_poses

LONGEST_GAP = 2.0
"""Without samples for longer than this, a vehicle is not there [s]; shorter gaps are filled."""

FASTEST = 70.0
"""A vehicle does not go faster than this [m/s]."""

NOISE = 0.5
"""Noise of samples that is not speed [m]."""

SUPPORT_S = 5.0
"""Samples are read this far before the first and after the last frame [s]."""

TIME_SIGMAS = (0.12, 0.18, 0.27, 0.4, 0.6)
"""Gaussian on the distance over time, standard deviation; the first that is smooth enough is used [s]."""

PATH_SIGMAS = (0.0, 1.0, 2.0, 3.0)
"""The same for the line, in addition to the pose stage's own meter [m]."""

STATION_JERK = 6.0
"""Largest third derivative of the distance over time that the choice aims at [m/s^3]."""

MAX_JERK = 9.5
"""Largest horizontal jerk of the body's origin on one axis [m/s^3]; a little below 10, which others may measure."""

BEHIND = 12.0
"""Straight run before the first sample, where the rear of the vehicle is [m]."""

MIN_LEAD = 0.5
"""The heading of a vehicle whose rear axle is given follows the line within this distance [m]."""

AHEAD = 3.0
"""Straight run after the last sample [m]."""

ROAD_MARGIN = 0.6
"""The road is needed this far before and after the path of the front axle [m]."""

OPPOSITE = 0.5
"""Mean cosine between heading and motion below which a table's heading cannot be right [-]."""


def replay(trajectory: Trajectory, shape: Shape, decks: Decks, frame_count: int, comfort: float = np.inf) -> np.ndarray:
    """Return where the body of a recorded vehicle is.

    Args:
        trajectory: Its samples; time 0 is frame 0.
        shape: Its model.
        decks: The drivable surface.
        frame_count: F, frames at 100 Hz.
        comfort: Horizontal acceleration that the line is made rounder for, as far as `PATH_SIGMAS` goes [m/s^2].

    Returns:
        Poses (x, y, z, qx, qy, qz, qw) of the ground point midway between the axles [m], shape [F, 7], float64; NaN
        where the vehicle is not there: before its first and after its last sample, and in gaps of more than 2 s.

    Raises:
        InputError: If the vehicle jumps, goes back on itself, leaves the road, stands without a heading, or cannot be
            made smooth. The message starts with the vehicle, time and place.
    """
    time = trajectory.time
    near = np.flatnonzero((time >= -SUPPORT_S) & (time <= (frame_count - 1) * FRAME_DT + SUPPORT_S))
    poses = np.full((frame_count, 7), np.nan)
    if len(near) < 2:
        return poses
    _check_speed(trajectory, near)
    for rows in np.split(near, np.flatnonzero(np.diff(time[near]) > LONGEST_GAP) + 1):
        first = max(0, int(np.ceil(time[rows[0]] * FRAME_RATE_HZ - 1e-6)))
        last = min(frame_count - 1, int(np.floor(time[rows[-1]] * FRAME_RATE_HZ + 1e-6)))
        if len(rows) > 1 and first <= last:
            part = _part(trajectory, rows)
            poses[first : last + 1] = _replay_part(part, shape, decks, first, last, comfort)
    return poses


def _part(trajectory: Trajectory, rows: np.ndarray) -> Trajectory:
    """Return some of a vehicle's samples."""
    columns = {name: getattr(trajectory, name) for name in ("time", "points", "height", "heading")}
    return replace(trajectory, **{name: None if all_ is None else all_[rows] for name, all_ in columns.items()})


def _check_speed(trajectory: Trajectory, rows: np.ndarray) -> None:
    time, points = trajectory.time[rows], trajectory.points[rows]
    step, gap = np.linalg.norm(np.diff(points, axis=0), axis=1), np.diff(time)
    jumps = np.flatnonzero((step > FASTEST * gap + NOISE) & (gap <= LONGEST_GAP))
    if len(jumps):
        at = jumps[0]
        raise InputError(
            f"{_where(trajectory, time[at], points[at])}: jumps {step[at]:.1f} m in {gap[at]:.3f} s, "
            f"{step[at] / gap[at]:.0f} m/s; at most {FASTEST:.0f} m/s is a vehicle; check units and ids, or leave "
            "out the samples between"
        )


def _where(trajectory: Trajectory, time: float, place: np.ndarray) -> str:
    return f"vehicle {trajectory.id!r} at t = {time:.2f} s near ({place[0]:.1f}, {place[1]:.1f}) m"


def _replay_part(part: Trajectory, shape: Shape, decks: Decks, first: int, last: int, comfort: float) -> np.ndarray:
    """Return the poses of frames `first` to `last`, through which the vehicle is there."""
    try:
        path = fit_path(part.points, part.heading)
    except BacktrackError as error:
        raise InputError(
            f"{_where(part, part.time[error.sample], part.points[error.sample])}: turns back on itself; vehicles "
            "drive forward; leave out samples that reverse or that are noise"
        ) from None
    except InputError as error:
        raise InputError(
            f"{_where(part, part.time[0], part.points[0])}: {error}; give a column heading or heading_deg"
        ) from None
    _check_heading(part, path)
    pad = int(np.ceil(5 * TIME_SIGMAS[-1] * FRAME_RATE_HZ))
    fine = fill_stations(part.time, path.station, np.arange(first - pad, last + pad + 1) * FRAME_DT)
    calm = [sigma for sigma in TIME_SIGMAS if _jerk(_smooth(fine, sigma, pad)) <= STATION_JERK] or TIME_SIGMAS[-1:]
    least, where, rough = np.inf, 0, None
    for sigma in calm:
        for path_sigma in PATH_SIGMAS:
            line, distance = _smooth_path(path, fine, path_sigma)
            poses = _stand(part, line, shape, decks, _smooth(distance, sigma, pad), first)
            jerk = np.abs(np.diff(poses[:, :2], n=3, axis=0)).max(axis=1, initial=0.0) / FRAME_DT**3
            if jerk.max(initial=0.0) <= MAX_JERK:
                acceleration = np.linalg.norm(np.diff(poses[:, :2], n=2, axis=0), axis=1) / FRAME_DT**2
                if acceleration.max(initial=0.0) <= comfort:
                    return poses
                rough = poses if rough is None else rough
            if jerk.max() < least:
                least, where = jerk.max(), int(np.argmax(jerk))
        if rough is not None:
            return rough
    raise InputError(
        f"{_where(part, (first + where) * FRAME_DT, poses[where])}: the samples cannot be made smooth; a jerk of "
        f"{least:.1f} m/s^3 is left, {MAX_JERK} is allowed; smooth them, or leave out this vehicle"
    )


def _smooth(distance: np.ndarray, sigma: float, pad: int) -> np.ndarray:
    """Return a distance over time after a Gaussian [s], without the frames that were added at both ends."""
    return gaussian_smooth(distance, sigma * FRAME_RATE_HZ)[pad : len(distance) - pad]


def _smooth_path(path: FittedPath, distance: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a line after a Gaussian [m], and distances along it: rounder bends are shorter."""
    if sigma == 0.0:
        return path.points, distance
    points = gaussian_smooth(path.points, sigma / PATH_STEP)
    before, after = arc_length(path.points), arc_length(points)
    beyond = np.minimum(distance, 0.0) + np.maximum(distance - before[-1], 0.0)
    return points, np.interp(distance, before, after) + beyond


def _jerk(distance: np.ndarray) -> float:
    return float(np.abs(np.diff(distance, n=3)).max(initial=0.0)) / FRAME_DT**3


def _check_heading(part: Trajectory, path: FittedPath) -> None:
    """Compare a table's heading with the motion: degrees for radians, or another sense of turning, shows there."""
    if part.heading is None or path.station[-1] < 2.0:
        return
    row = np.minimum(np.searchsorted(arc_length(path.points), path.station), len(path.points) - 2)
    move = path.points[row + 1] - path.points[row]
    moves = np.flatnonzero(np.diff(path.station, prepend=-1.0) > 0)
    agree = np.cos(np.arctan2(move[moves, 1], move[moves, 0]) - part.heading[moves])
    if agree.mean() < OPPOSITE:
        raise InputError(
            f"{_where(part, part.time[0], part.points[0])}: its heading is {np.degrees(part.heading[0]):.0f} deg where "
            f"it moves towards {np.degrees(np.arctan2(move[0, 1], move[0, 0])):.0f} deg; headings count "
            "counter-clockwise from east, in rad (heading) or degrees (heading_deg), and vehicles drive forward"
        )


def _stand(
    part: Trajectory, points: np.ndarray, shape: Shape, decks: Decks, distance: np.ndarray, first: int
) -> np.ndarray:
    """Return the poses from frame `first` on, for the line of the reference point and its distance along it [m]."""
    distance, points = distance + BEHIND, _lengthen(points, part)
    if part.reference == "front_bumper":
        distance = distance - shape.front
    along = arc_length(points)
    ends = [distance[0] - ROAD_MARGIN, distance[0], distance.max() + ROAD_MARGIN]
    low, start, high = np.searchsorted(along, ends).tolist()
    high = min(high, len(points) - 1)
    hint = np.nan if part.height is None else float(np.interp(first * FRAME_DT, part.time, part.height))
    height, lost = decks.follow(points, start, high, hint)
    what = "there is no drivable surface below" + ("" if np.isnan(hint) else f", or none near its height {hint:.1f} m")
    if lost < 0:
        line = join_lanes([Lane(part.id, np.column_stack([points, height])[: high + 1], 0.0, 0.0)])
        track = _follow(line, part.reference, shape)
        stance, at, what = place_on_ground(track, decks.ground, float(along[low]) + GROUND_REACH)
        if stance is not None:
            return sample_poses(stance, distance)
        lost = min(int(np.searchsorted(along, at)), len(along) - 1)
    time = (first + min(int(np.searchsorted(distance, along[lost])), len(distance) - 1)) * FRAME_DT
    raise InputError(
        f"{_where(part, time, points[lost])}: {what} (model {shape.name!r}); vehicles stay on meshes of class road or "
        "road_line; check the origin and axes of the table, or leave out this vehicle"
    )


def _lengthen(points: np.ndarray, part: Trajectory) -> np.ndarray:
    """Return a line with a straight run at both ends; at the start it comes from where the vehicle's rear is."""
    begin, end = points[1] - points[0], points[-1] - points[-2]
    if part.heading is not None:
        begin = np.array([np.cos(part.heading[0]), np.sin(part.heading[0])])
    begin, end = begin / np.linalg.norm(begin), end / np.linalg.norm(end)
    back = np.arange(round(BEHIND / PATH_STEP), 0, -1)[:, None] * PATH_STEP
    ahead = np.arange(1, round(AHEAD / PATH_STEP) + 1)[:, None] * PATH_STEP
    return np.concatenate([points[0] - back * begin, points, points[-1] + ahead * end])


def _follow(line: Line, reference: str, shape: Shape) -> Track:
    """Return how a body moves of which a given point follows a line.

    A point that leads the rear axle by b turns the body as a front axle with wheelbase b does. The front axle follows
    the line of a front bumper, as it does that of a lane in generated traffic.
    """
    if reference in ("front_bumper", "front_axle"):
        return follow_line(line, shape)
    lead = 0.5 * shape.length - shape.rear if reference == "center" else 0.0
    track = follow_line(line, replace(shape, wheelbase=max(lead, MIN_LEAD)))
    heading = track.heading
    if reference == "rear_axle":  # it lags by the lead that was added
        heading = np.interp(line.station + MIN_LEAD, line.station, heading)
    forward = directions(heading)
    front = track.front + (shape.wheelbase - lead) * forward
    center = front - 0.5 * shape.wheelbase * forward
    return replace(track, shape=shape, front=front, heading=heading, center=center)
