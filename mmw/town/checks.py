"""What must hold for a road network; each check stops the build with a message that says what to change."""

from itertools import combinations

import numpy as np
import shapely

from mmw.town.alignment import Elevation
from mmw.town.lanes import Lane, LaneGraph
from mmw.town.roads import RoadBody

STEEPEST = 0.20
"""Largest grade of a road [-]; design value, steeper than all but a few streets."""
LEAST_CLEARANCE = 5.0
"""Least height between two roads that cross [m]: 4.5 m of headroom that trucks are given, and half a metre of deck."""
HALF_VEHICLE = 1.3
"""Least distance from the middle of a lane to a kerb [m]: half the width of a city bus (2.55 m), rounded up."""


def check_grade(name: str, elevation: Elevation) -> None:
    """Raise ValueError if a road is steeper than 0.20."""
    if elevation.steepest > STEEPEST:
        grade = np.abs(np.diff(elevation.height) / np.diff(elevation.station))
        k = int(np.argmax(grade))
        raise ValueError(
            f"road {name!r}: grade {grade[k]:.3f} between stations {elevation.station[k]:.1f} and "
            f"{elevation.station[k + 1]:.1f} m; {STEEPEST:.2f} or less is needed; lengthen the slope or lower its end"
        )


def check_clearance(bodies: dict[str, RoadBody]) -> None:
    """Raise ValueError if two roads cross away from a node with less than 5 m between them."""
    lines = {name: shapely.LineString(body.centre_line) for name, body in bodies.items()}
    for first, second in combinations(lines, 2):
        if not shapely.intersects(lines[first], lines[second]):
            continue
        for point in shapely.get_parts(shapely.intersection(lines[first], lines[second])):
            x, y = point.centroid.x, point.centroid.y
            z = [_height_on(bodies[name].centre_line, x, y) for name in (first, second)]
            if abs(z[0] - z[1]) < LEAST_CLEARANCE:
                raise ValueError(
                    f"roads {first!r} and {second!r} cross at ({x:.1f}, {y:.1f}) with {abs(z[0] - z[1]):.1f} m between "
                    f"them; {LEAST_CLEARANCE} m are needed; raise one, or put a node there"
                )


def _height_on(line: np.ndarray, x: float, y: float) -> float:
    """Height of a polyline where it passes closest to a point in plan [m]."""
    station = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line[:, :2], axis=0), axis=1))])
    at = shapely.line_locate_point(shapely.LineString(line[:, :2]), shapely.Point(x, y))
    return float(np.interp(at, station, line[:, 2]))


def check_lanes(graph: LaneGraph, carriageway: shapely.Geometry) -> None:
    """Raise ValueError if a lane leads nowhere, comes from nowhere, or runs too close to a kerb."""
    fed = {name for lane in graph.lanes.values() for name in lane.successors}
    kerb = shapely.boundary(carriageway)
    shapely.prepare(kerb)
    for lane in graph.lanes.values():
        if not lane.successors:
            raise ValueError(f"lane {lane.name!r} has no successor; join a road that leads on")
        if not lane.junction and lane.name not in fed:
            raise ValueError(f"lane {lane.name!r} has no predecessor; join a road that leads to it")
        step = np.diff(lane.points, axis=0)
        grade = float(np.max(np.abs(step[:, 2]) / np.hypot(step[:, 0], step[:, 1])))
        if grade > STEEPEST:
            raise ValueError(
                f"lane {lane.name!r}: grade {grade:.3f} on the inside of a bend; {STEEPEST:.2f} or less is needed; "
                "lengthen the slope or widen the bend"
            )
        distance = _kerb_distance(lane, kerb)
        if distance < HALF_VEHICLE:
            raise ValueError(
                f"lane {lane.name!r} passes {distance:.2f} m from a kerb; {HALF_VEHICLE} m are needed; increase "
                "corner_radius of the junction or the shoulder of the profile"
            )


def check_connected(graph: LaneGraph) -> None:
    """Raise ValueError if some lane cannot be reached from another: vehicles would gather in one part of the town."""
    first = next(iter(graph.lanes))
    onward = {name: lane.successors for name, lane in graph.lanes.items()}
    for reach, way in ((onward, "reached from"), (graph.predecessors, "left towards")):
        seen, queue = {first}, [first]
        while queue:
            for name in reach[queue.pop()]:
                if name not in seen:
                    seen.add(name)
                    queue.append(name)
        lost = sorted(set(graph.lanes) - seen)
        if lost:
            raise ValueError(f"lane {lost[0]!r} cannot be {way} lane {first!r}; join its road to the rest of the town")


def _kerb_distance(lane: Lane, kerb: shapely.Geometry) -> float:
    # A lane ends at the seam of a pad, which is no kerb: the border of the carriageway runs only along kerbs.
    return float(shapely.distance(shapely.LineString(lane.points[:, :2]), kerb))
