"""Reference lines: lines and arcs in plan, straight grades joined by parabolas in height."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mmw.core.errors import InputError


@dataclass(frozen=True)
class Alignment:
    """A smooth line in plan: straight pieces and circular arcs with a common tangent where they meet."""

    begin: np.ndarray
    """Start of every piece [m], shape [K, 2]."""
    heading: np.ndarray
    """Heading at the start of every piece [rad], shape [K]."""
    curvature: np.ndarray
    """Curvature of every piece, positive to the left [1/m], shape [K]."""
    station: np.ndarray
    """Station of every piece's start, and the length at the end [m], shape [K + 1]."""

    @property
    def length(self) -> float:
        """Length in plan [m]."""
        return float(self.station[-1])

    def at(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return position [m], shape [N, 2], heading [rad] and curvature [1/m], shape [N], at the stations `s` [m]."""
        s = np.asarray(s, dtype=np.float64)
        piece = np.clip(np.searchsorted(self.station, s, side="right") - 1, 0, len(self.heading) - 1)
        along = s - self.station[piece]
        start, kappa = self.heading[piece], self.curvature[piece]
        half = 0.5 * kappa * along
        chord = along * np.sinc(half / np.pi)  # the chord of an arc is 2 sin(angle / 2) / curvature
        middle = start + half
        xy = self.begin[piece] + chord[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1)
        return xy, start + kappa * along, kappa


def make_alignment(points: np.ndarray, radii: np.ndarray, name: str) -> Alignment:
    """Return the line through `points` whose inner corners are rounded.

    Args:
        points: Start, corner points and end [m], shape [N, 2].
        radii: Radius of the arc at every corner point [m], shape [N - 2].
        name: Name of the road, for messages.

    Raises:
        InputError: If two points coincide, a corner turns back, or the arcs of neighboring corners overlap.
    """
    leg = np.diff(points, axis=0)
    length = np.linalg.norm(leg, axis=1)
    if np.any(length < 1e-6):
        raise InputError(f"road {name!r}: two of its points coincide; the points must differ; move one")
    heading = np.arctan2(leg[:, 1], leg[:, 0])
    turn = (np.diff(heading) + np.pi) % (2 * np.pi) - np.pi
    if np.any(np.abs(turn) > np.radians(170)):
        raise InputError(f"road {name!r}: a corner turns by more than 170 deg; split it into two corners")
    tangent = radii * np.tan(0.5 * np.abs(turn))
    left = length - np.concatenate([[0.0], tangent]) - np.concatenate([tangent, [0.0]])
    if np.any(left < -1e-6):
        k = int(np.argmin(left))
        raise InputError(
            f"road {name!r}: leg {k} of {length[k]:.1f} m is {-left[k]:.1f} m too short for the arcs at its ends; "
            "reduce the radius of a `via` point or move it"
        )
    pieces: list[tuple[np.ndarray, float, float, float]] = []  # start, heading, curvature, length
    at = points[0]
    for k in range(len(length)):
        if left[k] > 1e-6:
            pieces.append((at, heading[k], 0.0, left[k]))
        if k == len(turn):
            break
        if abs(turn[k]) > 1e-9:
            begin = points[k + 1] - tangent[k] * leg[k] / length[k]
            pieces.append((begin, heading[k], np.sign(turn[k]) / radii[k], radii[k] * abs(turn[k])))
        at = points[k + 1] + tangent[k] * leg[k + 1] / length[k + 1]
    starts, headings, curvature, lengths = (np.array(column) for column in zip(*pieces, strict=True))
    station = np.concatenate([[0.0], np.cumsum(lengths)])
    return Alignment(starts, headings, curvature, station)


@dataclass(frozen=True)
class Elevation:
    """Height along a road: straight grades, with a parabola centered on every change of grade.

    Source: symmetrical parabolic vertical curve, AASHTO, A Policy on Geometric Design of Highways and Streets, 3.4.6.
    """

    station: np.ndarray
    """Stations of the changes of grade, ascending; first and last are the ends of the road [m], shape [N]."""
    height: np.ndarray
    """Heights there before rounding [m], shape [N]."""
    half: np.ndarray
    """Half the length of the parabola at each; 0 at the ends [m], shape [N]."""

    @cached_property
    def grades(self) -> np.ndarray:
        """Grade between each two changes of it [-], shape [N - 1]."""
        return np.diff(self.height) / np.diff(self.station)

    def at(self, s: np.ndarray) -> np.ndarray:
        """Return the height [m] at the stations `s` [m], shape [N]."""
        s, grade = np.asarray(s, dtype=np.float64), self.grades
        z = np.interp(s, self.station, self.height)
        for k in range(1, len(self.station) - 1):
            if self.half[k] > 0:
                reach = np.clip(self.half[k] - np.abs(s - self.station[k]), 0.0, None)
                z = z + (grade[k] - grade[k - 1]) * reach**2 / (4 * self.half[k])
        return z

    def is_curved(self, s: np.ndarray) -> np.ndarray:
        """Return whether the grade changes at the stations `s` [m], shape [N]."""
        bends = np.flatnonzero(np.abs(np.diff(self.grades)) > 1e-9) + 1
        return np.any(np.abs(np.asarray(s)[:, None] - self.station[bends]) < self.half[bends], axis=1)

    @property
    def steepest(self) -> float:
        """Largest absolute grade; rounding never exceeds it."""
        return float(np.max(np.abs(self.grades)))


def make_elevation(
    length: float,
    ends: tuple[float, float],
    flat: tuple[float, float],
    knots: tuple[tuple[float, float], ...],
    curve: float,
    name: str,
) -> Elevation:
    """Return the height of a road that is flat at both ends.

    Args:
        length: Length of the road [m].
        ends: Height of the first and of the last node [m].
        flat: How far the road is exactly level at either end [m].
        knots: Changes of grade between the flats: station and height [m].
        curve: Length of the parabolas [m]; shorter where the changes of grade lie closer.
        name: Name of the road, for messages.

    Raises:
        InputError: If the flats meet while the ends differ in height, or a knot is not between them.
    """
    first, last = flat[0] + curve / 2, length - flat[1] - curve / 2
    if not knots and ends[0] == ends[1]:
        return Elevation(np.array([0.0, length]), np.array(ends), np.zeros(2))
    if last <= first:
        raise InputError(
            f"road {name!r}: its {length:.1f} m leave no room for a grade between junctions that need "
            f"{flat[0]:.1f} and {flat[1]:.1f} m; level the nodes ({ends[0]:.1f} and {ends[1]:.1f} m) or move them apart"
        )
    stations = [knot[0] for knot in knots]
    if stations != sorted(set(stations)) or (knots and (stations[0] <= first or stations[-1] >= last)):
        raise InputError(
            f"road {name!r}: z stations {stations}; needed: ascending, between {first:.1f} and {last:.1f} m "
            "(measured from the node `from`); correct them"
        )
    station = np.array([0.0, first, *stations, last, length])
    height = np.array([ends[0], ends[0], *(knot[1] for knot in knots), ends[1], ends[1]])
    gap = np.diff(station)
    half = np.zeros(len(station))
    half[1:-1] = np.minimum(curve / 2, 0.5 * np.minimum(gap[:-1], gap[1:]))
    half[1], half[-2] = min(curve / 2, 0.5 * gap[1]), min(curve / 2, 0.5 * gap[-2])
    return Elevation(station, height, half)
