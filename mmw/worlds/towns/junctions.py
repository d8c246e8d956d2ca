"""Junctions: where the arms end, the kerbs round the corners, and the level pad between them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.worlds.towns.alignment import Alignment
from mmw.worlds.towns.description import Road
from mmw.worlds.towns.junction_markings import through_lines
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.plan_geometry import at_stations, row_stations, triangulate_polygons
from mmw.worlds.towns.roads import RoadBody
from mmw.worlds.towns.section import CrossSection
from mmw.worlds.towns.strip_mesh import Chain, Surface, chain_parts, offset_table

MARGIN = 1.0
"""Straight kerb between a rounded corner and the border of the pad [m]; design value."""
MIN_TRIM = 4.0
"""Least distance from a node to the border of its pad [m]; design value."""
NEARLY_STRAIGHT = np.radians(150)
"""Neighboring arms that open wider than this have no corner to round [rad]."""
MIN_OPENING = np.radians(30)
"""Arms closer together than this make no junction [rad]: their corner would lie far away."""


@dataclass(frozen=True)
class Arm:
    """One end of a road, seen from its node."""

    road: Road
    section: CrossSection
    alignment: Alignment
    is_start: bool
    """Whether the node is the one at station 0."""

    @property
    def key(self) -> tuple[str, bool]:
        """Road and end, unique in the town."""
        return self.road.id, self.is_start

    def outward(self, distance: float) -> float:
        """Return the heading away from the node at a distance from it along the road [rad]."""
        s = distance if self.is_start else self.alignment.length - distance
        heading = float(self.alignment.at(np.array([s]))[1][0])
        return heading if self.is_start else heading + np.pi


def sort_arms(arms: list[Arm]) -> list[Arm]:
    """Return the arms of a node counter-clockwise."""
    return sorted(arms, key=lambda arm: arm.outward(0.0) % (2 * np.pi))


def openings(arms: list[Arm]) -> list[float]:
    """Return the angle from each arm to the next one counter-clockwise [rad]; `arms` are sorted."""
    heading = [arm.outward(0.0) for arm in arms]
    return [float((heading[(k + 1) % len(arms)] - heading[k]) % (2 * np.pi)) for k in range(len(arms))]


def find_trims(node: str, arms: list[Arm], radius: float) -> list[float]:
    """Return how far from the node each arm ends, so that corners of `radius` fit between the arms [m].

    Raises:
        InputError: If the node has fewer than two arms, or two arms leave it in nearly the same direction.
    """
    if len(arms) < 2:
        ids = ", ".join(arm.road.id for arm in arms) or "none"
        raise InputError(f"node {node!r}: roads that meet here: {ids}; 2 or more are needed, a dead end traps vehicles")
    trims = [MIN_TRIM] * len(arms)
    for k, opening in enumerate(openings(arms)):
        i, j = k, (k + 1) % len(arms)
        if opening < MIN_OPENING:
            raise InputError(
                f"node {node!r}: roads {arms[i].road.id!r} and {arms[j].road.id!r} open by "
                f"{np.degrees(opening):.1f} deg; {np.degrees(MIN_OPENING):.0f} deg or more are needed; "
                "bend one with `via`"
            )
        if opening < NEARLY_STRAIGHT:
            near, far = arms[i].section.half, arms[j].section.half
            tangent = radius / np.tan(0.5 * opening) + MARGIN
            trims[i] = max(trims[i], (far + near * np.cos(opening)) / np.sin(opening) + tangent)
            trims[j] = max(trims[j], (near + far * np.cos(opening)) / np.sin(opening) + tangent)
    return trims


@dataclass(frozen=True)
class Blend:
    """A smooth curve in plan from one directed point to another."""

    xy: np.ndarray
    """Points [m], shape [N, 2]."""
    heading: np.ndarray
    """Tangent direction at the points [rad], shape [N]."""
    radius: float
    """Smallest radius of curvature [m]; inf for a straight line."""


def blend(
    p0: np.ndarray, h0: float, p1: np.ndarray, h1: float, arc_step: float, line_step: float, lead: float = 0.0
) -> Blend:
    """Return a straight line, an arc and a straight line, or a cubic where these do not fit.

    Args:
        p0: Start [m], shape [2].
        h0: Heading at the start [rad].
        p1: End [m], shape [2].
        h1: Heading at the end [rad].
        arc_step: Largest distance of points on an arc [rad], as the angle between their tangents.
        line_step: Largest distance of points anywhere [m].
        lead: Length that stays straight at both ends [m].
    """
    u0, u1 = np.array([np.cos(h0), np.sin(h0)]), np.array([np.cos(h1), np.sin(h1)])
    chord = p1 - p0
    length = float(np.hypot(*chord))
    turn = float((h1 - h0 + np.pi) % (2 * np.pi) - np.pi)
    sideways = abs(float(u0[0] * chord[1] - u0[1] * chord[0]))
    if abs(turn) < 1e-6 and sideways < 1e-6 * length:
        count = max(1, int(np.ceil(length / line_step - 1e-9)))
        t = np.linspace(0, 1, count + 1)[:, None]
        return Blend(p0 + t * chord, np.full(count + 1, h0), np.inf)
    cross = float(u0[0] * u1[1] - u0[1] * u1[0])
    if abs(cross) > np.sin(np.radians(2)):
        a = float(chord[0] * u1[1] - chord[1] * u1[0]) / cross  # p0 + a u0 = p1 - b u1
        b = float(chord[1] * u0[0] - chord[0] * u0[1]) / cross
        if min(a, b) > max(0.2 * length, 2 * lead):
            return _line_arc_line(p0, h0, p1, h1, min(a, b) - lead, (a, b), turn, (arc_step, line_step))
    t = np.linspace(0, 1, 401)[:, None]
    m0, m1 = length * u0, length * u1
    fine = (2 * t**3 - 3 * t**2 + 1) * p0 + (t**3 - 2 * t**2 + t) * m0
    fine = fine + (3 * t**2 - 2 * t**3) * p1 + (t**3 - t**2) * m1
    speed = (6 * t**2 - 6 * t) * (p0 - p1) + (3 * t**2 - 4 * t + 1) * m0 + (3 * t**2 - 2 * t) * m1
    bend = (12 * t - 6) * (p0 - p1) + (6 * t - 4) * m0 + (6 * t - 2) * m1
    kappa = np.abs(speed[:, 0] * bend[:, 1] - speed[:, 1] * bend[:, 0]) / np.linalg.norm(speed, axis=1) ** 3
    station = row_stations(fine)
    count = max(2, int(np.ceil(station[-1] / min(line_step, max(0.3, arc_step / max(kappa.max(), 1e-9))))))
    pick = np.interp(np.linspace(0, station[-1], count + 1), station, t[:, 0])
    xy, direction = (at_stations(pick, t[:, 0], values) for values in (fine, speed))
    xy[0], xy[-1] = p0, p1
    return Blend(xy, np.arctan2(direction[:, 1], direction[:, 0]), float(1 / kappa.max()))


def _line_arc_line(
    p0: np.ndarray,
    h0: float,
    p1: np.ndarray,
    h1: float,
    tangent: float,
    legs: tuple[float, float],
    turn: float,
    steps: tuple[float, float],
) -> Blend:
    radius = tangent / np.tan(0.5 * abs(turn))
    u0, u1 = np.array([np.cos(h0), np.sin(h0)]), np.array([np.cos(h1), np.sin(h1)])
    begin = p0 + (legs[0] - tangent) * u0
    count = max(2, int(np.ceil(max(abs(turn) / steps[0], radius * abs(turn) / steps[1]) - 1e-9)))
    angle = turn * np.linspace(0, 1, count + 1)
    chord = 2 * radius * np.sin(0.5 * np.abs(angle))
    middle = h0 + 0.5 * angle
    xy = begin + chord[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1)
    heading = h0 + angle
    before, after = legs[0] - tangent, legs[1] - tangent
    if before > 1e-6:
        n = int(np.ceil(before / steps[1] - 1e-9))
        lead = p0 + (np.arange(n) * before / n)[:, None] * u0
        xy, heading = np.concatenate([lead, xy]), np.concatenate([np.full(n, h0), heading])
    if after > 1e-6:
        n = int(np.ceil(after / steps[1] - 1e-9))
        tail = p1 - (np.arange(n)[::-1] * after / n)[:, None] * u1
        xy, heading = np.concatenate([xy, tail]), np.concatenate([heading, np.full(n, h0 + turn)])
    xy[0], xy[-1] = p0, p1
    return Blend(xy, heading, float(radius))


@dataclass(frozen=True)
class Pad:
    """The level ground of a junction as built."""

    parts: tuple[MeshPart, ...]
    corners: tuple[Chain, ...]
    """Kerb chains; corner k joins arm k to arm k + 1."""
    outline: np.ndarray
    """Border of the carriageway, counter-clockwise [m], shape [N, 2]."""


def build_pad(node: str, arms: list[Arm], trims: list[float], bodies: dict[str, RoadBody]) -> Pad:
    """Return the pad of a junction between the ends of its arms."""
    outline, corners = [], []
    for k, arm in enumerate(arms):
        other = arms[(k + 1) % len(arms)]
        here, there = bodies[arm.road.id], bodies[other.road.id]
        first = (here.left if arm.is_start else here.right).table[-1]  # the edge that arrives at the node
        last = (there.right if other.is_start else there.left).table[0]  # the edge that leaves it
        h0 = arm.outward(trims[k]) + np.pi
        h1 = other.outward(trims[(k + 1) % len(arms)])
        curve = blend(first[0, :2], h0, last[0, :2], h1, np.radians(9.5), 3.0)
        foot = np.column_stack([curve.xy, np.full(len(curve.xy), first[0, 2])])
        part = row_stations(curve.xy)
        part = (part / part[-1])[:, None, None]
        edge = (1 - part) * arm.section.edge + part * other.section.edge
        outward = np.stack([np.sin(curve.heading), -np.cos(curve.heading)], axis=1)
        table = offset_table(foot, outward, edge[:, :, 0], edge[:, :, 1])
        table[0], table[-1] = first, last
        corners.append(Chain(f"{node}_corner{k}", table))
        outline.append(table[:, 0, :2])
    border = np.concatenate(outline)
    lines = _through_lines(arms, trims, bodies)
    surface, level = Surface(), corners[0].table[0, 0, 2]
    every = np.concatenate([border, *lines])
    surface.add_points(np.column_stack([every, np.full(len(every), level)]))
    surface.add_faces("asphalt", triangulate(border, node, lines))
    first_point = len(border)
    for line in lines:
        surface.add_faces("road_marking", first_point + triangulate(line, node))
        first_point += len(line)
    parts = surface.parts(
        {
            "asphalt": (f"Roads/junction_{node}/asphalt", "road"),
            "road_marking": (f"Roads/junction_{node}/marking", "road_line"),
        }
    )
    parts += chain_parts(f"junction_{node}", corners)
    return Pad(tuple(parts), tuple(corners), border)


def _through_lines(arms: list[Arm], trims: list[float], bodies: dict[str, RoadBody]) -> list[np.ndarray]:
    """Return the outlines of the paint of a one-way road that enters by one arm and leaves by another; else none."""
    oneway = [k for k, arm in enumerate(arms) if not arm.section.backward]
    before = [k for k in oneway if not arms[k].is_start]
    after = [k for k in oneway if arms[k].is_start]
    if len(before) != 1 or len(after) != 1 or arms[before[0]].section.profile != arms[after[0]].section.profile:
        return []
    i, j = before[0], after[0]
    p0 = bodies[arms[i].road.id].centre_line[-1, :2]
    p1 = bodies[arms[j].road.id].centre_line[0, :2]
    curve = blend(p0, arms[i].outward(trims[i]) + np.pi, p1, arms[j].outward(trims[j]), np.radians(1.0), 0.5)
    count = len(arms)
    return through_lines(arms[i].section, curve.xy, curve.heading, ((j + 1) % count != i, (i + 1) % count != j))


def triangulate(border: np.ndarray, name: str, holes: Sequence[np.ndarray] = ()) -> np.ndarray:
    """Return triangles that fill a simple polygon and use all of its vertices, facing up, shape [M, 3].

    Args:
        border: Outer border [m], shape [N, 2].
        name: Name of the junction, for messages.
        holes: Borders of the parts that stay empty [m], each [K, 2]; their vertices follow those of `border`.

    Raises:
        InputError: If the border crosses itself.
    """
    polygon = shapely.Polygon(border, holes)
    border = np.concatenate([border, *holes])
    if not polygon.is_valid:
        raise InputError(
            f"junction {name!r}: the kerbs of its arms cross ({shapely.is_valid_reason(polygon)}); "
            "increase the angle between the arms or reduce corner_radius"
        )
    index = {(x, y): k for k, (x, y) in enumerate(border)}
    return np.array(
        [[index[(x, y)] for x, y in triangle] for triangle in triangulate_polygons(polygon)], dtype=np.int64
    )
