"""Round the corners of lines, and join lines by curves: vehicles follow them."""

from itertools import pairwise

import numpy as np
import shapely

from mmw.worlds.towns.plan_geometry import at_stations, row_stations

OFF = 0.5
"""Largest distance of a rounded corner from the corner [m], unless `TURN` asks for more; design value."""
TURN = 7.0
"""Radius of the center line that every bend gets where its sides are long enough [m]: an axle distance of 4 m turns in
4 / sin(0.7) = 6.2 m with the largest angle of `mmw.traffic.vehicle_pose.MAX_STEER`, 0.7 rad."""
SAME = 0.05
"""Points nearer to the line without them are left out [m]; design value."""
WIDEST = 200.0
"""Largest radius of a rounded corner [m]; design value."""
ARC_STEP = np.radians(3.0)
"""Largest bend between the points of an arc [rad]; design value, below what `mmw town check` calls a kink."""
STRAIGHT = np.radians(0.5)
"""Smaller bends stay [rad]; design value."""
CUT = np.radians(8.0)
"""Smaller bends at the ends of a short side do not make it a corner that is cut off [rad]; design value."""
SHARPEST = np.radians(130.0)
"""Corners sharper than this stay cut off [rad]; design value."""
FARTHEST = 5.0
"""A corner that is whole again lies at most this far from the line [m]; design value."""
HANDLE = 0.39
"""Handles of a curve as a share of its chord [-]: 4/3 (sqrt(2) - 1) / sqrt(2); a quarter circle is exact to 0.03 %."""


def rounded(points: np.ndarray) -> np.ndarray:
    """Return a line [N, 2] with an arc for each corner; its ends and their directions stay [m]."""
    points = _whole_corners(points)
    step = np.diff(points, axis=0)
    length = np.linalg.norm(step, axis=1)
    unit = step / length[:, None]
    made = [points[:1]]
    for k in range(1, len(points) - 1):
        u, v = unit[k - 1], unit[k]
        bend = float(np.arctan2(u[0] * v[1] - u[1] * v[0], u @ v))
        size = abs(bend)
        if size < STRAIGHT or size > np.radians(175):
            made.append(points[k : k + 1])
            continue
        radius = np.clip(OFF / (1 / np.cos(size / 2) - 1), TURN, WIDEST)
        tangent = min(radius * np.tan(size / 2), 0.49 * length[k - 1], 0.49 * length[k])
        radius = tangent / np.tan(size / 2)
        count = max(2, int(np.ceil(size / ARC_STEP)) + 1)
        turned = np.linspace(0.0, bend, count)
        left = np.sign(bend) * np.array([-u[1], u[0]])
        middle = points[k] - tangent * u + radius * left
        made.append(middle + radius * (np.sin(np.abs(turned))[:, None] * u - np.cos(turned)[:, None] * left))
    made.append(points[-1:])
    line = np.concatenate(made)
    return line[np.append(True, np.linalg.norm(np.diff(line, axis=0), axis=1) > 1e-6)]


def _whole_corners(points: np.ndarray) -> np.ndarray:
    """Return a line whose corners that are cut off by a side too short for an arc are one corner again.

    Lines beside a sharp corner of a street have such sides; an arc of the radius `TURN` does not fit on them.
    """
    line = list(shapely.get_coordinates(shapely.simplify(shapely.LineString(points), SAME)))
    k = 1
    while k < len(line) - 2:
        before, side, after = line[k] - line[k - 1], line[k + 1] - line[k], line[k + 2] - line[k + 1]
        bends = [float(np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)) for a, b in ((before, side), (side, after))]
        is_cut = bends[0] * bends[1] > 0 and min(np.abs(bends)) > CUT and abs(sum(bends)) < SHARPEST
        if is_cut and np.linalg.norm(side) < TURN * sum(np.tan(0.5 * np.abs(bends))):
            det = before[0] * after[1] - before[1] * after[0]
            reach = (side[0] * after[1] - side[1] * after[0]) / det
            if abs(det) > 1e-9 and reach > 0 and np.linalg.norm(reach * before) < FARTHEST:
                line[k : k + 2] = [line[k] + reach * before]
                k = max(1, k - 1)
                continue
        k += 1
    return np.array(line)


def curve(start: np.ndarray, along: np.ndarray, end: np.ndarray, onward: np.ndarray) -> np.ndarray:
    """Return a cubic Bezier curve between two points [2] with directions [2], unit vectors, at either end, [N, 2]."""
    chord = float(np.linalg.norm(end - start))
    a, b = start + HANDLE * chord * along, end - HANDLE * chord * onward
    t = np.linspace(0.0, 1.0, max(4, int(np.ceil(chord / 0.25)) + 1))[:, None]
    return (1 - t) ** 3 * start + 3 * t * (1 - t) ** 2 * a + 3 * t**2 * (1 - t) * b + t**3 * end


def resampled(points: np.ndarray, step: float) -> np.ndarray:
    """Return a line [N, 2] with points at most `step` apart, its ends and corners included [m]."""
    station = row_stations(points)
    more = [
        np.linspace(a, b, max(1, int(np.ceil((b - a) / step))), endpoint=False) for a, b in pairwise(station.tolist())
    ]
    return at_stations(np.append(np.concatenate(more), station[-1]), station, points)


def direction(points: np.ndarray, end: int) -> np.ndarray:
    """Return the unit vector of the first (0) or the last (-1) segment of a line, shape [2]."""
    step = points[1] - points[0] if end == 0 else points[-1] - points[-2]
    return step[:2] / np.linalg.norm(step[:2])
