"""Paved areas, car parks and street parking: surfaces cut exactly, bays as counted by hand, cars inside them."""

import math
from itertools import combinations

import numpy as np
import pytest
import shapely

from mmw.core.mesh import merge
from mmw.core.transforms import rotate
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.usd.vehicle_catalog import load_catalog
from mmw.worlds.towns import primitives as solids
from mmw.worlds.towns.description import Profile
from mmw.worlds.towns.ground_height import Ground
from mmw.worlds.towns.parking import LINE, Bay, block_of, choose_models, lay_out, line_area, park, street_bays
from mmw.worlds.towns.paved_areas import Region, area_regions, cut, pave
from mmw.worlds.towns.place_description import ParkingLot, PavedArea, StreetBays
from mmw.worlds.towns.plan_geometry import intersect_areas
from tests.fixtures.meshes import open_edges
from tests.fixtures.places_town import SLOPE, plan_area, plan_of_car, sheet

CATALOG = load_catalog()
AREAS = {
    "square": shapely.box(-33.3, -21.7, 14.2, 40.1),
    "on grid lines": shapely.box(-50.0, -50.0, 50.0, 50.0),
    "disc with a hole": shapely.Point(3, 4).buffer(38).difference(shapely.Point(9, 9).buffer(11)),
    "thin": shapely.box(-60.0, 1.0, 60.0, 1.1),
}


@pytest.mark.parametrize("name", AREAS)
def test_cut_keeps_the_surface_and_parts_it_along_the_border(name):
    part, area = sheet(bump=2.0), AREAS[name]
    within, rest = cut(part, area)
    assert plan_area(within) == pytest.approx(area.area, rel=1e-9)
    assert plan_area(rest) == pytest.approx(200.0**2 - area.area, rel=1e-9)
    assert within.areas.sum() + rest.areas.sum() == pytest.approx(part.mesh.areas.sum())
    ground = Ground([part])
    for mesh in (within, rest):
        assert mesh.normals[:, 2].min() > 0.5  # all faces up
        assert np.allclose(ground.height(*mesh.points[:, :2].T), mesh.points[:, 2], atol=1e-6)
    whole = solids.weld(merge([within, rest]))
    assert open_edges(whole) == open_edges(part.mesh)  # only the outer border is open


def test_pave_gives_every_point_one_surface():
    regions = [
        Region("Paving/a", AREAS["square"], "asphalt", "ground"),
        Region("Paving/b", AREAS["disc with a hole"], "concrete_sidewalk", "ground"),
    ]
    parts = pave([sheet()], regions)
    assert [part.path for part in parts] == ["Terrain/block_00", "Paving/a", "Paving/b"]
    assert [part.material for part in parts] == ["grass", "asphalt", "concrete_sidewalk"]
    assert sum(plan_area(part) for part in parts) == pytest.approx(200.0**2)
    second = AREAS["disc with a hole"].difference(AREAS["square"]).area
    assert [plan_area(part) for part in parts[1:]] == pytest.approx([AREAS["square"].area, second])


def test_paved_area_that_covers_nothing_or_crosses_itself_is_refused():
    far = PavedArea(name="far", outline=((500, 0), (510, 0), (510, 9)))
    with pytest.raises(ValueError, match=r"Paving/far: covers no terrain"):
        pave([sheet()], area_regions([far]))
    bow = PavedArea(name="bow", outline=((0, 0), (10, 10), (10, 0), (0, 10)))
    with pytest.raises(ValueError, match=r"paved 'bow': .*give the corners in order"):
        area_regions([bow])


def lot(**keys) -> ParkingLot:
    return ParkingLot.model_validate({"name": "lot", "at": [0, 0]} | keys)


def test_rows_fill_the_block_as_counted_by_hand():
    """Four rows of 5 m and an aisle of 6 m need 26 m; 53 m hold 21 bays of 2.5 m."""
    bays = lay_out(lot(rows=4), shapely.box(-16, -26.5, 16, 26.5))
    assert len(bays) == 4 * 21
    assert sorted({round(bay.center[0], 6) for bay in bays}) == [-10.5, -5.5, 5.5, 10.5]
    along = sorted({round(bay.center[1], 6) for bay in bays})
    assert along == pytest.approx(2.5 * (np.arange(21) - 10))
    towards = {round(bay.center[0], 1): round(math.cos(bay.yaw)) for bay in bays}
    assert towards == {-10.5: 1, -5.5: -1, 5.5: 1, 10.5: -1}  # two and two back to back


@pytest.mark.parametrize("yaw", [0.0, 0.4, 2.0])
def test_bays_lie_in_the_block_and_apart(yaw):
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    corners = np.array([[-30, -14], [24, -14], [30, -8], [30, 14], [-30, 14]]) @ turn.T + [7, -3]
    block = shapely.Polygon(corners)
    bays = lay_out(lot(rows=3, aisle_m=7), block)
    assert 3 * 24 - 4 <= len(bays) < 3 * 24  # the cut corner takes a few
    plans = np.array([bay.outline for bay in bays], object)
    assert shapely.area(plans) == pytest.approx(12.5)
    assert shapely.contains(block.buffer(0.01), plans).all()
    tree = shapely.STRtree(plans)
    first, second = tree.query(plans, predicate="intersects")
    overlap = shapely.area(intersect_areas(plans[first], plans[second]))
    assert overlap[first != second].max() < 1e-6


def test_lines_have_the_area_of_their_strips():
    block = shapely.box(-40, -20, 40, 20)
    bays = lay_out(lot(rows=4, bay=(2.6, 5.0)), block)
    count = len(bays) // 4
    assert count == 30
    pair = (count + 1) * 10.0 * LINE + (count * 2.6 + LINE) * LINE - (count + 1) * LINE**2
    assert line_area(bays, block).area == pytest.approx(2 * pair, rel=1e-6)
    # the front of a bay is open: no paint across it
    fronts = [bay.outline.centroid.coords[0] - 2.5 * np.array([math.cos(bay.yaw), math.sin(bay.yaw)]) for bay in bays]
    assert not shapely.intersects_xy(line_area(bays, block), *np.transpose(fronts)).any()


def test_rows_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"lots 'lot': 6 rows need 42\.0 m, the block is 32\.0 m deep"):
        lay_out(lot(rows=6), shapely.box(-50, -16, 50, 16))
    with pytest.raises(ValueError, match=r"no bay of 2\.5 x 5\.0 m fits"):
        lay_out(
            lot(rows=1), shapely.box(0, 0, 2.0, 30).union(shapely.box(28, 0, 30, 30)).convex_hull.boundary.buffer(1)
        )
    with pytest.raises(ValueError, match=r"lots 'lot': at = \(900\.0, 0\.0\): no block enclosed by roads"):
        block_of(lot(at=(900, 0)), [sheet()])


def test_parked_cars_stand_inside_their_bays_on_their_wheels():
    ground = Ground([sheet()])
    bays = lay_out(lot(rows=4), shapely.box(-16, -26.5, 16, 26.5))
    models = choose_models((), bays, CATALOG)
    assert {model.name for model in models} == {"hatchback", "sedan", "suv"}  # the others are longer than 5 m
    cars = park(bays, 0.7, models, ground, np.random.default_rng(3), True)
    assert len(cars) == round(0.7 * len(bays))
    plans, headings = [], []
    for car in cars:
        model = CATALOG[car.model]
        assert car.paint in model.paints
        wheels = [[x * model.wheelbase, y * model.track, 0.0] for x in (-0.5, 0.5) for y in (-0.5, 0.5)]
        world = rotate(car.pose[3:], np.array(wheels)) + car.pose[:3]
        assert np.allclose(world[:, 2], world[:, :2] @ SLOPE, atol=1e-5)
        plans.append(plan_of_car(car, model))
        headings.append(rotate(car.pose[3:], (1.0, 0.0, 0.0))[:2])
    owners = [next(bay for bay in bays if bay.outline.contains(plan.centroid)) for plan in plans]
    assert all(bay.outline.contains(plan) for bay, plan in zip(owners, plans, strict=True))
    assert len({bay.center for bay in owners}) == len(cars)
    assert min(a.distance(b) for a, b in combinations(plans, 2)) >= 0.03
    aims = [float(h @ [math.cos(bay.yaw), math.sin(bay.yaw)]) for h, bay in zip(headings, owners, strict=True)]
    assert np.abs(aims).min() > math.cos(math.radians(3))
    assert 0.1 < np.mean(np.array(aims) < 0) < 0.5  # some back in


def test_models_that_do_not_fit_a_bay_are_refused():
    bays = [Bay((0, 0), 0.0, 2.5, 5.0)]
    with pytest.raises(ValueError, match=r"'city_bus' is 12\.0 x 2\.55 m; it does not fit a bay of 5\.0 x 2\.5 m"):
        choose_models(("city_bus",), bays, CATALOG)
    with pytest.raises(ValueError, match=r"model 'tank'; models are"):
        choose_models(("tank",), bays, CATALOG)


PROFILE = Profile(lanes=1, width=3.5, shoulder=2.5)
LINES = {"main": np.column_stack([np.linspace(0, 100, 51), np.zeros((51, 2))])}
LANES = LaneGraph(
    {name: Lane(name, np.array([[0.0, y, 0.0], [100.0, y, 0.0]]), 3.5, 10.0) for name, y in (("f", -1.75), ("b", 1.75))}
)
CARRIAGEWAY = shapely.box(-20, -6, 120, 6)


def bays_along(profile: Profile = PROFILE, **keys) -> list[Bay]:
    section = StreetBays.model_validate({"along": "main", "from": 10, "to": 60} | keys)
    return street_bays(section, {"main": profile}, LINES, LANES, CARRIAGEWAY)


def test_street_bays_lie_on_the_shoulder_in_driving_direction():
    right, left = bays_along(), bays_along(side="left", length=10)
    assert len(right) == 8 and len(left) == 5  # 50 m hold 8 bays of 6.2 m
    for bay in (*right, *left):
        assert abs(bay.center[1]) - 1.0 > 3.5 + 0.1 and abs(bay.center[1]) + 1.0 < 6.0 - 0.1
    assert {round(math.cos(bay.yaw)) for bay in right} == {1} and {round(math.cos(bay.yaw)) for bay in left} == {-1}
    cars = park(right, 1.0, choose_models((), right, CATALOG), Ground([sheet()]), np.random.default_rng(0), False)
    assert all(rotate(car.pose[3:], (1.0, 0.0, 0.0))[0] > 0.99 for car in cars)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"along": "nowhere"}, "no such road; roads are: main"),
        ({"from": 3}, r"from 3\.0 to 60\.0 m; stations between 10\.0 and 90\.0 m"),
        ({"to": 95}, r"stations between 10\.0 and 90\.0 m"),
        ({"profile": Profile(shoulder=1.0)}, r"the shoulder is 1\.0 m wide; 2\.25 m are needed"),
    ],
)
def test_street_bays_that_cannot_be_are_refused(keys, message):
    with pytest.raises(ValueError, match=message):
        bays_along(**keys)
