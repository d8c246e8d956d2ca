"""Check a road network; a failed check stops the build with a message that names the cure."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.worlds.lane_reach import ahead, behind, reach
from mmw.worlds.towns.alignment import Elevation
from mmw.worlds.towns.elevated_roads import Structure
from mmw.worlds.towns.plan_geometry import intersect_areas, row_stations
from mmw.worlds.towns.roads import RoadBody

MAX_GRADE = 0.20
"""Largest grade of a road [-]; design value, steeper than all but a few streets."""
MIN_CLEARANCE = 5.0
"""Least height from a carriageway to the underside of a bridge [m]: the 4.5 m of headroom that trucks are given, and
half a meter for later layers of asphalt; design value."""
HALF_VEHICLE = 1.3
"""Least distance from the middle of a lane to a kerb [m]: half the width of a city bus (2.55 m), rounded up."""


def check_grade(name: str, elevation: Elevation) -> None:
    """Raise InputError if a road is steeper than 0.20."""
    if elevation.steepest > MAX_GRADE:
        grade = np.abs(elevation.grades)
        k = int(np.argmax(grade))
        raise InputError(
            f"road {name!r}: grade {grade[k]:.3f} between stations {elevation.station[k]:.1f} and "
            f"{elevation.station[k + 1]:.1f} m; {MAX_GRADE:.2f} or less is needed; lengthen the slope or lower its end"
        )


def check_crossings(bodies: dict[str, RoadBody]) -> None:
    """Raise InputError if two roads cross on the ground away from a node."""
    pieces = [(name, body.centre_line[rows]) for name, body in bodies.items() for rows in body.on_ground]
    pieces = [(name, line, shapely.LineString(line)) for name, line in pieces if len(line) > 1]
    for (first, one, line), (second, two, other) in combinations(pieces, 2):
        if first == second or not shapely.intersects(line, other):
            continue
        for point in shapely.get_parts(shapely.intersection(line, other)):
            x, y = point.centroid.x, point.centroid.y
            z = [_height_on(points, x, y) for points in (one, two)]
            raise InputError(
                f"roads {first!r} and {second!r} cross at ({x:.1f}, {y:.1f}) with {abs(z[0] - z[1]):.1f} m between "
                f"them; {MIN_CLEARANCE} m are needed below a `bridge`; make one a bridge, or put a node there"
            )


def check_clearance(structures: Sequence[Structure], roads: dict[str, np.ndarray]) -> None:
    """Raise InputError if the underside of a structure is less than 5 m above a carriageway, anywhere in plan.

    Args:
        structures: Bridges with their piers.
        roads: Name -> triangles of its carriageway on the ground [m], shape [M, 3, 3].
    """
    for structure in structures:
        others = [(other.road, other.surface, True) for other in structures if other.road != structure.road]
        for name, surface, is_bridge in [*((name, points, False) for name, points in roads.items()), *others]:
            gap, xy = overlap_gaps(surface, structure.underside)
            if is_bridge:  # where the other one lies above, it is the one that is checked
                gap, xy = gap[gap > -0.5], xy[gap > -0.5]
            if len(gap) and gap.min() < MIN_CLEARANCE:
                x, y = xy[int(np.argmin(gap))]
                raise InputError(
                    f"bridge of road {structure.road!r}: {gap.min():.2f} m of clearance above {name!r} at "
                    f"({x:.1f}, {y:.1f}); {MIN_CLEARANCE} m are needed; raise the bridge or move one of the roads"
                )


def overlap_gaps(lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the height of one surface above another wherever their triangles overlap in plan.

    Between two planes the height is linear, so its extremes are at the corners of the overlaps.

    Args:
        lower: Triangles facing up [m], shape [M, 3, 3].
        upper: Triangles facing up [m], shape [K, 3, 3].

    Returns:
        Heights at the corners of all overlaps [m], shape [P], and where they are [m], shape [P, 2]; P is 0 if there
        are none.
    """
    plans = [np.asarray(shapely.polygons(triangles[:, :, :2])) for triangles in (lower, upper)]
    i, j = shapely.STRtree(plans[1]).query(plans[0], predicate="intersects")
    shared = intersect_areas(plans[0][i], plans[1][j])
    keep = np.flatnonzero(shapely.area(shared) > 1e-4)  # the rest only touch
    xy, which = shapely.get_coordinates(shared[keep], return_index=True)
    pair = keep[which]
    return _plane(upper[j[pair]], xy) - _plane(lower[i[pair]], xy), xy


def _plane(triangles: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Return the heights of the planes of triangles [P, 3, 3] at points [P, 2]; shape [P]."""
    a, u, v = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    normal = np.cross(u, v)
    away = xy - a[:, :2]
    return a[:, 2] - np.einsum("ij,ij->i", normal[:, :2], away) / normal[:, 2]


def _height_on(line: np.ndarray, x: float, y: float) -> float:
    """Return the height of a polyline where it passes closest to a point in plan [m]."""
    station = row_stations(line[:, :2])
    at = shapely.line_locate_point(shapely.LineString(line[:, :2]), shapely.Point(x, y))
    return float(np.interp(at, station, line[:, 2]))


def check_lanes(graph: LaneGraph, kerb: shapely.Geometry, own: dict[str, shapely.Geometry]) -> None:
    """Raise InputError if a lane leads nowhere, comes from nowhere, or runs too close to a kerb.

    Args:
        graph: Lanes.
        kerb: Kerb lines on the ground.
        own: Lane -> kerb lines of its road, for lanes that run over a bridge: what lies below does not count.
    """
    fed = {name for lane in graph.lanes.values() for name in lane.successors}
    shapely.prepare(kerb)
    for lane in graph.lanes.values():
        if not lane.successors:
            raise InputError(f"lane {lane.name!r} has no successor; join a road that leads on")
        if not lane.junction and lane.name not in fed:
            raise InputError(f"lane {lane.name!r} has no predecessor; join a road that leads to it")
        step = np.diff(lane.points, axis=0)
        grade = float(np.max(np.abs(step[:, 2]) / np.hypot(step[:, 0], step[:, 1])))
        if grade > MAX_GRADE:
            raise InputError(
                f"lane {lane.name!r}: grade {grade:.3f} on the inside of a bend; {MAX_GRADE:.2f} or less is needed; "
                "lengthen the slope or widen the bend"
            )
        # A lane ends at the seam of a pad, which is no kerb: the border of the carriageway runs only along kerbs.
        distance = shapely.distance(shapely.LineString(lane.points[:, :2]), own.get(lane.name, kerb))
        if distance < HALF_VEHICLE:
            raise InputError(
                f"lane {lane.name!r} passes {distance:.2f} m from a kerb; {HALF_VEHICLE} m are needed; increase "
                "corner_radius of the junction or the shoulder of the profile"
            )


def check_connected(graph: LaneGraph) -> None:
    """Raise InputError if some lane cannot be reached from another: vehicles would gather in one part of the town."""
    first = next(iter(graph.lanes))
    for step, verb in ((ahead(graph), "reached from"), (behind(graph), "left towards")):
        lost = sorted(set(graph.lanes) - reach(first, step))
        if lost:
            raise InputError(f"lane {lost[0]!r} cannot be {verb} lane {first!r}; join its road to the rest of the town")
