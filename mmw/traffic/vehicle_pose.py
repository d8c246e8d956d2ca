"""Place a body on its four wheels along a line on the road: heading, height and tilt, and poses over time.

A pose is a function of the station alone, so a vehicle at rest is exactly at rest. Time enters through the station and
through the small lean of the tyres under acceleration.
"""

from dataclasses import dataclass
from math import sin

import numpy as np

from mmw.core.constants import FRAME_DT, GRAVITY
from mmw.traffic.ground_height import Ground
from mmw.traffic.route import EXTENSION, PATH_STEP, Line
from mmw.traffic.smoothing import gaussian_smooth, spline_at

PATH_SIGMA = 1.0
"""Gaussian on the path, standard deviation [m]: continuous curvature, at most some centimeters aside in tight bends."""

GROUND_SIGMA = 0.7
"""Gaussian on height and tilt along the path [m]: the suspension's low pass, fixed to the road instead of to time. The
remainder is smoothed and added once more, so that crests and sags of constant curvature are followed without bias.
Source: twicing, Tukey, Exploratory Data Analysis, 1977, chapter 16."""

TILT_SIGMA = 0.3
"""The same for the slopes along and across [m]; they do not move the body's origin, so less smoothing will do."""

GROUND_REACH = 3.5
"""The road is looked at from this far behind the starting place, as support of the low pass [m]."""

GROUND_SUPPORT = 75
"""Samples before a place that its height depends on, twice the reach of the low pass and some more."""

MAX_FLOAT = 0.0195
"""A tyre may be this far above or inside the ground [m], lean under `LEAN_ACCELERATION` included."""

LEAN_ACCELERATION = 2.5
"""Acceleration along and aside that the margin for leaning is made for [m/s^2]."""

LEAN_SIGMA = 0.15
"""Gaussian on the accelerations that tilt the body [s]; about the period of a 1.6 Hz suspension over 4."""

TYRE_DEFLECTION = 0.015
"""Static deflection of a loaded tyre [m]. Source: order of magnitude for passenger cars, Wong, Theory of Ground
Vehicles, 4th ed., section 1.6 (about 250 kN/m under about 4 kN)."""

MASS_HEIGHT = 0.38
"""Height of the center of mass as a share of the vehicle's height. Source: passenger cars 0.35-0.41, Heydinger et al.,
Measured Vehicle Inertial Parameters, SAE 1999-01-1336."""

REWORK = 60
"""Samples before the branch of two lines that are computed anew: the Gaussian of `PATH_SIGMA` reaches 50 samples, and
the spline between samples a few more."""

MAX_STEER = 0.7
"""Largest angle between the front wheels' direction and the body [rad]; sharper turns need shorter vehicles."""


@dataclass(frozen=True)
class Shape:
    """Dimensions of a vehicle model that traffic needs."""

    name: str
    wheelbase: float
    """Distance between the axles [m]."""
    track: float
    """Distance between left and right wheels [m]."""
    height: float
    """Height of the body [m]."""
    half_width: float
    """Half the body's width [m]."""
    front: float
    """From the front axle to the front bumper [m]."""
    rear: float
    """From the rear axle to the rear bumper [m]."""

    @property
    def behind(self) -> float:
        """From the front axle back to the rear bumper [m]."""
        return self.wheelbase + self.rear

    @property
    def length(self) -> float:
        """Bumper to bumper [m]."""
        return self.front + self.wheelbase + self.rear


def make_shape(model) -> Shape:
    """Return the traffic view of a vehicle model (`name, wheelbase, track, length, width, height, center`)."""
    half = 0.5 * model.length
    return Shape(
        name=model.name,
        wheelbase=float(model.wheelbase),
        track=float(model.track),
        height=float(model.height),
        half_width=0.5 * float(model.width) + abs(float(model.center[1])),
        front=float(model.center[0]) + half - 0.5 * model.wheelbase,
        rear=half - float(model.center[0]) - 0.5 * model.wheelbase,
    )


@dataclass(frozen=True)
class Track:
    """The path of one body along one line; every array has one row a sample of the line."""

    line: Line
    shape: Shape
    front: np.ndarray
    """Front axle's middle, smoothed path, seen from above [m], shape [N, 2]."""
    heading: np.ndarray
    """Heading of the body [rad], continuous, shape [N]."""
    center: np.ndarray
    """Middle between the axles, seen from above [m], shape [N, 2]."""
    steer: np.ndarray
    """Angle between the front axle's direction and the body [rad], shape [N]."""


def follow_line(line: Line, shape: Shape, before: Track | None = None, row: int = 0) -> Track:
    """Return how a body moves whose front axle follows a line and whose rear axle does not slip sideways.

    Args:
        line: The line.
        shape: The body.
        before: The body's path along another line that is the same up to sample `row`, if there is one; its samples
            up to `REWORK` before that row are copied bit by bit.
        row: Last sample that both lines share.

    Source: kinematic bicycle, heading' = sin(path - heading) / wheelbase (Rajamani, Vehicle Dynamics and Control, 2nd
    ed., section 2.2), integrated over the station with the midpoint rule.
    """
    shared = 0 if before is None else max(0, row - REWORK)
    support = max(0, shared - REWORK)
    front = gaussian_smooth(line.points[support:, :2], PATH_SIGMA / PATH_STEP)
    tangent = np.gradient(front, PATH_STEP, axis=0)[shared - support :]
    front = front[shared - support :]
    direction = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    gain = np.linalg.norm(tangent, axis=1) * PATH_STEP / shape.wheelbase
    theta = float(direction[0])
    if before is not None:
        theta = float(before.heading[shared])
        direction += 2 * np.pi * round((theta + float(before.steer[shared]) - float(direction[0])) / (2 * np.pi))
    middle = (0.5 * (direction[1:] + direction[:-1])).tolist()
    step = (0.5 * (gain[1:] + gain[:-1])).tolist()
    heading = [theta]
    for path, angle, share in zip(direction.tolist(), middle, step, strict=False):
        half = theta + 0.5 * share * sin(path - theta)
        theta += share * sin(angle - half)
        heading.append(theta)
    heading = np.array(heading)
    center = front - 0.5 * shape.wheelbase * directions(heading)
    columns = [front, heading, center, direction - heading]
    if before is not None:
        kept = (before.front, before.heading, before.center, before.steer)
        columns = [np.concatenate([old[:shared], new]) for old, new in zip(kept, columns, strict=True)]
    return Track(line, shape, *columns)


def directions(heading: np.ndarray) -> np.ndarray:
    """Return unit vectors of headings [rad], shape [N, 2]."""
    return np.stack([np.cos(heading), np.sin(heading)], axis=1)


@dataclass(frozen=True)
class Stance:
    """Body poses at every sample of a line, from which poses are interpolated."""

    track: Track
    columns: np.ndarray
    """Middle x, y, heading, height [m, m, rad, m] and slopes forward and to the left, shape [N, 6]."""


def place_on_ground(
    track: Track, ground: Ground, start: float, before: Stance | None = None, row: int = 0
) -> tuple[Stance | None, float, str]:
    """Drop the four wheels on the road along a track and lay the body through them.

    Args:
        track: The body's path seen from above.
        ground: The drivable surface.
        start: Station of the front axle where the vehicle starts [m]; the road is also needed a little before.
        before: The stance on a line that is the same up to sample `row`, if there is one, as in `follow_line`.
        row: Last sample that both lines share.

    Returns:
        The stance, NaN and nothing; or None, the first station at which the body cannot stand [m], and why.
    """
    line, shape = track.line, track.shape
    last = line.ends[-1] - PATH_STEP
    shared = 0 if before is None else max(0, row - REWORK)
    rows = np.flatnonzero((line.station >= start - GROUND_REACH) & (line.station <= last))
    rows = rows[rows >= shared - GROUND_SUPPORT]
    forward = directions(track.heading)[rows]
    left = np.stack([-forward[:, 1], forward[:, 0]], axis=1)
    behind = np.interp(line.station[rows] - shape.wheelbase, line.station, line.points[:, 2])
    drops = []
    for x, y in wheel_places(shape):
        wheel = track.center[rows] + x * forward + y * left
        drops.append(np.column_stack([wheel, line.points[rows, 2] if x > 0 else behind]))
    height = ground.heights(np.concatenate(drops)).reshape(4, -1)
    lost = np.flatnonzero(np.isnan(height).any(axis=0))
    if len(lost):
        return None, float(line.station[rows[lost[0]]]), "a wheel leaves the drivable surface"
    plane = wheel_plane(height, shape.wheelbase, shape.track)
    smooth = np.column_stack([_follow(plane[:, :1], GROUND_SIGMA), _follow(plane[:, 1:], TILT_SIGMA)])
    tyre = smooth @ np.array([(1.0, x, y) for x, y in wheel_places(shape)]).T
    lift_x, lift_y = lean_per_acceleration(shape)
    leaning = LEAN_ACCELERATION * (0.5 * shape.wheelbase * lift_x + 0.5 * shape.track * lift_y)
    floating = (np.abs(tyre - height.T) > MAX_FLOAT - leaning).any(axis=1) & (line.station[rows] >= start)
    if floating.any():
        where = float(line.station[rows[np.argmax(floating)]])
        return None, where, "the road is too uneven under the four wheels"
    whole = np.pad(smooth, ((rows[0], len(line.station) - 1 - rows[-1]), (0, 0)), mode="edge")
    columns = np.column_stack([track.center, track.heading, whole])
    if before is not None:
        columns[:shared] = before.columns[:shared]
    return Stance(track, columns), np.nan, ""


def _follow(columns: np.ndarray, sigma: float) -> np.ndarray:
    """Return columns along a path after the low pass of standard deviation sigma [m]."""
    smooth = gaussian_smooth(columns, sigma / PATH_STEP)
    return smooth + gaussian_smooth(columns - smooth, sigma / PATH_STEP)


def wheel_places(shape: Shape) -> list[tuple[float, float]]:
    """Return x and y of the wheels in the body frame [m]: front left, front right, rear left, rear right."""
    x, y = 0.5 * shape.wheelbase, 0.5 * shape.track
    return [(x, y), (x, -y), (-x, y), (-x, -y)]


def wheel_plane(height: np.ndarray, wheelbase: float | np.ndarray, track: float | np.ndarray) -> np.ndarray:
    """Return height [m], slope along and slope across of the plane nearest to four wheels, shape [N, 3].

    Args:
        height: Height of the ground under each, in the order of `wheel_places` [m], shape [4, N].
        wheelbase: Distance between the axles [m], one or shape [N].
        track: Distance between the wheels of an axle [m], one or shape [N].
    """
    front_left, front_right, rear_left, rear_right = height
    along = (front_left + front_right - rear_left - rear_right) / (2 * wheelbase)
    across = (front_left + rear_left - front_right - rear_right) / (2 * track)
    return np.stack([height.mean(axis=0), along, across], axis=1)


def sample_poses(stance: Stance, station: np.ndarray) -> np.ndarray:
    """Return body-to-world poses at 100 Hz.

    Args:
        stance: The body along its line.
        station: Front axle's station at every frame [m], shape [F], F >= 3, already smooth in time.

    Returns:
        Poses (x, y, z, qx, qy, qz, qw) of the ground point midway between the axles [m], shape [F, 7], float64. The
        quaternion never changes sign between frames.
    """
    shape = stance.track.shape
    x, y, heading, height, slope_x, slope_y = spline_at(stance.columns, (station + EXTENSION) / PATH_STEP).T
    velocity = np.gradient(np.stack([x, y], axis=1), FRAME_DT, axis=0)
    acceleration = gaussian_smooth(np.gradient(velocity, FRAME_DT, axis=0), LEAN_SIGMA / FRAME_DT)
    along = acceleration[:, 0] * np.cos(heading) + acceleration[:, 1] * np.sin(heading)
    aside = acceleration[:, 1] * np.cos(heading) - acceleration[:, 0] * np.sin(heading)
    lift_x, lift_y = lean_per_acceleration(shape)
    slope_x, slope_y = slope_x + lift_x * along, slope_y + lift_y * aside
    return tilted_poses(x, y, height, heading, slope_x, slope_y)


def tilted_poses(
    x: np.ndarray, y: np.ndarray, height: np.ndarray, heading: np.ndarray, slope_x: np.ndarray, slope_y: np.ndarray
) -> np.ndarray:
    """Return body-to-world poses of bodies at places [m] with headings [rad] and slopes forward and to the left.

    Returns:
        Poses (x, y, z, qx, qy, qz, qw), shape [F, 7], float64.
    """
    pitch = np.arctan(slope_x)
    roll = np.arctan(slope_y * np.cos(pitch))
    return np.column_stack([x, y, height, _quaternion(heading, -pitch, roll)])


def lean_per_acceleration(shape: Shape) -> tuple[float, float]:
    """Return how much the slopes along and aside grow per acceleration along and aside [s^2/m].

    Source: static load transfer over the tyres' stiffness, Gillespie, Fundamentals of Vehicle Dynamics, chapter 1:
    an axle's load changes by m a h / L, hence its tyres' deflection by TYRE_DEFLECTION * (a / g) * 2 h / L.
    """
    lift = 2 * TYRE_DEFLECTION * MASS_HEIGHT * shape.height / GRAVITY
    return 2 * lift / shape.wheelbase**2, 2 * lift / shape.track**2


def _quaternion(yaw: np.ndarray, pitch: np.ndarray, roll: np.ndarray) -> np.ndarray:
    """Return rotations roll about x, then pitch about y, then yaw about z, as (qx, qy, qz, qw), shape [F, 4]."""
    cy, sy = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    cp, sp = np.cos(0.5 * pitch), np.sin(0.5 * pitch)
    cr, sr = np.cos(0.5 * roll), np.sin(0.5 * roll)
    x, y = sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy
    z, w = cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy
    return np.stack([x, y, z, w], axis=1)
