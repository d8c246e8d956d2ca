"""Lay flush details into the carriageway: arrows before junctions, drain grates, manhole covers.

Each is cut out of the asphalt, never a second layer on it, and only where there is nothing but asphalt. Roads without
kerbs have only arrows.
"""

import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import shapely

from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.paved_areas import Region, outline_of, pave
from mmw.worlds.towns.plan_geometry import at_stations
from mmw.worlds.towns.primitives import circle
from mmw.worlds.towns.roads import MIN_WAITING, RoadBody
from mmw.worlds.towns.turn_lanes import kind_of_turn

MANHOLE_EVERY, MANHOLE_RADIUS, MANHOLE_SIDES = 40.0, 0.36, 8
"""Distance of manholes along a road, radius of a cover with its frame [m], corners of its outline. Design values; a
manhole that people climb into has a clear opening of 0.6 m (EN 124-1)."""
DRAIN_EVERY, DRAIN = 30.0, (0.5, 0.32)
"""Distance of drains along a kerb, and length and width of a grate [m]; design values."""
KERB_GAP = 0.04
"""From the foot of the kerb to a grate [m]; design value."""
ARROWS = (3.0, 23.0)
"""From where vehicles wait back to the tips of the arrows of a lane [m]; design values."""
ARROW_LENGTH, SHAFT, HEAD = 4.0, 0.09, (1.5, 0.32)
"""Length of an arrow, half width of its shaft, length and half width of its head [m]; design values."""
BRANCH, BRANCH_HEAD = ((0.9, 0.0), (2.1, 0.58)), (0.62, 0.34)
"""Begin and end of the shaft of a turn (along, aside), length and half width of its head [m]; design values."""
HEAD_TURN = np.radians(60.0)
"""How far the head of a turn points aside [rad]; design value."""
BACK = np.radians(150.0)
"""A way that turns by more leads back, which no arrow shows [rad]."""
MARGIN = 0.02
"""Least asphalt around a detail [m]."""
APART = 0.3
"""Least distance of two details [m]."""


def add_road_details(parts: Sequence[MeshPart], bodies: Mapping[str, RoadBody], lanes: LaneGraph) -> list[MeshPart]:
    """Return the meshes of a road network with the details of its roads cut out of their asphalt."""
    owner = {f"Roads/{name}/asphalt": body for name, body in bodies.items()}
    made: list[MeshPart] = []
    for part in parts:
        made += _with_details(part, owner[part.path], lanes) if part.path in owner else [part]
    return made


def _with_details(part: MeshPart, body: RoadBody, lanes: LaneGraph) -> list[MeshPart]:
    outline = shapely.buffer(outline_of(part), -MARGIN)
    shapely.prepare(outline)
    own = [lanes.lanes[lane.name] for lane in body.lanes]
    has_sewer = body.section.edge[1, 1] > 0.0  # a road without kerbs drains into its verges
    wanted = (
        ("arrows", "road_marking", "road_line", [area for lane in own for area in _arrows(lane, lanes)]),
        ("drains", "drain_grate", "road", _drains(body) if has_sewer else ()),
        ("manholes", "manhole_cover", "road", _manholes(body, own) if has_sewer else ()),
    )
    occupied_plans: list[shapely.Geometry] = []
    regions = []
    for name, material, label, areas in wanted:
        found = []
        for area in areas:
            if (
                shapely.contains(outline, area)
                and not shapely.dwithin(np.array(occupied_plans, dtype=object), area, APART).any()
            ):
                found.append(area)
                occupied_plans.append(area)
        if found:
            path = f"Roads/{body.road.id}/{name}"
            regions.append(Region(path, shapely.MultiPolygon(found), material, label))
    return [replace(made, label=part.label) if made.path == part.path else made for made in pave([part], regions)]


def _bent(line: np.ndarray, start: float, shape: np.ndarray) -> np.ndarray:
    """Return the points of a shape in plan, x along a line from `start` on and y to its left [m], shape [K, 2]."""
    middle, left = _frames(line, start + shape[:, 0])
    return middle + shape[:, 1:] * left


def _rigid(line: np.ndarray, station: float, shape: np.ndarray) -> np.ndarray:
    """Return the points of a shape in plan that keeps its size, x along a line and y to its left [m], shape [K, 2]."""
    middle, left = _frames(line, np.array([station]))
    return middle + shape[:, :1] * np.array([left[0, 1], -left[0, 0]]) + shape[:, 1:] * left


def _frames(line: np.ndarray, station: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points of a line in plan by the way along it [m], and the unit vector to its left there, each [K, 2]."""
    step = np.diff(line[:, :2], axis=0)
    at = np.concatenate([[0.0], np.cumsum(np.hypot(step[:, 0], step[:, 1]))])
    heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    angle = np.interp(station, 0.5 * (at[:-1] + at[1:]), heading)
    middle = at_stations(station, at, line[:, :2])
    return middle, np.column_stack([-np.sin(angle), np.cos(angle)])


def arrow(kinds: Sequence[str]) -> shapely.Geometry:
    """Return an arrow along +x from 0 to at most `ARROW_LENGTH`, y to the left [m].

    Args:
        kinds: Ways that it shows: `straight`, `left`, `right`.
    """
    neck = ARROW_LENGTH - HEAD[0]
    ways = [((0.0, 0.0), (neck, 0.0))] if "straight" in kinds else []
    heads = [(np.array([neck, 0.0]), 0.0, HEAD)] if "straight" in kinds else []
    for kind, side in (("left", 1.0), ("right", -1.0)):
        if kind in kinds:
            end = np.array([BRANCH[1][0], side * BRANCH[1][1]])
            ways.append(((0.0, 0.0), BRANCH[0], tuple(end)))
            heads.append((end, side * HEAD_TURN, BRANCH_HEAD))
    pieces = [shapely.buffer(shapely.LineString(way), SHAFT, cap_style="flat", join_style="mitre") for way in ways]
    for base, turn, (long, half) in heads:
        ahead, aside = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
        pieces.append(shapely.Polygon([base - half * aside, base + long * ahead, base + half * aside]))
    return shapely.normalize(shapely.union_all(pieces, grid_size=1e-3))


def _arrows(lane: Lane, lanes: LaneGraph) -> Iterator[shapely.Polygon]:
    """Yield the arrows of a lane: only where there are several side by side, and they end at paint across the road."""
    if not (lane.left or lane.right) or lane.stop <= MIN_WAITING:
        return
    turns = [np.unwrap(lanes.lanes[name].headings)[[0, -1]] for name in lane.successors]
    kinds = {kind_of_turn(float(last - first)) for first, last in turns if abs(last - first) < BACK}
    if not kinds:
        return
    shape = shapely.get_coordinates(arrow(sorted(kinds)))[:-1]
    for back in ARROWS:
        start = lane.length - lane.stop - back - ARROW_LENGTH
        if start > ARROW_LENGTH:
            yield shapely.Polygon(_bent(lane.points, start, shape))


def _drains(body: RoadBody) -> Iterator[shapely.Polygon]:
    """Yield the grates along both kerbs of a road."""
    length = float(np.hypot(*np.diff(body.centre_line[:, :2], axis=0).T).sum())
    count = int(length / DRAIN_EVERY)
    half, near = 0.5 * DRAIN[0], body.section.half - KERB_GAP
    for side in (-1.0, 1.0):
        for station in (np.arange(count) + 0.5) * length / max(count, 1):
            aside = side * np.array([near, near, near - DRAIN[1], near - DRAIN[1]])
            shape = np.column_stack([half * np.array([-1, 1, 1, -1]), aside])
            yield shapely.Polygon(_rigid(body.centre_line, float(station), shape))


def _manholes(body: RoadBody, lanes: Sequence[Lane]) -> Iterator[shapely.Polygon]:
    """Yield the covers of a road, between the tracks of the wheels of a lane chosen at random."""
    rng = np.random.default_rng(zlib.crc32(body.road.id.encode()))
    station = rng.uniform(0.3, 0.7) * MANHOLE_EVERY
    while station < lanes[0].length - 1.0:
        lane = lanes[int(rng.integers(len(lanes)))]
        shape = circle(MANHOLE_RADIUS, MANHOLE_SIDES) + np.array([0.0, rng.uniform(-0.2, 0.2)])
        yield shapely.Polygon(_rigid(lane.points, station, shape))
        station += MANHOLE_EVERY * rng.uniform(0.8, 1.2)
