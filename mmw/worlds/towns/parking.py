"""Car parks and street parking: where the bays and their lines lie, and which cars stand in them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.core.transforms import quaternion_from_matrix
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.usd.vehicle_catalog import VehicleModel
from mmw.worlds.towns.description import Profile, TownDescription
from mmw.worlds.towns.ground_height import Ground
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.network import RoadNetwork
from mmw.worlds.towns.parked_prims import ParkedCar
from mmw.worlds.towns.paved_areas import Region, outline_of
from mmw.worlds.towns.place_description import ParkingLot, StreetBays
from mmw.worlds.towns.plan_geometry import rectangle_at, rotation

LINE = 0.10
"""Width of a painted line between two bays [m]; design value."""
BORDER = 0.05
"""Least distance of a line from the border of the block, so that the border keeps its vertices [m]."""
MARGIN = 0.02
"""Least distance of a parked car's box from the border of its bay [m]."""
SIDEWAYS, LENGTHWAYS, TURN = 0.12, 0.15, math.radians(1.5)
"""Largest deviations of a parked car from the middle of its bay [m], [m], and from its direction [rad]."""
REVERSED = 0.3
"""Part of the cars that back into a bay (fraction); design value."""
FROM_JUNCTION = 10.0
"""Least distance of street bays from a junction [m]: clear of zebra crossings and stop lines, beyond the 5 m before
corners that most road laws ask for; design value."""
KERB_GAP, LANE_GAP = 0.15, 0.1
"""Least distances of a street bay from the kerb and from the nearest lane [m]; design values."""
STREET_WIDTH = 2.0
"""Width of a bay along a kerb [m]."""


@dataclass(frozen=True)
class Bay:
    """A place for one car."""

    center: tuple[float, float]
    yaw: float
    """Direction of a car that drives in forwards, counter-clockwise from east [rad]."""
    width: float
    depth: float

    @property
    def outline(self) -> shapely.Polygon:
        """Plan in the town frame."""
        return rectangle_at(self.center, self.yaw, self.depth, self.width)


@dataclass(frozen=True)
class Parking:
    """Every bay of a town."""

    groups: tuple[tuple[ParkingLot | StreetBays, tuple[Bay, ...]], ...]
    """A section of the description and its bays; first the lots, then the bays along kerbs."""
    blocks: tuple[shapely.Polygon, ...]
    """Plans of the lots."""
    regions: tuple[Region, ...]
    """Surfaces and lines of the lots."""

    @property
    def bays(self) -> list[Bay]:
        """All bays, in order."""
        return [bay for _, bays in self.groups for bay in bays]


def block_of(lot: ParkingLot, terrain: Sequence[MeshPart]) -> shapely.Polygon:
    """Return the plan of the block of terrain that a car park is to fill.

    Raises:
        InputError: If no block enclosed by roads lies at `at`.
    """
    for part in terrain:
        if part.path.startswith("Terrain/block_"):
            plan = outline_of(part)
            if isinstance(plan, shapely.Polygon) and shapely.contains_xy(plan, *lot.at):
                return plan
    raise InputError(
        f"lots {lot.name!r}: at = {lot.at}: no block enclosed by roads; give a point between the aisle roads"
    )


def lay_out(lot: ParkingLot, block: shapely.Polygon) -> list[Bay]:
    """Return the bays of a car park, row by row.

    Rows stand back to back in pairs, aisles between the pairs, all of it in the middle of the block. A row has as many
    bays as fit between its ends; where the block is not a rectangle, bays that reach beyond it are left out.

    Raises:
        InputError: If the rows are deeper than the block, or no bay fits.
    """
    if not lot.rows:
        return []
    yaw = _long_side(block) if lot.yaw_deg is None else math.radians(lot.yaw_deg)
    turn = rotation(-yaw)  # town to rows
    low, high = (f(shapely.get_coordinates(block) @ turn.T, axis=0) for f in (np.min, np.max))
    width, depth = lot.bay
    pairs = (lot.rows + 1) // 2
    needed = lot.rows * depth + (pairs - 1) * lot.aisle_m
    if needed > high[1] - low[1] + 1e-3:
        raise InputError(
            f"lots {lot.name!r}: {lot.rows} rows need {needed:.1f} m, the block is {high[1] - low[1]:.1f} m deep; take "
            "fewer rows, shallower bays or a narrower aisle, or move the roads apart"
        )
    count = int((high[0] - low[0] + 1e-3) / width)
    first = 0.5 * (low[0] + high[0]) - 0.5 * count * width
    bottom = 0.5 * (low[1] + high[1]) - 0.5 * needed
    room = shapely.buffer(block, 1e-3, join_style="mitre")
    bays = []
    for row in range(lot.rows):
        v = bottom + row * depth + (row // 2) * lot.aisle_m + 0.5 * depth
        is_upper = row % 2 == 1  # its back is towards the row before it
        for k in range(count):
            center = np.array([first + (k + 0.5) * width, v]) @ turn
            bay = Bay((float(center[0]), float(center[1])), yaw + (-0.5 if is_upper else 0.5) * math.pi, width, depth)
            if shapely.contains(room, bay.outline):
                bays.append(bay)
    if not bays:
        raise InputError(f"lots {lot.name!r}: no bay of {width} x {depth} m fits the block; make it wider")
    return bays


def _long_side(block: shapely.Polygon) -> float:
    """Return the direction of the longer side of the smallest rectangle about a polygon, 0 to pi [rad]."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(block))
    sides = np.diff(corners, axis=0)[:2]
    x, y = sides[int(np.argmax(np.round(np.linalg.norm(sides, axis=1), 3)))]
    return round(math.atan2(y, x) % math.pi, 9) % math.pi


def line_area(bays: Sequence[Bay], block: shapely.Polygon) -> shapely.Geometry:
    """Return the plan of the painted lines: beside every bay and across its end, none where cars drive in."""
    strips = []
    for bay in bays:
        along, side = rotation(bay.yaw).T
        middle = np.asarray(bay.center)
        for sign in (-0.5, 0.5):
            strips.append(rectangle_at(middle + side * sign * bay.width, bay.yaw, bay.depth, LINE))
        strips.append(rectangle_at(middle + along * 0.5 * bay.depth, bay.yaw, LINE, bay.width + LINE))
    joined = shapely.union_all(shapely.set_precision(strips, 1e-4))
    return shapely.normalize(shapely.intersection(joined, shapely.buffer(block, -BORDER, join_style="mitre")))


def lot_regions(lot: ParkingLot, block: shapely.Polygon, bays: Sequence[Bay]) -> list[Region]:
    """Return lines and surface of a car park.

    Both are `ground`: CARLA's class of areas that vehicles and pedestrians share. `road` and `road_line` make the
    surface that traffic drives on, which stays exactly the road network.
    """
    surface = Region(f"Parking/{lot.name}/surface", shapely.buffer(block, 1.0), lot.material, "ground")
    if not bays:
        return [surface]
    return [Region(f"Parking/{lot.name}/lines", line_area(bays, block), "road_marking", "ground"), surface]


def street_bays(
    section: StreetBays,
    profiles: Mapping[str, Profile],
    lines: Mapping[str, np.ndarray],
    lanes: LaneGraph,
    carriageway: shapely.Geometry,
) -> list[Bay]:
    """Return bays on the shoulder of a road, in driving direction.

    Args:
        section: Road, side and stations.
        profiles: Road -> its cross-section.
        lines: Road -> its reference line between the junctions [m], [N, 3].
        lanes: Lanes that the bays keep clear of.
        carriageway: Drivable area, which holds the bays.

    Raises:
        InputError: If the road does not exist, is too short, or its shoulder is too narrow.
    """
    where = f"bays along {section.along!r}"
    if section.along not in lines or section.along not in profiles:
        raise InputError(f"{where}: no such road; roads are: {', '.join(sorted(profiles))}; name one of them")
    profile, line = profiles[section.along], lines[section.along][:, :2]
    least = STREET_WIDTH + KERB_GAP + LANE_GAP
    if profile.shoulder < least:
        raise InputError(
            f"{where}: the shoulder is {profile.shoulder} m wide; {least} m are needed; widen it in the profile"
        )
    path = shapely.LineString(line)
    last = path.length - FROM_JUNCTION
    if not FROM_JUNCTION <= section.start <= section.end - section.length + 1e-6 or section.end > last:
        raise InputError(
            f"{where}: from {section.start} to {section.end} m; stations between {FROM_JUNCTION} and "
            f"{last:.1f} m, at least one bay of {section.length} m apart, are needed"
        )
    paved = profile.lanes * profile.width * (1 if profile.oneway else 2) + (0 if profile.oneway else profile.centre)
    sign = 1.0 if section.side == "left" else -1.0
    offset = sign * (0.5 * paved + profile.shoulder - KERB_GAP - 0.5 * STREET_WIDTH)
    driven = [
        shapely.LineString(lane.points[:, :2]).buffer(0.5 * lane.width)
        for lane in lanes.lanes.values()
        if shapely.dwithin(shapely.LineString(lane.points[:, :2]), path, 30.0)
    ]
    bays = []
    for k in range(int((section.end - section.start + 1e-6) / section.length)):
        ends = section.start + section.length * np.array([k, k + 1])
        a, b = shapely.get_coordinates(shapely.line_interpolate_point(path, ends))
        yaw = math.atan2(b[1] - a[1], b[0] - a[0])
        center = 0.5 * (a + b) + offset * np.array([-math.sin(yaw), math.cos(yaw)])
        if section.side == "left" and not profile.oneway:
            yaw += math.pi
        bay = Bay((float(center[0]), float(center[1])), yaw, STREET_WIDTH, section.length)
        inner = shapely.buffer(bay.outline, -0.5 * LANE_GAP, join_style="mitre")
        if not shapely.contains(carriageway, inner) or shapely.intersects(inner, driven).any():
            raise InputError(
                f"{where}: the bay at station {ends[0]:.1f} m reaches into a lane or over the kerb; move `from` or `to`"
            )
        bays.append(bay)
    return bays


def choose_models(names: Sequence[str], bays: Sequence[Bay], catalog: Mapping[str, VehicleModel]) -> list[VehicleModel]:
    """Return the models to draw from.

    Args:
        names: Models that the town asks for; all cars that fit if empty.
        bays: Bays, all of one size.
        catalog: Model name -> model.

    Raises:
        InputError: If a name is unknown, or a model does not fit.
    """

    def fits(model: VehicleModel) -> bool:
        return model.length <= bays[0].depth - 0.2 and model.width <= bays[0].width - 0.1

    for name in names:
        if name not in catalog:
            raise InputError(f"parked vehicles: model {name!r}; models are: {', '.join(catalog)}; name one of them")
        if not fits(catalog[name]):
            model = catalog[name]
            raise InputError(
                f"parked vehicles: model {name!r} is {model.length} x {model.width} m; it does not fit a bay of "
                f"{bays[0].depth} x {bays[0].width} m; make the bays larger or leave the model out"
            )
    found = [catalog[name] for name in names] or [m for m in catalog.values() if m.label == "car" and fits(m)]
    if not found:
        raise InputError(f"parked vehicles: no car fits a bay of {bays[0].depth} x {bays[0].width} m; make it larger")
    return found


def park(
    bays: Sequence[Bay],
    occupied: float,
    models: Sequence[VehicleModel],
    ground: Ground,
    rng: np.random.Generator,
    both_ways: bool,
) -> list[ParkedCar]:
    """Return cars in the share `occupied` of the bays, each inside its bay on all wheels; names are empty."""
    occupied_plans = np.sort(rng.permutation(len(bays))[: round(occupied * len(bays))])
    cars = []
    for k in occupied_plans:
        bay, model = bays[int(k)], models[int(rng.integers(len(models)))]
        paint = model.paints[int(rng.integers(len(model.paints)))]
        deviation = rng.uniform(-1.0, 1.0, 3)
        backs_in = rng.random() < REVERSED and both_ways
        most_turn = min(TURN, 0.5 * (bay.width - model.width - 2 * MARGIN) / model.length)
        turn = deviation[2] * most_turn
        across = model.width * math.cos(turn) + model.length * abs(math.sin(turn))
        deep = model.length * math.cos(turn) + model.width * abs(math.sin(turn))
        room = 0.5 * np.array([bay.depth - deep, bay.width - across]) - MARGIN
        offset = deviation[:2] * np.clip(room, 0.0, [LENGTHWAYS, SIDEWAYS])
        yaw = bay.yaw + turn + (math.pi if backs_in else 0.0)
        heading = rotation(yaw)
        origin = np.asarray(bay.center) + rotation(bay.yaw) @ offset - heading @ np.array(model.center[:2])
        cars.append(ParkedCar("", model.name, paint, _pose_on_ground(model, origin, heading, ground)))
    return cars


def _pose_on_ground(model: VehicleModel, origin: np.ndarray, heading: np.ndarray, ground: Ground) -> np.ndarray:
    """Return the pose of a car whose wheels touch the ground: the plane nearest to the four heights, shape [7]."""
    wheels = 0.5 * np.array([[x * model.wheelbase, y * model.track] for x in (-1, 1) for y in (-1, 1)])
    z = ground.height(*(origin + wheels @ heading.T).T)
    if np.isnan(z).any():
        raise InputError(f"parked vehicles: no ground at ({origin[0]:.1f}, {origin[1]:.1f}); move the bay")
    (slope_x, slope_y, height), *_ = np.linalg.lstsq(np.column_stack([wheels, np.ones(4)]), z, rcond=None)
    x = np.array([*heading[:, 0], slope_x])
    y = np.array([*heading[:, 1], slope_y])
    x /= np.linalg.norm(x)
    up = np.cross(x, y)
    up /= np.linalg.norm(up)
    rotation = np.column_stack([x, np.cross(up, x), up])
    return np.round(np.concatenate([origin, [height], quaternion_from_matrix(rotation)]), 9)


def find_parking(description: TownDescription, network: RoadNetwork) -> Parking:
    """Return the bays of sections `lots` and `bays`.

    Raises:
        InputError: If a lot or a row of bays cannot be where it is described.
    """
    groups: list[tuple[ParkingLot | StreetBays, tuple[Bay, ...]]] = []
    blocks, regions = [], []
    for lot in description.lots:
        block = block_of(lot, network.terrain)
        bays = lay_out(lot, block)
        groups.append((lot, tuple(bays)))
        blocks.append(block)
        regions += lot_regions(lot, block, bays)
    profiles = {road.id: description.profiles[road.profile] for road in description.roads}
    for section in description.bays:
        bays = street_bays(section, profiles, network.centre_lines, network.lanes, network.carriageway)
        groups.append((section, tuple(bays)))
    return Parking(tuple(groups), tuple(blocks), tuple(regions))


def park_all(parking: Parking, catalog: Mapping[str, VehicleModel], ground: Ground) -> list[ParkedCar]:
    """Return the parked cars of a town, named p_001, p_002, ... in the order of the sections and their bays.

    Raises:
        InputError: If a model is unknown or fits no bay.
    """
    cars: list[ParkedCar] = []
    for section, bays in parking.groups:
        if bays and section.occupied:
            models = choose_models(section.models, bays, catalog)
            rng = np.random.default_rng([section.seed, 3])
            cars += park(bays, section.occupied, models, ground, rng, isinstance(section, ParkingLot))
    return [replace(car, name=f"p_{number:03d}") for number, car in enumerate(cars, 1)]
