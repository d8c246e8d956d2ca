"""Blocks and lots: building plans along every street front on the land between the road corridors."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from mmw.core.errors import InputError
from mmw.worlds.towns.block_description import BlockDescription, BuildingStyle, PlacedBuilding
from mmw.worlds.towns.buildings import Site
from mmw.worlds.towns.ground_height import Ground
from mmw.worlds.towns.plan_geometry import samples

SAMPLE_STEP = 2.0  # distance of the heights that are looked at under a building [m]
STEP = 2.0  # how far the search for the next lot moves along the street [m]
FLOOR_STEP = 0.15  # floor above the highest ground at the front [m]
MAX_BURIED = 1.5  # how far the ground behind a building may lie above its floor [m]
FOOT_DEPTH = 0.6  # foundation below the lowest ground [m]
MAX_TURN = math.radians(50)  # between the two ends of a front; more is a street corner [rad]
TOUCH = 0.02  # buildings placed by hand that are closer than this touch each other [m]
JOINT = 0.01  # how far the walls of a touching building are set back, so that no two lie in one plane [m]


@dataclass(frozen=True)
class Lot:
    """One building to be."""

    name: str
    style: str
    storeys: int
    site: Site
    is_joined: bool = False
    """Whether it shares an edge with another building."""

    @property
    def outline(self) -> shapely.Polygon:
        """Plan in the town frame."""
        return shapely.Polygon(self.site.ring)


def start_west(ring: shapely.LinearRing) -> shapely.LinearRing:
    """Return the ring begun at its westernmost vertex (to the centimeter; of several, the southernmost).

    The begin decides the place of the first lot or lamp, so it must not depend on the last bit of a coordinate.
    """
    corners = shapely.get_coordinates(ring)[:-1]
    rounded = np.round(corners, 2)
    first = int(np.lexsort((rounded[:, 1], rounded[:, 0]))[0])
    return shapely.LinearRing(np.roll(corners, -first, axis=0))


def find_blocks(corridor: shapely.Geometry, land: shapely.Polygon, reach: float) -> list[shapely.Polygon]:
    """Return the land beside the roads, one polygon a block, in a fixed order.

    Returns:
        Polygons, outer rings counter-clockwise, sorted from west to east, then south to north.
    """
    free = shapely.intersection(shapely.difference(shapely.buffer(corridor, reach), corridor), land)
    blocks = [orient(shapely.normalize(part)) for part in shapely.get_parts(free) if part.area > 50]
    return sorted(blocks, key=lambda block: tuple(np.round([block.centroid.x, block.centroid.y], 2)))


def heights_under(ground: Ground, outline: shapely.Polygon) -> np.ndarray:
    """Return heights of the ground [m] over a polygon and along its edge, shape [N]; NaN beside the ground."""
    return ground.height(*samples(outline, SAMPLE_STEP).T)


def _site(
    ground: Ground, center: Sequence[float], yaw: float, width: float, depth: float, most_fall: float
) -> Site | None:
    """Return a plan with its floor and foot, or None where the ground falls too much or ends."""
    center = (round(center[0], 2), round(center[1], 2))
    plan = Site(center, yaw, width, depth, 0.0, 0.0)
    heights = heights_under(ground, shapely.Polygon(plan.ring))
    if np.isnan(heights).any() or np.ptp(heights) > most_fall:
        return None
    around = heights_under(ground, shapely.Polygon(plan.paved))
    front = ground.height(*np.linspace(plan.ring[0], plan.ring[1], 5).T)
    floor = round(max(float(front.max()), float(heights.max()) - MAX_BURIED) + FLOOR_STEP, 2)
    return Site(center, yaw, width, depth, round(float(np.nanmin(around)) - FOOT_DEPTH, 2), floor)


class _Plots:
    """Plans placed so far, and whether another one fits."""

    def __init__(self, corridor: shapely.Geometry, occupied_plans: Sequence[shapely.Geometry]) -> None:
        self.corridor = corridor
        self.occupied_plans = np.array(list(occupied_plans), object)
        self.paved = np.array([], object)
        shapely.prepare(self.corridor)

    def add(self, site: Site) -> None:
        self.occupied_plans = np.append(self.occupied_plans, shapely.Polygon(site.ring))
        self.paved = np.append(self.paved, shapely.Polygon(site.paved))

    def fits(self, site: Site, block: shapely.Polygon, style: BuildingStyle) -> bool:
        outline, paved = shapely.Polygon(site.ring), shapely.Polygon(site.paved)
        keep = min(style.setback_m, 3.0) - 0.2
        if not shapely.contains_properly(block, outline) or shapely.dwithin(self.corridor, outline, keep):
            return False
        if shapely.dwithin(self.paved, paved, 0.2).any():
            return False
        return not shapely.dwithin(self.occupied_plans, outline, style.gap_m - 1e-6).any()


def _front(ring: shapely.LinearRing, start: float, width: float) -> tuple[np.ndarray, float, np.ndarray]:
    """Return the chord of `width` along a ring: its middle [2], direction [rad] and the normal to its left [2]."""
    ends = shapely.get_coordinates(shapely.line_interpolate_point(ring, [start, start + width]))
    along = ends[1] - ends[0]
    along /= np.linalg.norm(along)
    return ends.mean(axis=0), math.atan2(along[1], along[0]), np.array([-along[1], along[0]])


def _turn(ring: shapely.LinearRing, start: float, width: float) -> float:
    """Return how much a ring turns between the ends of a front [rad], without sign."""
    stations = np.array([start, start + 0.1, start + width - 0.1, start + width])
    a, b, c, d = shapely.get_coordinates(shapely.line_interpolate_point(ring, stations))
    first, last = complex(*(b - a)), complex(*(d - c))
    return abs(float(np.angle(last * first.conjugate())))


def _try_lot(
    ring: shapely.LinearRing,
    station: float,
    style: BuildingStyle,
    size: tuple[float, float],
    block: shapely.Polygon,
    plots: _Plots,
    ground: Ground,
    most_fall: float,
) -> Site | None:
    """Return a plan at a station of a street front, moved back and made shallower until it fits."""
    width, depth = size
    if station + width > ring.length or _turn(ring, station, width) > MAX_TURN:
        return None
    middle, yaw, inward = _front(ring, station, width)
    for back, shallow in ((0.0, 1.0), (0.0, 0.75), (2.0, 1.0), (2.0, 0.75), (5.0, 0.75)):
        less = max(style.depth_m[0], round(depth * shallow, 1))
        center = middle + inward * (style.setback_m + back + 0.5 * less)
        if plots.fits(Site((center[0], center[1]), yaw, width, less, 0.0, 0.0), block, style):
            site = _site(ground, center, yaw, width, less, most_fall)
            if site is not None:
                return site
    return None


def place_by_hand(buildings: Sequence[PlacedBuilding], corridor: shapely.Geometry, ground: Ground) -> list[Lot]:
    """Return the buildings that the author put in certain places.

    They may share edges: then the walls of both are set back by a joint of 1 cm.

    Raises:
        InputError: If one reaches into a road, off the ground or into another one.
    """
    lots: list[Lot] = []
    for placed in buildings:
        site = _site(ground, placed.center, math.radians(placed.yaw_deg + 90), *placed.size_m, np.inf)
        if site is None or shapely.intersects(corridor, shapely.Polygon(site.ring)):
            raise InputError(f"building {placed.name!r} at {placed.center}: on a road or off the ground; move it")
        lots.append(Lot(placed.name, placed.style, placed.storeys, site))
    plans = np.array([lot.outline for lot in lots], object)
    for k, lot in enumerate(lots):
        near = np.flatnonzero(shapely.dwithin(plans, plans[k], TOUCH))
        inner = shapely.buffer(plans[k], -TOUCH, join_style="mitre")
        for other in near[(near != k) & shapely.intersects(plans[near], inner)]:
            raise InputError(
                f"buildings {lot.name!r} and {lots[other].name!r} overlap; edge to edge is allowed; move one"
            )
        if len(near) > 1:
            width, depth = lot.site.width - 2 * JOINT, lot.site.depth - 2 * JOINT
            lots[k] = replace(lot, site=replace(lot.site, width=width, depth=depth), is_joined=True)
    return lots


def forecourt_bounds(lot: Lot, by_hand: Sequence[Lot], areas: Sequence[shapely.Geometry]) -> list[shapely.Geometry]:
    """Return what the paving around a building placed by hand must not cover: roads, paving, neighbors.

    Args:
        lot: The building; one along a street has room for its paving, and the result is empty.
        by_hand: All buildings placed by hand, in order.
        areas: Roads with their walks, car parks and other paved areas.
    """
    if lot not in by_hand:
        return []
    paved = shapely.Polygon(lot.site.paved)
    before = by_hand[: by_hand.index(lot)]
    others = [shapely.Polygon(other.site.paved) for other in before]
    others += [other.outline for other in by_hand if other is not lot]
    near = [area for area in (*areas, *others) if shapely.dwithin(area, paved, JOINT)]
    return [shapely.buffer(area, JOINT, join_style="mitre") for area in near]


def place_lots(
    description: BlockDescription,
    corridor: shapely.Geometry,
    land: shapely.Polygon,
    ground: Ground,
    reserved_areas: Sequence[shapely.Geometry] = (),
) -> tuple[list[Lot], list[shapely.Polygon]]:
    """Return the buildings of a town: those placed by hand, then those along the streets.

    Returns:
        The lots, and the blocks that they are on.

    Raises:
        InputError: If a hand-placed building reaches into a road, off the ground or into another one.
    """
    blocks_section, styles = description.blocks, description.blocks.styles
    blocks = find_blocks(corridor, shapely.buffer(land, -4.0), blocks_section.reach_m)
    open_spaces = [shapely.Point(s.center).buffer(s.radius_m) for s in blocks_section.open_spaces]
    plots = _Plots(corridor, [*reserved_areas, *open_spaces])
    lots = place_by_hand(description.buildings, corridor, ground)
    for lot in lots:
        plots.add(lot.site)
    rng = np.random.default_rng(blocks_section.seed)
    for block in blocks:
        for ring in map(start_west, (block.exterior, *block.interiors)):
            for site, style, storeys in _along(ring, block, description, plots, ground, rng):
                lots.append(Lot(f"b_{len(lots) + 1:03d}", style, storeys, site))
    unknown = [lot.style for lot in lots if lot.style not in styles]
    if unknown:
        raise InputError(f"buildings: style {unknown[0]!r} is unknown; styles are: {', '.join(sorted(styles))}")
    return lots, blocks


def _along(
    ring: shapely.LinearRing,
    block: shapely.Polygon,
    description: BlockDescription,
    plots: _Plots,
    ground: Ground,
    rng: np.random.Generator,
) -> Iterator[tuple[Site, str, int]]:
    """Yield (site, style name, storeys) of one building after the other along one ring of a block."""
    section = description.blocks
    station = 0.0
    while station < ring.length:
        here = shapely.get_coordinates(ring.interpolate(station))[0]
        holding = (district for district in section.districts if math.dist(district.center, here) <= district.radius_m)
        district = next(holding, None)
        near_road = shapely.dwithin(plots.corridor, shapely.Point(here), 0.5)
        if district is None or not near_road:
            station += STEP
            continue
        names = sorted(district.styles)
        weights = np.array([district.styles[name] for name in names])
        name = names[int(rng.choice(len(names), p=weights / weights.sum()))]
        style = section.styles[name]
        width = round(rng.uniform(*style.front_m), 1)
        depth = round(rng.uniform(*style.depth_m), 1)
        storeys = int(rng.integers(style.storeys[0], style.storeys[1] + 1))
        built = rng.random() < district.coverage
        site = None
        for front in (width, style.front_m[0]):
            site = _try_lot(ring, station, style, (front, depth), block, plots, ground, section.most_fall_m)
            if site is not None:
                break
        if site is None:
            station += STEP
            continue
        if built:
            plots.add(site)
            yield site, name, storeys
        station += site.width + style.gap_m
