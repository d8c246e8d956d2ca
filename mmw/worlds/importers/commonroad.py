"""CommonRoad scenarios (.xml, 2018b and 2020a) -> scene: lanelets as roads and lanes on flat ground.

Source: CommonRoad, Documentation of the XML format, 2018b and 2020a: bounds of lanelets have equally many points, the
center line is midway between them; speed limits are in m/s.
"""

import xml.etree.ElementTree as ElementTree
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.traffic.polyline import arc_length, sample_polyline
from mmw.traffic.replay.xml_tables import LANELET_CURE, lanelet_origin, read_number
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.mesh_cleanup import MAX_COORDINATE_M, identifier
from mmw.worlds.importers.osm.ground import MARGIN, GroundPlan, build_ground
from mmw.worlds.importers.xml_nodes import parse_xml
from mmw.worlds.towns.plan_geometry import polygons_of

MAX_LANELETS = 50_000
"""Largest number of lanelets of a file; a city has fewer."""
STEP = 1.0
"""Largest distance of the points of a lane [m]; design value."""
MAX_GAP = 0.5
"""Lanelets that follow each other lie at most this far apart [m]; as for OpenDRIVE."""
SHOULDER = 0.5
"""Paving beside the outermost lanelets [m]: recorded wheels leave them. Design value."""
MAX_HOLE = 60.0
"""Holes between lanelets up to this area are paved [m^2]; design value, below the smallest central islands."""
MIN_WIDTH = 2.0
"""Width of lanes on lanelets that begin or end in a point [m]; design value, vehicles are as wide."""
DEFAULT_SPEED = 50 / 3.6
"""Speed limit where a lanelet has none [m/s]; the limit in towns of most countries."""
SPEED_SIGNS = ("274", "R2-1", "R301")
"""Signs of a speed limit: Germany, China and others; United States; Spain. Their additional value is in m/s."""
WALKED = ("sidewalk", "crosswalk")
"""Types of lanelets for people."""
NOT_DRIVEN = ("bicycleLane", "border", "restricted", "parking")
"""Types of lanelets that are paved but no lane."""
PARALLEL = np.cos(np.radians(5.0))
"""Neighbors between which vehicles change differ by less in heading, as the cosine [-]; as `mmw town check`."""


@dataclass
class _Lanelet:
    """One lanelet."""

    id: str
    left: np.ndarray
    """Left bound [m], shape [N, 2]."""
    right: np.ndarray
    """Right bound with as many points [m], shape [N, 2]."""
    types: frozenset[str]
    speed: float | None
    successors: list[str]
    beside: dict[str, str] = field(default_factory=dict)
    """`left` and `right` -> lanelet that goes in the same direction."""
    junction: str = ""

    @property
    def is_lane(self) -> bool:
        """Whether vehicles drive on it."""
        return not self.types & {*WALKED, *NOT_DRIVEN}


def read_commonroad(path: str | Path) -> ImportedScene:
    """Read the lanelets of a scenario.

    Args:
        path: The file.

    Returns:
        Roads and sidewalks at z = 0, ground around them, and a lane `lanelet_<id>` for each lanelet that is driven on.
        The origin is that of the file, or a round point that `traffic.trajectories` of the same file uses too.

    Raises:
        InputError: If the file is no scenario, is broken, is larger than 20 km or holds no lanelet.
    """
    path = Path(path)
    root = parse_xml(path, "commonRoad", "export the scenario again")
    origin = lanelet_origin(root, path)
    lanelets = _lanelets(root, path, origin)
    if not lanelets:
        raise InputError(
            f"{path}: <commonRoad> has no <lanelet> with two bounds; choose a scenario with a road network"
        )
    every = np.concatenate([line for each in lanelets.values() for line in (each.left, each.right)])
    if np.abs(every).max() > MAX_COORDINATE_M:
        far = max(lanelets.values(), key=lambda each: float(np.abs(each.left - np.median(every, axis=0)).max()))
        raise InputError(
            f"{path}: <lanelet id={far.id!r}> reaches {np.abs(every).max() / 1e3:.4g} km from the origin; "
            f"{MAX_COORDINATE_M / 1e3:.0f} km or less are needed; {LANELET_CURE}"
        )
    _mark_junctions(root, lanelets)
    lanes, notes = _lanes(lanelets)
    if origin.any():
        notes.append(f"the origin was moved to x = {origin[0]:.0f} m, y = {origin[1]:.0f} m of the file")
    notes.append("flat, without markings, signs and lights: lanelets have no heights, and their lines are not built")
    return ImportedScene(build_ground(_plan(lanelets)), {}, lanes, tuple(notes))


def _lanelets(root: ElementTree.Element, path: Path, origin: np.ndarray) -> dict[str, _Lanelet]:
    """Return the lanelets by id."""
    speeds = _signs(root, path)
    found: dict[str, _Lanelet] = {}
    elements = root.findall("lanelet")
    if len(elements) > MAX_LANELETS:
        raise InputError(f"{path}: {len(elements):,} lanelets; at most {MAX_LANELETS:,} are read; cut the scenario")
    for element in elements:
        name = element.get("id", "")
        where = f"{path}: <lanelet id={name[:40]!r}>"
        if name in found:
            raise InputError(f"{where}: there is another one of this id; ids must differ; {LANELET_CURE}")
        left, right = (_bound(element, side, where) - origin for side in ("leftBound", "rightBound"))
        if len(left) != len(right):
            count = max(len(left), len(right))
            left, right = (
                sample_polyline(b, s := arc_length(b), np.linspace(0.0, s[-1], count)) for b in (left, right)
            )
        if arc_length(0.5 * (left + right))[-1] < 0.05:
            continue
        limits = [speeds[ref] for sign in element.findall("trafficSignRef") if (ref := sign.get("ref", "")) in speeds]
        text = element.findtext("speedLimit")
        if text is not None:
            limits.append(read_number(text, f"{where} speedLimit", LANELET_CURE))
        found[name] = _Lanelet(
            name, left, right,
            frozenset((each.text or "").strip() for each in element.findall("laneletType")),
            min((limit for limit in limits if 0.0 < limit < 100.0), default=None),
            [each.get("ref", "") for each in element.findall("successor")],
            {side: each.get("ref", "") for side in ("left", "right")
             for each in element.findall(f"adjacent{side.title()}") if each.get("drivingDir") == "same"},
        )  # fmt: skip
    return found


def _signs(root: ElementTree.Element, path: Path) -> dict[str, float]:
    """Return id of a sign -> speed limit [m/s]."""
    found = {}
    for sign in root.findall("trafficSign"):
        for each in sign.findall("trafficSignElement"):
            value = each.findtext("additionalValue")
            if each.findtext("trafficSignID", "").strip() in SPEED_SIGNS and value is not None:
                where = f"{path}: <trafficSign id={sign.get('id', '')[:40]!r}> additionalValue"
                found[sign.get("id", "")] = read_number(value, where, LANELET_CURE)
    return found


def _bound(lanelet: ElementTree.Element, side: str, where: str) -> np.ndarray:
    """Return the points of a bound without repeated ones [m], shape [N, 2], N >= 2."""
    points = np.array(
        [
            [read_number(point.findtext(axis), f"{where} {side} point {number} {axis}", LANELET_CURE) for axis in "xy"]
            for number, point in enumerate(lanelet.findall(f"{side}/point"))
        ]
    ).reshape(-1, 2)
    if len(points) < 2:
        raise InputError(f"{where} {side} has {len(points)} points; at least two are needed; {LANELET_CURE}")
    return points


def _mark_junctions(root: ElementTree.Element, lanelets: dict[str, _Lanelet]) -> None:
    """Name the junction of the lanelets that cross it."""
    for crossing in root.findall("intersection"):
        name = identifier(f"junction_{crossing.get('id', '')}")
        for each in crossing.findall("incoming"):
            for way in ("successorsRight", "successorsStraight", "successorsLeft"):
                for ref in each.findall(way):
                    if ref.get("ref") in lanelets:
                        lanelets[ref.get("ref", "")].junction = name


def _plan(lanelets: dict[str, _Lanelet]) -> GroundPlan:
    """Return the area of every kind of ground in plan, without overlaps."""
    areas: dict[str, list[shapely.Geometry]] = {"road": [], "walk": []}
    for each in lanelets.values():
        # piece by piece: bounds that cross, as in tight turns, leave holes in the polygon of both
        four = np.stack([each.left[:-1], each.left[1:], each.right[1:], each.right[:-1]], axis=1)
        pieces = shapely.convex_hull(shapely.multipoints(four))
        areas["walk" if "sidewalk" in each.types else "road"] += polygons_of(
            shapely.GeometryCollection(list(pieces)), 0.0
        )
    # lanelets that only touch in a line, or nearly so, are one area
    road = shapely.union_all(areas["road"], grid_size=1e-3).buffer(SHOULDER, join_style="mitre", mitre_limit=2.0)
    road = shapely.MultiPolygon([_filled(each) for each in polygons_of(shapely.set_precision(road, 1e-3), 0.0)])
    walk = shapely.difference(shapely.union_all(areas["walk"], grid_size=1e-3), road, grid_size=1e-3)
    x0, y0, x1, y1 = shapely.total_bounds(np.array([road, walk]))
    frame = shapely.box(*np.round([x0 - MARGIN, y0 - MARGIN, x1 + MARGIN, y1 + MARGIN], 3))
    return GroundPlan({"road": road, "walk": walk}, frame)


def _filled(area: shapely.Polygon) -> shapely.Polygon:
    """Return a polygon without its small holes: between the lanelets of a crossing there is asphalt too."""
    holes = [ring for ring in area.interiors if shapely.Polygon(ring).area > MAX_HOLE]
    return shapely.Polygon(area.exterior, holes)


def _lanes(lanelets: dict[str, _Lanelet]) -> tuple[LaneGraph | None, list[str]]:
    """Return the lanes of the lanelets that are driven on, joined at their ends, and notes."""
    driven = {name: each for name, each in lanelets.items() if each.is_lane}
    if not driven:
        return None, ["no lanes: all lanelets are for people or bicycles"]
    centers = {name: 0.5 * (each.left + each.right) for name, each in driven.items()}
    faults: Counter[str] = Counter()
    links: dict[str, list[str]] = {name: [] for name in driven}
    for name, each in driven.items():
        for other in dict.fromkeys(each.successors):
            if other not in lanelets:
                faults["to lanelets that do not exist"] += 1
            elif other in driven and float(np.linalg.norm(centers[name][-1] - centers[other][0])) <= MAX_GAP:
                links[name].append(other)
            elif other in driven:
                faults[f"over {MAX_GAP:g} m apart"] += 1
    _join(centers, links)
    names = {name: identifier(f"lanelet_{name}") for name in driven}
    lanes = {}
    unlimited = sum(each.speed is None for each in driven.values())
    for name, each in driven.items():
        line = centers[name]
        along = arc_length(line)
        plan = sample_polyline(line, along, np.linspace(0.0, along[-1], 1 + max(1, int(np.ceil(along[-1] / STEP)))))
        width = max(MIN_WIDTH, float(np.linalg.norm(each.left - each.right, axis=1).min()))  # all of it is paved
        lanes[names[name]] = Lane(
            names[name], np.column_stack([plan, np.zeros(len(plan))]), width, each.speed or DEFAULT_SPEED,
            junction=each.junction, successors=tuple(names[other] for other in links[name]),
        )  # fmt: skip
    for name, each in driven.items():
        for side, back in (("left", "right"), ("right", "left")):
            other = each.beside.get(side, "")
            is_mutual = other in driven and driven[other].beside.get(back) == name
            if not is_mutual or each.junction or driven[other].junction:
                continue
            own, its = lanes[names[name]], lanes[names[other]]
            if _are_parallel(own, its, side) and _are_parallel(its, own, back):
                lanes[names[name]] = replace(own, **{side: names[other]})
    notes = [f"links between lanelets left out, {text}: {count}" for text, count in sorted(faults.items())]
    if unlimited:
        notes.append(f"{unlimited} lanelets without a speed limit: {DEFAULT_SPEED * 3.6:.0f} km/h assumed")
    return LaneGraph(lanes), notes


def _join(centers: dict[str, np.ndarray], links: dict[str, list[str]]) -> None:
    """Move the ends that links join to their mean, so that lanes share a point; in place."""
    group = {(name, end): (name, end) for name in centers for end in (0, -1)}

    def top(key: tuple[str, int]) -> tuple[str, int]:
        while group[key] != key:
            key = group[key] = group[group[key]]
        return key

    for name, others in links.items():
        for other in others:
            group[top((other, 0))] = top((name, -1))
    members: dict[tuple[str, int], list[tuple[str, int]]] = {}
    for key in group:
        members.setdefault(top(key), []).append(key)
    for keys in members.values():
        if len(keys) > 1:
            middle = np.mean([centers[name][end] for name, end in keys], axis=0)
            for name, end in keys:
                centers[name][end] = middle


def _are_parallel(lane: Lane, other: Lane, side: str) -> bool:
    """Return whether the middle of a lane has another one beside it, on a side and in the same direction."""
    middle = len(lane.points) // 2
    away = other.points[:, :2] - lane.points[middle, :2]
    near = int(np.argmin(np.linalg.norm(away, axis=1)))
    turn = lane.headings[min(middle, len(lane.headings) - 1)]
    across = np.cos(turn) * away[near, 1] - np.sin(turn) * away[near, 0]
    is_same = np.cos(turn - other.headings[min(near, len(other.headings) - 1)]) > PARALLEL
    is_near = float(np.linalg.norm(away[near])) <= lane.width + other.width
    return bool(is_same and is_near and (across > 0.0) == (side == "left"))
