"""Where props stand: rows along the kerbs, signals and signs at junctions, trees over open land."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from mmw.town.block_description import BlockDescription, PropRow, is_named
from mmw.town.blocks import Lot, start_west
from mmw.town.ground import Ground
from mmw.town.lanes import Lane, LaneGraph
from mmw.town.parts import MeshPart
from mmw.town.props import FENCE_LENGTH, build_prop
from mmw.town.solids import Mesh, merge

KERB_CLEARANCE = 0.3  # least distance of a prop's foot to the carriageway [m]
LARGE_AREA = 20.0
"""Plan of a prop above which others keep clear of all of it, not only of its middle [m^2]."""


@dataclass(frozen=True)
class Spot:
    """One prop to be."""

    kind: str
    xy: tuple[float, float]
    yaw: float
    """Direction of the prop's front, counter-clockwise from east [rad]."""
    row: int = -1
    """Spots of one row number become one prop; -1 for a prop of its own."""


class Furniture:
    """Spots found so far, and the rules that every further spot keeps."""

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
        """Take a spot if it is on the ground, off the carriageway and `clear` of buildings and props; say whether."""
        xy = (round(float(xy[0]), 2), round(float(xy[1]), 2))
        point = shapely.Point(xy)
        if shapely.dwithin(self.carriageway, point, kerb) or np.isnan(self.ground.height(*xy)):
            return False
        if shapely.dwithin(self._plans, point, clear).any():
            return False
        if (np.hypot(*(self._feet[: len(self.spots)] - xy).T) < clear).any():
            return False
        if len(self.spots) == len(self._feet):
            self._feet = np.concatenate([self._feet, np.zeros_like(self._feet)])
        self._feet[len(self.spots)] = xy
        self.spots.append(Spot(kind, xy, round(float(yaw), 4), row))
        return True

    def reserve(self, spot: Spot) -> None:
        """Keep every further spot off the plan of a large prop, such as a forecourt."""
        parts = build_prop("reserved", spot.kind, (*spot.xy, 0.0), spot.yaw, np.random.default_rng(0))
        plan = shapely.convex_hull(shapely.MultiPoint(np.concatenate([part.points for part in parts])[:, :2]))
        if plan.area > LARGE_AREA:
            self._plans = np.append(self._plans, plan)
            shapely.prepare(self._plans)

    def to_street(self, xy: Sequence[float]) -> float:
        """Return the direction from a point to the nearest kerb [rad]."""
        kerb = shapely.get_coordinates(shapely.shortest_line(shapely.Point(xy), self.carriageway))[1]
        return math.atan2(kerb[1] - xy[1], kerb[0] - xy[0])

    def add_row(self, row: PropRow, rng: np.random.Generator) -> None:
        """Take spots along a line at a constant distance from all kerbs."""
        area = shapely.normalize(shapely.buffer(self.carriageway, row.offset_m, quad_segs=8))
        for part in shapely.get_parts(area):
            for ring in map(start_west, (part.exterior, *part.interiors)):
                for station in np.arange(row.start_m, ring.length - 0.5 * row.every_m, row.every_m):
                    shifted = (station + rng.uniform(-row.jitter_m, row.jitter_m)) % ring.length
                    xy = shapely.get_coordinates(ring.interpolate(shifted))[0]
                    kerb = min(KERB_CLEARANCE, row.offset_m - 0.05)
                    self.add(row.kind, xy, self.to_street(xy), row.clear_m, kerb)


def approaches(lanes: LaneGraph, patterns: Sequence[str], yielding: bool = False) -> list[Lane]:
    """Return the road lanes that lead into junctions whose names match one of the patterns, sorted by name.

    Args:
        lanes: Lane graph.
        patterns: Junction names, with `*` for anything.
        yielding: Only those whose ways through the junction all give way to some other way.
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


def add_at_approaches(furniture: Furniture, kind: str, lanes: Sequence[Lane], aside: float, back: float) -> None:
    """Take a spot at the right-hand kerb of every approach; the prop looks at the drivers.

    Args:
        furniture: Takes the spots.
        kind: Kind of prop.
        lanes: Lanes that end at a junction.
        aside: Distance from the kerb [m].
        back: Distance before the end of the lane [m].
    """
    for lane in lanes:
        station = lane.station
        at = max(0.0, lane.length - back)
        point = np.array([np.interp(at, station, lane.points[:, i]) for i in range(2)])
        along = lane.points[-1, :2] - lane.points[-2, :2]
        along /= np.linalg.norm(along)
        right = np.array([along[1], -along[0]])
        for distance in np.arange(0.5 * lane.width, 16.0, 0.25):
            xy = point + right * distance
            if not shapely.dwithin(furniture.carriageway, shapely.Point(xy), aside):
                furniture.add(kind, xy, math.atan2(-along[1], -along[0]), 4.0, 0.5 * aside)
                break


def add_trees(
    furniture: Furniture,
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
            if shapely.contains_xy(inside, *xy) and furniture.add(kind, xy, rng.uniform(0, 2 * np.pi), clear, 5.0):
                share -= 1


def add_fences(furniture: Furniture, lots: Sequence[Lot], styles: set[str]) -> None:
    """Take fence panels along the street in front of houses of the given styles, with a gap at the door."""
    for row, lot in enumerate(lots):
        if lot.style not in styles:
            continue
        site = lot.site
        along = np.array([math.cos(site.yaw), math.sin(site.yaw)])
        outward = np.array([along[1], -along[0]])
        middle = np.asarray(site.center) + outward * (0.5 * site.depth + 3.2)
        for offset in np.arange(1.4 + 0.5 * FENCE_LENGTH, 0.5 * site.width + 3.5, FENCE_LENGTH):
            for side in (-1, 1):
                xy, half = middle + along * side * offset, along * 0.5 * FENCE_LENGTH
                if not shapely.dwithin(furniture.carriageway, shapely.LineString([xy - half, xy + half]), 1.0):
                    furniture.add("fence", xy, math.atan2(outward[1], outward[0]), 0.5 * FENCE_LENGTH, 1.0, row)


def furnish(
    description: BlockDescription,
    carriageway: shapely.Geometry,
    lanes: LaneGraph,
    lots: Sequence[Lot],
    blocks: Sequence[shapely.Polygon],
    ground: Ground,
) -> list[MeshPart]:
    """Return all props of a town, named `<kind>_NNN` in the order in which they were placed.

    Args:
        description: Section `props`, and the open spaces of section `blocks`.
        carriageway: Drivable area.
        lanes: Lane graph, for signs and signals.
        lots: Buildings that props keep clear of.
        blocks: Land for scattered trees.
        ground: Heights.

    Raises:
        ValueError: If a prop placed by hand stands on the carriageway, in a building or off the ground.
    """
    section = description.props
    rng = np.random.default_rng([description.blocks.seed, 1])
    furniture = Furniture(carriageway, lots, ground)
    for placed in section.placed:
        if not furniture.add(placed.kind, placed.at, math.radians(placed.yaw_deg), 0.4, 0.1):
            raise ValueError(
                f"props: {placed.kind!r} at {placed.at}: on the carriageway, in a building or off the ground"
            )
        furniture.reserve(furniture.spots[-1])
    add_at_approaches(furniture, "traffic_light", approaches(lanes, section.signalled), 0.6, 0.5)
    add_at_approaches(furniture, "give_way_sign", approaches(lanes, section.give_way, True), 0.7, 1.5)
    for row in section.rows:
        furniture.add_row(row, rng)
    if section.fences:
        pitched = {name for name, style in description.blocks.styles.items() if style.roof_form != "flat"}
        add_fences(furniture, lots, pitched)
    spaces = [shapely.Point(space.center).buffer(space.radius_m) for space in description.blocks.open_spaces]
    for space, area in zip(description.blocks.open_spaces, spaces, strict=True):
        add_trees(furniture, [area], space.trees, 3.0, rng)
    rest = [shapely.difference(block, shapely.union_all(spaces)) for block in blocks]
    add_trees(furniture, rest, section.scattered_trees, 4.5, rng)
    return _build(furniture.spots, ground, rng)


def _build(spots: Sequence[Spot], ground: Ground, rng: np.random.Generator) -> list[MeshPart]:
    """Return the meshes of all spots; the members of a row share one prop."""
    counts: Counter[str] = Counter()
    names: dict[tuple[str, int], str] = {}
    heights = ground.height(*np.array([spot.xy for spot in spots]).reshape(-1, 2).T)
    parts: dict[str, list[MeshPart]] = {}
    for number, (spot, z) in enumerate(zip(spots, heights, strict=True)):
        key = (spot.kind, spot.row if spot.row >= 0 else -1 - number)
        if key not in names:
            counts[spot.kind] += 1
            names[key] = f"{spot.kind}_{counts[spot.kind]:03d}"
        for part in build_prop(names[key], spot.kind, (*spot.xy, float(z)), spot.yaw, rng):
            parts.setdefault(part.path, []).append(part)
    return [
        replace(same[0], **merge(Mesh(part.points, part.faces) for part in same)._asdict())
        if len(same) > 1
        else same[0]
        for same in parts.values()
    ]
