"""Areas of a SUMO network in plan: carriageway, paint, sidewalks that go on through junctions."""

from collections.abc import Mapping, Sequence

import numpy as np
import shapely

from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.worlds.importers.sumo.network import Edge, Network
from mmw.worlds.importers.sumo.smooth_line import resampled, rounded
from mmw.worlds.towns.plan_geometry import at_stations, polygons_of, row_stations

GUTTER = 0.25
"""Pavement beside the outermost lane [m]; design value."""
BEYOND = 0.6
"""How far the areas of lanes reach beyond their ends [m]; design value."""
SWEPT = 3.0
"""Width that vehicles sweep on their way through a junction [m]: 2.55 m (Council Directive 96/53/EC), and room."""
TIGHT = 15.0
"""In bends of a smaller radius, the rear wheels of long vehicles leave the lane [m]; design value."""
OFF_TRACK = 2.8
"""Half the width that they need there [m]: half a vehicle, and 6 m - sqrt(6^2 - 4^2) m for an axle distance of 4 m."""
AROUND = 1.5
"""Half the stretch over which a bend is measured [m]; design value."""
CORNER = 6.0
"""Radius of the kerb around the corners of a junction [m]; design value, as netconvert is told to round them."""
KERB = 1.0
"""Least radius of the kerb in inner corners near junctions [m]; design value."""
NEAR_JUNCTION = 4.0
"""Distance from a junction where the kerb is rounded [m]; design value."""
SEAM = 0.02
"""Sidewalks less than twice this apart are one [m]; design value."""
MAX_HOLE = 30.0
"""Gaps between lanes below this area are paved [m^2]; design value, as in OpenDRIVE junctions."""
LINE = 0.12
"""Width of a painted line [m]; design value, Germany's narrow line."""
DASH = (3.0, 6.0)
"""Length of a dash between lanes and of a gap [m]; design value, Germany's guide line in towns."""
STOP_LINE = 0.5
"""Width of a stop line [m]; design value."""
ZEBRA = 0.5
"""Width of a stripe of a crossing, and of a gap [m]; design value."""
MAIN = ("motorway", "trunk", "primary", "secondary", "tertiary")
"""Classes of roads whose directions are parted by a line; others have one if they have several lanes."""


def plan_roads(
    network: Network, graph: LaneGraph, held: Mapping[str, float] | None = None
) -> dict[str, shapely.Geometry]:
    """Return what a network covers in plan: `paved`, `walk` beside it, and `paint` on it, which is part of `paved`.

    Args:
        network: The network.
        graph: Its lanes: the carriageway holds all that vehicles sweep.
        held: As for `build_lanes`: where the stop lines of these lanes are.
    """
    held = held or {}
    roads = [lane.points[:, :2] for lane in graph.lanes.values()]
    widths = [lane.width + 2 * GUTTER if not lane.junction else SWEPT for lane in graph.lanes.values()]
    driven = [_buffer(line, 0.5 * width) for line, width in zip(roads, widths, strict=True)]
    driven += [shapely.LineString(bend).buffer(OFF_TRACK, quad_segs=8) for line in roads for bend in _bends(line)]
    walked, other = [], []
    for edge in network.edges.values():
        for lane in edge.lanes if not edge.function else ():
            if lane.is_walked:
                walked.append(_buffer(rounded(lane.points), 0.5 * lane.width))
            elif lane.id in held:
                driven.append(_buffer(rounded(lane.points), 0.5 * lane.width + GUTTER))
            elif not lane.is_driven:
                other.append(shapely.LineString(rounded(lane.points)).buffer(0.5 * lane.width + GUTTER, quad_segs=8))
    walked += [_outline(e.lanes[0].points) for e in network.edges.values() if e.function == "walkingarea" and e.lanes]
    walk = shapely.union_all(walked)
    inside = [_outline(j.outline) for j in network.junctions.values() if len(j.outline) > 2]
    crossed = shapely.union_all([area for area in inside if not area.is_empty])
    lanes = shapely.union_all([*driven, *other])
    corners = shapely.difference(shapely.intersection(_closed(lanes, CORNER), crossed), walk)
    walk = shapely.union_all([walk, *_beside(walk, shapely.difference(crossed, shapely.union(corners, lanes)))])
    paved = shapely.union(lanes, corners)
    kerb = shapely.intersection(_closed(paved, KERB), crossed.buffer(NEAR_JUNCTION, quad_segs=2))
    paved = shapely.union(paved, kerb)
    paved = _filled(paved.buffer(0.2, join_style="mitre").buffer(-0.2, join_style="mitre"))
    walk = shapely.difference(walk.buffer(0.1, join_style="mitre").buffer(-0.1, join_style="mitre"), paved)
    walk = walk.buffer(-0.2, join_style="mitre").buffer(0.2, join_style="mitre")  # no strips that nobody walks on
    paint = shapely.intersection(shapely.union_all(_paint(network, held)), paved.buffer(-0.05))
    paved = _plain(paved)
    walk = _plain(shapely.difference(walk, paved).buffer(SEAM, join_style="mitre").buffer(-SEAM, join_style="mitre"))
    return {"paved": paved, "walk": walk, "paint": _plain(paint)}


def _bends(line: np.ndarray) -> list[np.ndarray]:
    """Return the pieces of a line that bend more than a circle of the radius `TIGHT`."""
    step = np.diff(line, axis=0)
    heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    station = row_stations(line)
    middle = 0.5 * (station[1:] + station[:-1])
    if len(middle) < 2:
        return []
    ahead, behind = (np.interp(station + side, middle, heading) for side in (AROUND, -AROUND))
    is_tight = np.abs(ahead - behind) > 2 * AROUND / TIGHT
    found = []
    for run in np.split(np.arange(len(line)), np.flatnonzero(np.diff(is_tight.astype(int))) + 1):
        if is_tight[run[0]] and len(run) > 1:
            found.append(line[run])
    return found


def _closed(area: shapely.Geometry, radius: float) -> shapely.Geometry:
    """Return an area with its inner corners rounded, and with gaps of less than twice the radius [m] filled."""
    return area.buffer(radius, quad_segs=8).buffer(-radius, quad_segs=8)


def _beside(walk: shapely.Geometry, areas: shapely.Geometry) -> list[shapely.Geometry]:
    """Return the areas that border on sidewalks over at least `KERB` [m]."""
    near = walk.buffer(SEAM, quad_segs=1)
    return [p for p in polygons_of(areas, 0.0) if shapely.intersection(p.exterior, near).length > KERB]


def _plain(area: shapely.Geometry) -> shapely.Geometry:
    return shapely.union_all([shapely.simplify(p, 0.01) for p in polygons_of(area, 0.01)])


def _buffer(line: np.ndarray, reach: float) -> shapely.Geometry:
    """Return the area beside a line, and a little beyond its ends, where the next one may have another heading."""
    line = line.copy()
    for end, inner in ((0, 1), (-1, -2)):
        step = line[end] - line[inner]
        line[end] += BEYOND * step / np.linalg.norm(step)
    return shapely.LineString(line).buffer(reach, cap_style="flat", join_style="round", quad_segs=4)


def _outline(points: np.ndarray) -> shapely.Geometry:
    if len(points) < 3:
        return shapely.Polygon()
    return shapely.union_all(polygons_of(shapely.make_valid(shapely.Polygon(points)), 0.0))


def _filled(area: shapely.Geometry) -> shapely.Geometry:
    """Return an area without its small holes."""
    kept = [
        shapely.Polygon(p.exterior, [ring for ring in p.interiors if shapely.Polygon(ring).area >= MAX_HOLE])
        for p in polygons_of(area, 0.0)
    ]
    return shapely.union_all(kept)


def _paint(network: Network, held: Mapping[str, float]) -> list[shapely.Geometry]:
    """Lines between lanes and directions, stop lines, and the stripes of crossings."""
    found = []
    ends = {(edge.start, edge.end): edge for edge in network.roads}
    stopping = {c.first for c in network.connections if c.light or c.state in "sw"}
    for edge in network.roads:
        back = ends.get((edge.end, edge.start))
        found += _edge_lines(edge, back, network.is_left_hand)
        for lane in edge.lanes:
            if lane.id in stopping and lane.is_driven:
                line = rounded(lane.points)
                length = row_stations(line)[-1] - held.get(lane.id, 0.0)
                if length > 4.0:
                    found.append(_strip(line, (-0.5 * lane.width, 0.5 * lane.width), (length - STOP_LINE, length)))
    for edge in network.edges.values():
        if edge.function == "crossing" and edge.lanes:
            lane = edge.lanes[0]
            length = row_stations(lane.points)[-1]
            for start in np.arange(0.5 * ZEBRA, length - ZEBRA, 2 * ZEBRA):
                half = 0.5 * lane.width
                found.append(_strip(lane.points, (-half, half), (start, start + ZEBRA)))
    return found


def _edge_lines(edge: Edge, back: Edge | None, is_left_hand: bool) -> list[shapely.Geometry]:
    found = []
    driven = [lane for lane in edge.lanes if not lane.is_walked]
    inward = -1.0 if is_left_hand else 1.0
    for lane in driven[:-1]:
        found += _dashes(rounded(lane.points), inward * 0.5 * lane.width)
    is_main = edge.kind.removeprefix("highway.").split("_")[0].split("|")[0] in MAIN
    if back is not None and edge.id < back.id and driven and (is_main or len(driven) > 1):
        line, offset = rounded(driven[-1].points), inward * 0.5 * driven[-1].width
        if len(driven) > 1:
            around = (offset - 0.5 * LINE, offset + 0.5 * LINE)
            found.append(_strip(line, around, (0.0, row_stations(line)[-1])))
        else:
            found += _dashes(line, offset)
    return found


def _dashes(line: np.ndarray, offset: float) -> list[shapely.Geometry]:
    """Dashes along a line, to its left if `offset` [m] is positive, evenly over its length."""
    length, period = float(row_stations(line)[-1]), sum(DASH)
    count = int((length - DASH[0]) / period) + 1 if length > 2 * DASH[0] else 0
    first = 0.5 * (length - (count - 1) * period - DASH[0])
    across = (offset - 0.5 * LINE, offset + 0.5 * LINE)
    return [_strip(line, across, (first + k * period, first + k * period + DASH[0])) for k in range(count)]


def _strip(line: np.ndarray, across: Sequence[float], along: Sequence[float]) -> shapely.Geometry:
    """Return the area between two offsets from a line, positive to its left, and two stations [m]."""
    station = row_stations(line)
    start, end = np.clip(along, 0.0, station[-1])
    inner = station[(station > start + 1e-3) & (station < end - 1e-3)]
    points = at_stations(np.concatenate([[start], inner, [end]]), station, line)
    if len(points) < 2 or np.linalg.norm(points[-1] - points[0]) < 1e-3:
        return shapely.Polygon()
    points = resampled(points, 10.0)
    step = np.gradient(points, axis=0)
    left = np.column_stack([-step[:, 1], step[:, 0]]) / np.linalg.norm(step, axis=1)[:, None]
    low, high = (points + offset * left for offset in across)
    return shapely.union_all(polygons_of(shapely.make_valid(shapely.Polygon(np.concatenate([low, high[::-1]]))), 0.0))
