"""Turning back at a junction: an arc where there is room between the lanes, else a teardrop."""

from collections.abc import Sequence

import numpy as np
import shapely

MAX_U_TURN_RADIUS, MIN_U_TURN_RADIUS = 7.0, 5.0
"""Largest radius of a half circle and least radius of any turn [m]; 5 m is about the turning radius of a car's front
axle, 10.5 to 11.5 m between kerbs; design values."""

SWING = (5.5, 5.0)
"""Radii of a teardrop to try [m]: a wider one goes farther round."""

LEADS = (2.0, 1.0, 0.0)
"""Straight run before and after the turn to try [m]: what the rear axle needs to come back behind the front one."""

KERB_CLEARANCE = 1.5
"""Least distance from a kerb [m]: at 5 m radius the outer front corner of a car swings 1.3 m beyond the line."""


def u_turn(
    start: np.ndarray,
    heading: float,
    exits: Sequence[np.ndarray],
    outline: np.ndarray,
    kerbs: Sequence[np.ndarray],
    step: float,
) -> tuple[int, np.ndarray] | None:
    """Return how vehicles turn back inside a junction: into the innermost lane for which a turn to the left fits.

    Args:
        start: Where the innermost lane to the node ends [m], shape [2].
        heading: Its direction there [rad].
        exits: Where the lanes of the same arm away from the node begin, from the middle outward [m], each [2].
        outline: Border of the junction's carriageway, counter-clockwise [m], shape [N, 2].
        kerbs: Kerb lines of its corners [m], each [N, 2].
        step: Largest change of heading from one point to the next [rad].

    Returns:
        Index of the lane and the points of the way [m], shape [M, 2]; None if none fits.
    """
    area = shapely.Polygon(outline).buffer(0.05)
    border = shapely.MultiLineString([np.asarray(kerb) for kerb in kerbs])
    forward = np.array([np.cos(heading), np.sin(heading)])
    left = np.array([-forward[1], forward[0]])
    for lane, end in enumerate(exits):
        ahead, aside = float((end - start) @ forward), float((end - start) @ left)
        radii = SWING if aside < 2 * MIN_U_TURN_RADIUS else (min(0.5 * aside, MAX_U_TURN_RADIUS), MIN_U_TURN_RADIUS)
        for radius in radii:
            for lead in LEADS:
                local = u_turn_curve(aside, radius, step)
                local[:, 0] += max(lead, lead + ahead)
                points = np.concatenate([[start], start + local @ np.stack([forward, left]), [end]])
                points = points[np.concatenate([[True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6])]
                line = shapely.LineString(points)
                if area.contains(line) and shapely.distance(line, border) >= KERB_CLEARANCE:
                    return lane, points
    return None


def u_turn_curve(aside: float, radius: float, step: float) -> np.ndarray:
    """Return a turn by 180 deg to the left from the origin, heading along x, to (0, aside).

    Where the way aside is less than two radii, it first swings out to the right, turns left by more than 180 deg, and
    swings back: three arcs of the same radius, whose angle follows from the distance of their centers.

    Args:
        aside: Distance between the two lanes [m], > 0.
        radius: Radius of all arcs [m].
        step: Largest change of heading from one point to the next [rad].

    Returns:
        Points [m], shape [M, 2].
    """
    if aside >= 2 * radius:
        straight = [(0.0, aside - 2 * radius)] if aside > 2 * radius else []
        parts = [(0.5 * np.pi, radius), *straight, (0.5 * np.pi, radius)]
    else:
        swing = float(np.arccos((0.5 * aside + radius) / (2 * radius)))
        parts = [(-swing, radius), (np.pi + 2 * swing, radius), (-swing, radius)]
    points, at, heading = [np.zeros((1, 2))], np.zeros(2), 0.0
    for turn, size in parts:
        if turn == 0.0:
            arc = at + size * np.array([[np.cos(heading), np.sin(heading)]])
        else:
            angle = turn * np.arange(1, int(np.ceil(abs(turn) / step)) + 1) / np.ceil(abs(turn) / step)
            chord = 2 * size * np.sin(0.5 * np.abs(angle))
            middle = heading + 0.5 * angle
            arc = at + chord[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1)
        points.append(arc)
        at, heading = arc[-1], heading + turn
    return np.concatenate(points)
