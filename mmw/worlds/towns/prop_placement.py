"""Place props: rows along curbs, signals and signs at junctions, trees on open land."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.core.mesh import merge
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.worlds.towns.block_description import BlockDescription, PlacedProp, PropLine, PropRow, is_named
from mmw.worlds.towns.blocks import Lot, start_west
from mmw.worlds.towns.ground_height import Ground
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.props import FENCE_LENGTH, PANEL_LENGTH, build_prop

KERB_CLEARANCE = 0.3  # least distance of a prop's foot to the carriageway [m]
LARGE_AREA = 20.0
"""Plan of a prop above which others keep clear of all of it, not only of its middle [m^2]."""
HEADROOM = 4.5
"""Clearance above a carriageway from which props may overhang it [m]: the height that trucks need."""
FAR_M = 15.0
"""Distance from the carriageway beyond which a tree's crown is one step coarser, `MIN_DETAIL` at least [m]."""
MIN_DETAIL = 2
PANEL_GAP = 0.02
"""Least gap between two panels of a line [m], so that their ends do not lie in one plane."""


FIRST_PHASE = "a"
"""Phase that has green in pictures, where all signals are still; `mmw.worlds.towns.signal_phases` names them."""

NAMED_AS = {"traffic_light_green": "traffic_light"}
"""Kinds of prop that are called as another one is."""


@dataclass(frozen=True)
class Spot:
    """One prop to be."""

    kind: str
    xy: tuple[float, float]
    yaw: float
    """Direction of the prop's front, counter-clockwise from east [rad]."""
    row: int = -1
    """Spots of one row number become one prop; -1 for a prop of its own."""


class PropPlacer:
    """Place props: the places found so far, and the rules for further ones."""

    def __init__(self, carriageway: shapely.Geometry, lots: Sequence[Lot], ground: Ground) -> None:
        self.carriageway = carriageway
        self.ground = ground
        self.spots: list[Spot] = []
        self._feet = np.zeros((1024, 2))
        self._plans = np.array([lot.outline for lot in lots] or [shapely.Point(1e9, 1e9)])
        shapely.prepare(self.carriageway)

    def add(
        self, kind: str, xy: Sequence[float], yaw: float, clear: float, kerb: float = KERB_CLEARANCE, row: int = -1
    ) -> bool:
        """Add a place on the ground, off the carriageway and `clear` of buildings and props; return whether it fits."""
        xy = (round(float(xy[0]), 2), round(float(xy[1]), 2))
        point = shapely.Point(xy)
        if shapely.dwithin(self.carriageway, point, kerb) or np.isnan(self.ground.height(*xy)):
            return False
        if shapely.dwithin(self._plans, point, clear).any():
            return False
        if (np.hypot(*(self._feet[: len(self.spots)] - xy).T) < clear).any():
            return False
        self._append(Spot(kind, xy, round(float(yaw), 4), row))
        return True

    def _append(self, spot: Spot) -> None:
        if len(self.spots) == len(self._feet):
            self._feet = np.concatenate([self._feet, np.zeros_like(self._feet)])
        self._feet[len(self.spots)] = spot.xy
        self.spots.append(spot)

    def avoided(self, plans: Sequence[shapely.Geometry]) -> None:
        """Keep all further places off some areas."""
        self._plans = np.append(self._plans, np.array(plans, object))
        shapely.prepare(self._plans)

    def place(self, prop: PlacedProp) -> None:
        """Add a prop placed by hand; its parts on the ground must be off roads and buildings.

        Parts above the headroom of trucks, such as a canopy, may reach over a carriageway.

        Raises:
            InputError: If a part is on the carriageway, in a building, in a bay or off the ground.
        """
        spot = Spot(prop.kind, (round(prop.at[0], 2), round(prop.at[1], 2)), round(math.radians(prop.yaw_deg), 4))
        where = f"props: {prop.kind!r} at {prop.at}"
        low, whole = _plan_of(spot, HEADROOM), _plan_of(spot, math.inf)
        if np.isnan(self.ground.height(*shapely.get_coordinates(low).T)).any():
            raise InputError(f"{where}: off the ground; move it into the town")
        if shapely.dwithin(self.carriageway, low, 0.1):
            raise InputError(f"{where}: on the carriageway; move it aside by its size")
        crowded = (np.hypot(*(self._feet[: len(self.spots)] - spot.xy).T) < KERB_CLEARANCE).any()
        if crowded or shapely.intersects(self._plans, low).any():
            raise InputError(f"{where}: in a building, a bay or another prop; move it away")
        self._append(spot)
        if shapely.convex_hull(whole).area > LARGE_AREA:
            self.avoided([shapely.convex_hull(whole)])

    def to_street(self, xy: Sequence[float]) -> float:
        """Return the direction from a point to the nearest kerb [rad]."""
        kerb = shapely.get_coordinates(shapely.shortest_line(shapely.Point(xy), self.carriageway))[1]
        return math.atan2(kerb[1] - xy[1], kerb[0] - xy[0])

    def add_row(self, row: PropRow, rng: np.random.Generator, roads: Mapping[str, np.ndarray]) -> None:
        """Add places along a line at a constant distance from the kerbs."""
        names = list(roads)
        lines = np.array([shapely.LineString(roads[name][:, :2]) for name in names], object)
        chosen = np.array([is_named(name, row.along) for name in names], bool)
        area = shapely.normalize(shapely.buffer(self.carriageway, row.offset_m, quad_segs=8))
        for part in shapely.get_parts(area):
            for ring in map(start_west, (part.exterior, *part.interiors)):
                for station in np.arange(row.start_m, ring.length - 0.5 * row.every_m, row.every_m):
                    shifted = (station + rng.uniform(-row.jitter_m, row.jitter_m)) % ring.length
                    xy = shapely.get_coordinates(ring.interpolate(shifted))[0]
                    kerb = min(KERB_CLEARANCE, row.offset_m - 0.05)
                    if not chosen.all() and not chosen[np.argmin(shapely.distance(lines, shapely.Point(xy)))]:
                        continue
                    self.add(row.kind, xy, self.to_street(xy), row.clear_m, kerb)


def _plan_of(spot: Spot, below: float) -> shapely.Geometry:
    """Return the plan of the faces of a prop that reach below a height above its ground [m]."""
    parts = build_prop("plan", spot.kind, (*spot.xy, 0.0), spot.yaw, np.random.default_rng(0))
    corners = np.concatenate([part.mesh.corners for part in parts])
    faces = np.asarray(shapely.polygons(corners[corners[:, :, 2].min(axis=1) < below][:, :, :2]))
    return shapely.union_all(shapely.buffer(faces[shapely.area(faces) > 1e-6], 0.0))


def approaches(lanes: LaneGraph, patterns: Sequence[str], yielding: bool = False) -> list[Lane]:
    """Return the road lanes that lead into junctions whose names match one of the patterns, sorted by name.

    Args:
        lanes: Lane graph.
        patterns: Junction names, with `*` for anything.
        yielding: Only those whose turns all yield to another turn.
    """
    highest: dict[str, int] = {}
    for lane in lanes.lanes.values():
        highest[lane.junction] = max(highest.get(lane.junction, lane.priority), lane.priority)

    def enters(lane: Lane) -> bool:
        ways = [lanes.lanes[name] for name in lane.successors if lanes.lanes[name].junction]
        if yielding and any(way.priority == highest[way.junction] for way in ways):
            return False
        return any(is_named(way.junction, patterns) for way in ways)

    return [lane for _, lane in sorted(lanes.lanes.items()) if not lane.junction and enters(lane)]


def add_at_approaches(placer: PropPlacer, kind: str, lanes: Sequence[Lane], aside: float, back: float) -> None:
    """Add a place `aside` of the right-hand kerb, `back` before the end of every approach [m], facing the drivers."""
    for lane in lanes:
        station = lane.station
        at = max(0.0, lane.length - back)
        point = np.array([np.interp(at, station, lane.points[:, i]) for i in range(2)])
        along = lane.points[-1, :2] - lane.points[-2, :2]
        along /= np.linalg.norm(along)
        right = np.array([along[1], -along[0]])
        for distance in np.arange(0.5 * lane.width, 16.0, 0.25):
            xy = point + right * distance
            if not shapely.dwithin(placer.carriageway, shapely.Point(xy), aside):
                placer.add(kind, xy, math.atan2(-along[1], -along[0]), 4.0, 0.5 * aside)
                break


def add_trees(
    placer: PropPlacer,
    blocks: Sequence[shapely.Geometry],
    count: int,
    clear: float,
    rng: np.random.Generator,
) -> None:
    """Scatter trees over the blocks, each at least `clear` from buildings and other props [m]."""
    if not blocks or not count:
        return
    shares = np.array([block.area for block in blocks])
    for block, share in zip(blocks, np.round(count * shares / shares.sum()).astype(int), strict=True):
        west, south, east, north = block.bounds
        inside = shapely.buffer(block, -3.0)
        for xy in rng.uniform((west, south), (east, north), (int(4 * share), 2)):
            if share <= 0:
                break
            kind = ("oak", "spruce", "broadleaf_tree")[int(rng.choice(3, p=[0.45, 0.25, 0.3]))]
            if shapely.contains_xy(inside, *xy) and placer.add(kind, xy, rng.uniform(0, 2 * np.pi), clear, 5.0):
                share -= 1


def add_fences(placer: PropPlacer, lots: Sequence[Lot], styles: set[str]) -> None:
    """Add fence panels along the street in front of houses of the given styles, with a gap at the door.

    A panel that would run through one of another house is left out.
    """
    occupied_plans = np.array([], object)
    for row, lot in enumerate(lots):
        if lot.style not in styles:
            continue
        site = lot.site
        along = np.array([math.cos(site.yaw), math.sin(site.yaw)])
        outward = np.array([along[1], -along[0]])
        middle = np.asarray(site.center) + outward * (0.5 * site.depth + 3.2)
        own = []
        for offset in np.arange(1.4 + 0.5 * FENCE_LENGTH, 0.5 * site.width + 3.5, FENCE_LENGTH + PANEL_GAP):
            for side in (-1, 1):
                xy, half = middle + along * side * offset, along * 0.5 * FENCE_LENGTH
                panel = shapely.LineString([xy - half, xy + half])
                is_free = not shapely.dwithin(occupied_plans, panel, 0.1).any()
                if is_free and not shapely.dwithin(placer.carriageway, panel, 1.0):
                    yaw = math.atan2(outward[1], outward[0])
                    own += [panel] * placer.add("fence", xy, yaw, 0.5 * FENCE_LENGTH, 1.0, row)
        occupied_plans = np.append(occupied_plans, np.array(own, object))


def add_line(placer: PropPlacer, line: PropLine, row: int) -> None:
    """Add panels end to end along a line, as one prop; a gap stays at roads, buildings and other props."""
    length = PANEL_LENGTH[line.kind]
    for a, b in pairwise(np.array(line.points, float)):
        side = float(np.linalg.norm(b - a))
        count = int(side / (length + PANEL_GAP))
        along = (b - a) / side
        for k in range(count):
            middle = a + along * (k + 0.5) * side / count
            ends = [middle - 0.5 * length * along, middle + 0.5 * length * along]
            if not shapely.dwithin(placer.carriageway, shapely.LineString(ends), KERB_CLEARANCE):
                yaw = math.atan2(-along[0], along[1])  # the panel's y axis runs along the line
                placer.add(line.kind, middle, yaw, 0.45 * length, KERB_CLEARANCE, row)


def place_props(
    description: BlockDescription,
    carriageway: shapely.Geometry,
    lanes: LaneGraph,
    lots: Sequence[Lot],
    blocks: Sequence[shapely.Polygon],
    ground: Ground,
    solid: Sequence[shapely.Geometry] = (),
    reserved_areas: Sequence[shapely.Geometry] = (),
    roads: Mapping[str, np.ndarray] | None = None,
) -> list[MeshPart]:
    """Return all props of a town, named `<kind>_NNN` in the order in which they were placed.

    Args:
        description: Section `props`, and the open spaces of section `blocks`.
        carriageway: Drivable area.
        lanes: Lane graph, for signs and signals.
        lots: Buildings that props keep clear of.
        blocks: Land for scattered trees.
        ground: Heights.
        solid: Further areas without props, such as bays and the columns of bridges.
        reserved_areas: Areas for props placed by hand only, such as car parks and the plans of bridges.
        roads: Road -> its reference line [m], [N, 3], for rows along certain roads.

    Raises:
        InputError: If a prop placed by hand is on the carriageway, in a building or off the ground.
    """
    section = description.props
    rng = np.random.default_rng([description.blocks.seed, 1])
    placer = PropPlacer(carriageway, lots, ground)
    placer.avoided(solid)
    for placed in section.placed:
        placer.place(placed)
    placer.avoided(reserved_areas)
    for number, line in enumerate(section.lines):
        add_line(placer, line, len(lots) + number)
    for lane in approaches(lanes, section.signalled):
        is_green = any(lanes.lanes[name].signal == FIRST_PHASE for name in lane.successors)
        kind = "traffic_light_green" if is_green else "traffic_light"
        add_at_approaches(placer, kind, [lane], 0.6, 0.5)
    add_at_approaches(placer, "give_way_sign", approaches(lanes, section.give_way, True), 0.7, 1.5)
    for row in section.rows:
        placer.add_row(row, rng, roads or {})
    if section.fences:
        pitched = {name for name, style in description.blocks.styles.items() if style.roof_form != "flat"}
        add_fences(placer, lots, pitched)
    spaces = [shapely.Point(space.center).buffer(space.radius_m) for space in description.blocks.open_spaces]
    for space, area in zip(description.blocks.open_spaces, spaces, strict=True):
        add_trees(placer, [area], space.trees, 3.0, rng)
    rest = [shapely.difference(block, shapely.union_all(spaces)) for block in blocks]
    add_trees(placer, rest, section.scattered_trees, 4.5, rng)
    return _build(placer.spots, ground, rng, section.crown_detail, carriageway)


def _build(
    spots: Sequence[Spot], ground: Ground, rng: np.random.Generator, detail: int, carriageway: shapely.Geometry
) -> list[MeshPart]:
    """Return the meshes of all spots; the members of a row share one prop, and trees far from roads are coarser."""
    at = shapely.points(np.array([spot.xy for spot in spots]).reshape(-1, 2))
    is_far = np.asarray(shapely.distance(at, carriageway)) > FAR_M
    counts: Counter[str] = Counter()
    names: dict[tuple[str, int], str] = {}
    heights = ground.height(*np.array([spot.xy for spot in spots]).reshape(-1, 2).T)
    parts: dict[str, list[MeshPart]] = {}
    for number, (spot, z) in enumerate(zip(spots, heights, strict=True)):
        key = (spot.kind, spot.row if spot.row >= 0 else -1 - number)
        if key not in names:
            called = NAMED_AS.get(spot.kind, spot.kind)
            counts[called] += 1
            names[key] = f"{called}_{counts[called]:03d}"
        fine = max(detail - 1, MIN_DETAIL) if is_far[number] else detail
        for part in build_prop(names[key], spot.kind, (*spot.xy, float(z)), spot.yaw, rng, fine):
            parts.setdefault(part.path, []).append(part)
    return [
        MeshPart.of(path, merge(part.mesh for part in same), same[0].material, same[0].label)
        for path, same in parts.items()
    ]
