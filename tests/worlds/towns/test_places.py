"""Placed and varied buildings, the gas station, farms, and a town with one of every place."""

import math
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from pxr import Usd

from mmw.core.mesh import merge
from mmw.core.transforms import make_pose, quaternion_from_ypr, rotate
from mmw.scene.reader import read_stage
from mmw.scene.stage.compose import compose_scenario
from mmw.sensors.ground_truth.boxes_3d import make_boxes
from mmw.traffic.demand import VehicleTrack
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.roads.town_asset import open_town
from mmw.usd.material_library import PAINTS
from mmw.usd.validate import validate_stage
from mmw.usd.vehicle_catalog import load_catalog
from mmw.worlds.towns.block_description import BlockDescription, BuildingStyle
from mmw.worlds.towns.blocks import forecourt_bounds, place_by_hand
from mmw.worlds.towns.build import build_town, town_parts
from mmw.worlds.towns.building_footprints import CUT, NOTCH, Plan
from mmw.worlds.towns.buildings import Site, build_building
from mmw.worlds.towns.description import TownDescription
from mmw.worlds.towns.facades import GLASS, facade_cells
from mmw.worlds.towns.gas_station import CLEAR, DRIVEWAY
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.prop_placement import place_props
from mmw.worlds.towns.props import build_prop
from tests.fixtures.meshes import area, by_name, open_edges, volume
from tests.fixtures.places_town import LEVEL, PLACES, plan_area, plan_of_car

CATALOG = load_catalog()


def placed(*buildings: dict) -> BlockDescription:
    each = [{"name": f"b{k}", "style": "plain", "size_m": [20, 12]} | building for k, building in enumerate(buildings)]
    return BlockDescription.model_validate({"blocks": {"styles": {"plain": {}}}, "buildings": each})


def test_buildings_may_share_an_edge_but_not_ground():
    free = shapely.box(500, 500, 510, 510)
    joined = placed({"center": [0, 0]}, {"center": [0, 20]}, {"center": [12, 10]})  # the front is 20 m along y
    lots = place_by_hand(joined.buildings, free, LEVEL)
    plans = [lot.outline for lot in lots]
    assert [plan.area for plan in plans] == pytest.approx(3 * [19.98 * 11.98])
    assert plans[0].distance(plans[1]) == pytest.approx(0.02)
    paved = []
    for lot in lots:
        style = joined.blocks.styles["plain"]
        parts = build_building(
            lot.name, style, lot.site, 3, np.random.default_rng(0), forecourt_bounds(lot, lots, [free]), lot.is_joined
        )
        points = by_name(parts)["forecourt"].points
        faces = by_name(parts)["forecourt"].faces
        rings = shapely.polygons(points[faces][:, :, :2])
        paved.append(shapely.union_all(rings[shapely.area(rings) > 1e-9]))
    for a, b in combinations(paved, 2):
        assert a.intersection(b).area < 1e-6
    outside = shapely.union_all([shapely.Polygon(lot.site.paved) for lot in lots]).difference(shapely.union_all(plans))
    assert outside.difference(shapely.union_all(paved)).area < 0.02 * outside.area
    with pytest.raises(ValueError, match="buildings 'b0' and 'b1' overlap; edge to edge is allowed"):
        place_by_hand(placed({"center": [0, 0]}, {"center": [0, 19.9]}).buildings, free, LEVEL)
    apart = place_by_hand(placed({"center": [0, 0]}, {"center": [0, 30]}).buildings, free, LEVEL)
    assert [lot.outline.area for lot in apart] == pytest.approx([240, 240])


@pytest.mark.parametrize("mirrored", [False, True])
def test_plans_have_the_areas_of_their_forms(mirrored):
    w, d = 24.0, 18.0
    wanted = {
        "rectangle": w * d,
        "l_shape": w * d * (1 - NOTCH[0] * NOTCH[1]),
        "corner_cut": w * d - 0.5 * (CUT[0] * d) ** 2,
    }
    for form, expected in wanted.items():
        plan = Plan(form, w, d, mirrored)
        ring = shapely.Polygon(plan.ring())
        assert ring.area == pytest.approx(expected) and shapely.is_ccw(ring.exterior)
        assert plan.ring()[0, 1] == plan.ring()[1, 1] == -9.0  # the first edge is the front
        inner = shapely.Polygon(plan.ring(0.5))
        assert inner.area == pytest.approx(shapely.buffer(ring, -0.5, join_style="mitre").area)
        assert shapely.hausdorff_distance(inner, shapely.buffer(ring, -0.5, join_style="mitre")) < 1e-9


@pytest.mark.parametrize("form", ["rectangle", "l_shape", "corner_cut"])
@pytest.mark.parametrize("windows", ["ribbon", "curtain"])
@pytest.mark.parametrize("podium", [0, 2])
def test_walls_have_the_area_of_their_perimeter_and_parapets_of_their_top(form, windows, podium):
    mullion = 0.1 if windows == "curtain" else 0.0
    style = BuildingStyle(plans=(form,), windows=windows, mullion_m=mullion, podium_storeys=podium, plant_room=True)
    meshes = by_name(build_building("b", style, Site((9, 9), 0.3, 24, 18, -1, 0), 6, np.random.default_rng(1)))
    walls = merge([meshes["facade"], meshes["glass"], meshes["door"]])
    outward = np.abs(walls.normals[:, 2]) < 1e-9
    blocks = [(Plan(form, 24, 18), 1.0 + style.ground_storey_m + 5 * style.storey_m)]  # plan, and walls to the ceiling
    if podium:
        blocks = [(Plan(form, 24, 18), 1.0 + style.ground_storey_m + style.storey_m)]
        blocks += [(Plan(form, 0.72 * 24, 0.72 * 18), 4 * style.storey_m + 0.3)]
    wanted = top = 0.0
    for plan, height in blocks:
        outer, inner = (shapely.Polygon(plan.ring(inset)) for inset in (0.0, 0.3))
        wanted += outer.length * (height + 0.9) + inner.length * 0.9  # the inner side of the parapet too
        top += outer.area - inner.area
    assert area(walls.select(outward)) == pytest.approx(wanted, rel=1e-9)
    assert area(walls.select(~outward)) == pytest.approx(top, rel=1e-9)


def test_curtain_wall_with_mullions_has_exact_glass():
    style = BuildingStyle(windows="curtain", mullion_m=0.1, bay_m=3.0, sill_m=0.3, head_m=0.3)
    across, heights, kinds = facade_cells(style, 24.0, 4, -1.0, 0.0, 0.9, False, False)
    glass = (kinds == GLASS) * np.outer(np.diff(heights), np.diff(across) * 24.0)
    bays = 8
    assert glass.sum() == pytest.approx(4 * (3.4 - 0.6) * (24.0 - 0.8 - (bays - 1) * 0.1))
    assert np.count_nonzero(glass.any(axis=0)) == bays


def test_shop_front_is_glass_from_pier_to_pier_and_has_an_awning():
    style = BuildingStyle(shop_front=True, balconies=True, window_fraction=0.4)
    plain = BuildingStyle(window_fraction=0.4)
    site = Site((0, 0), 0.0, 24, 16, -1, 0)
    ours, theirs = (by_name(build_building("b", s, site, 4, np.random.default_rng(0))) for s in (style, plain))
    assert area(ours["glass"]) > area(theirs["glass"]) + 20
    assert open_edges(ours["awning"]) == 0 and volume(ours["awning"]) > 0
    assert ours["awning"].points[:, 1].min() == pytest.approx(-8 - 1.3)
    assert open_edges(ours["sign"]) == 0 and ours["structure"].points[:, 1].min() == pytest.approx(-8 - 1.3)
    lowest = ours["awning"].points[:, 2].min()
    assert 2.2 < lowest < 4.2


@pytest.mark.parametrize(
    "keys", [{"roof_form": "hip", "plans": ["l_shape"]}, {"mullion_m": 0.1}, {"windows": "ribbon", "balconies": True}]
)
def test_styles_that_do_not_fit_together_are_refused(keys):
    with pytest.raises(ValueError, match=r"only a flat roof|only a curtain wall|balconies belong"):
        BuildingStyle.model_validate(keys)


def describe(**props) -> BlockDescription:
    return BlockDescription.model_validate({"props": props})


def drive(half: float) -> shapely.Polygon:
    return shapely.box(-90, -half, 90, half)


def test_canopy_stands_over_a_driveway_with_its_feet_beside_it():
    canopy = {"kind": "gas_canopy", "at": [0, 0], "yaw_deg": 90}
    parts = place_props(describe(placed=[canopy]), drive(2.6), LaneGraph(), [], [], LEVEL)
    meshes = {part.path.split("/")[-1]: part for part in parts}
    assert meshes["canopy"].points[:, 2].min() == pytest.approx(CLEAR)
    for name in ("columns", "islands", "pumps", "displays"):
        assert np.abs(meshes[name].points[:, 1]).min() >= 0.5 * DRIVEWAY - 1e-3, name
    assert drive(2.6).intersects(shapely.MultiPoint(meshes["canopy"].points[:, :2]).convex_hull)
    with pytest.raises(ValueError, match=r"'gas_canopy' at \(0\.0, 0\.0\): on the carriageway"):
        place_props(describe(placed=[canopy]), drive(3.2), LaneGraph(), [], [], LEVEL)
    with pytest.raises(ValueError, match=r"'gas_shop' at \(4\.0, 44\.0\): in a building, a bay or another prop"):
        apart = [canopy | {"at": [0, 40]}, {"kind": "gas_shop", "at": [4, 44]}]
        place_props(describe(placed=apart), drive(0.1), LaneGraph(), [], [], LEVEL)


def test_silos_have_the_size_of_silos():
    heights = []
    for seed in range(8):
        parts = by_name(build_prop("s", "silo", (0, 0, 0), 0.0, np.random.default_rng(seed)))
        reach = np.linalg.norm(parts["wall"].points[:, :2], axis=1)
        assert reach.max() == pytest.approx(3.0)
        heights.append(parts["wall"].points[:, 2].max())
    assert 12 <= min(heights) < max(heights) <= 16


def test_panels_of_a_line_stand_end_to_end_with_gaps_at_roads():
    line = {"kind": "field_fence", "points": [[-40, -30], [-40, 30], [20, 30]]}
    parts = place_props(describe(lines=[line]), drive(3.0), LaneGraph(), [], [], LEVEL)
    assert {part.path.split("/")[1] for part in parts} == {"field_fence_001"}
    points = np.concatenate([part.points for part in parts])
    rails = next(part for part in parts if part.path.endswith("rails"))
    assert len(rails.faces) == 12 * 2 * (10 - 2 + 9)  # two of ten panels would stand on the road; nine fit the corner
    assert np.abs(points[:, 1]).min() >= 3.0
    on_line = shapely.dwithin(shapely.LineString(line["points"]), shapely.points(points[:, :2]), 0.1)
    assert on_line.all()


def test_rows_keep_to_their_roads():
    roads = {"main": np.array([[-90.0, 0, 0], [90, 0, 0]]), "side": np.array([[0.0, -90, 0], [0, 90, 0]])}
    area = shapely.union(drive(3.0), shapely.box(-3, -90, 3, 90))
    row = {"kind": "bench", "every_m": 10, "offset_m": 2.0, "along": ["s*"]}
    parts = place_props(describe(rows=[row]), area, LaneGraph(), [], [], LEVEL, roads=roads)
    middles = np.array([part.points[:, :2].mean(axis=0) for part in parts])
    assert len(middles) > 20 and (np.abs(middles[:, 0]) < np.abs(middles[:, 1])).all()


@pytest.fixture(scope="module")
def town() -> TownDescription:
    return TownDescription.model_validate(yaml.safe_load(PLACES))


@pytest.fixture(scope="module")
def built(town):
    return town_parts(town)


def solid_plan(parts: list[MeshPart], below: float = math.inf) -> shapely.Geometry:
    corners = np.concatenate([part.points[part.faces] for part in parts])
    faces = shapely.polygons(corners[corners[:, :, 2].min(axis=1) < below][:, :, :2])
    return shapely.union_all(shapely.buffer(faces[shapely.area(faces) > 1e-6], 0.0))


def groups(parts: list[MeshPart], group: str) -> dict[str, list[MeshPart]]:
    found: dict[str, list[MeshPart]] = {}
    for part in parts:
        if part.path.startswith(f"{group}/"):
            found.setdefault(part.path.split("/")[1], []).append(part)
    return found


def test_nothing_in_the_town_of_places_overlaps(built):
    houses = {
        name: solid_plan([part for part in parts if not part.path.endswith("forecourt")])
        for name, parts in groups(built.meshes, "Buildings").items()
    }
    bridges = {name: solid_plan(parts) for name, parts in groups(built.meshes, "Skybridges").items()}
    assert len(houses) > 15 and len(bridges) == 2
    for (a, first), (b, second) in combinations(houses.items(), 2):
        assert first.intersection(second).area < 1e-3, (a, b)
    for name, plan in houses.items():
        for bridge_name, other in bridges.items():
            least = 1.0 if name.startswith("b_") else -1.0
            assert plan.distance(other) > least, (name, bridge_name)
    lot_area = solid_plan(groups(built.meshes, "Parking")["lot"])
    road = solid_plan([part for part in built.meshes if part.label in ("road", "road_line")])
    assert lot_area.intersection(road).area < 1e-3 * lot_area.area
    for name, parts in groups(built.meshes, "Props").items():
        low = solid_plan(parts, 4.5)
        assert low.intersection(road).area < 1e-6, name
        assert low.intersection(lot_area).area < 1e-6, name
        tall = solid_plan(parts)
        assert all(tall.intersection(other).area < 1e-6 for other in bridges.values()), name


def test_surface_of_the_lot_is_the_ground_once(built):
    parts = groups(built.meshes, "Parking")["lot"]
    terrain = [part for part in built.meshes if part.path.startswith(("Terrain", "Paving"))]
    own = solid_plan(parts)
    assert sum(plan_area(part) for part in parts) == pytest.approx(own.area, rel=1e-6)
    assert own.intersection(solid_plan(terrain)).area < 1e-3
    assert {part.label for part in parts} == {"ground"}
    assert {part.material for part in parts} == {"asphalt", "road_marking"}


def test_parked_cars_of_the_town_are_free_and_off_the_lanes(town, built):
    assert [car.name for car in built.parked] == [f"p_{k:03d}" for k in range(1, len(built.parked) + 1)]
    plans = [plan_of_car(car, CATALOG[car.model]) for car in built.parked]
    assert 60 < len(plans) < 80
    assert min(a.distance(b) for a, b in combinations(plans, 2)) > 0.03
    driven = [shapely.LineString(lane.points[:, :2]).buffer(0.5 * lane.width) for lane in built.lanes.lanes.values()]
    assert not any(shapely.intersects(plan, driven).any() for plan in plans)
    others = [p for group in ("Props", "Buildings") for p in groups(built.meshes, group).values()]
    blocked = shapely.union_all([solid_plan(parts, 3.0) for parts in others])
    assert not any(plan.intersects(blocked) for plan in plans)


@pytest.fixture(scope="module")
def asset(tmp_path_factory) -> Path:
    """Write the town of places as USD."""
    folder = tmp_path_factory.mktemp("places")
    (folder / "places.yaml").write_text(PLACES)
    report = build_town(folder / "places.yaml", folder)
    assert report.parked > 60 and report.triangles["Skybridges"] > 500
    return report.path


def test_town_with_parked_cars_is_valid_and_opens_quickly(asset):
    stage = Usd.Stage.Open(str(asset))
    assert validate_stage(stage) == []
    cars = stage.GetPrimAtPath("/Town/Parked").GetChildren()
    bodies = [car.GetChild("Model") for car in cars]
    assert len(bodies) > 60 and all(body.IsInstance() for body in bodies)
    assert len(stage.GetPrototypes()) <= len(CATALOG) * len(PAINTS)
    town = open_town(asset)  # parked cars and their lots are no part of the surface that wheels drop on
    low, high = np.array([-70.0, -24.0]), np.array([-41.0, 24.0])
    inside = ((town.points[:, :2] > low) & (town.points[:, :2] < high)).all(axis=1)
    assert not inside.any()


def test_parked_cars_are_actors_of_a_scenario(asset, built, tmp_path):
    pose = make_pose((1.75, 0.0, 0.0), quaternion_from_ypr(math.pi / 2, 0.0, 0.0))
    moving = pose + np.outer(np.arange(4), [0, 0.1, 0, 0, 0, 0, 0])
    tracks = [VehicleTrack("cav_1", "cav", "sedan", "red", moving)]
    stage = compose_scenario(
        tmp_path / "stage.usdc", town_path=asset, tracks=tracks, catalog=CATALOG, rsus=[], sensors=(), weather="sunny",
        meta={},
    )  # fmt: skip
    arrays = read_stage(stage, range(3), ["sunny"])
    assert len({actor.name for actor in arrays.actors}) == len(arrays.actors) == 1 + len(built.parked)
    by_actor = {actor.name: k for k, actor in enumerate(arrays.actors)}
    assert not any("/Parked/" in thing.prim_path and not thing.actor for thing in arrays.objects)
    assert not arrays.actors[by_actor["cav_1"]].is_parked
    boxes = make_boxes(arrays, [1])
    assert len(boxes.actor) == len(arrays.actors)
    row_of = {int(actor): row for row, actor in enumerate(boxes.actor)}
    assert boxes.velocity[row_of[by_actor["cav_1"]]] == pytest.approx([0, 10, 0], abs=1e-4)
    for car in built.parked:
        actor, model = by_actor[car.name], CATALOG[car.model]
        row = row_of[actor]
        assert arrays.actors[actor].role == "vehicle" and arrays.actors[actor].is_parked
        assert np.allclose(arrays.poses[:, actor, :3], car.pose[:3], atol=1e-9)
        assert boxes.size[row] == pytest.approx([model.length, model.width, model.height])
        assert boxes.velocity[row] == pytest.approx([0, 0, 0])
        center = rotate(car.pose[3:], model.center) + car.pose[:3]
        assert boxes.pose[row, :3] == pytest.approx(center, abs=1e-5)
        assert arrays.models[arrays.actors[actor].model].name == car.model
    used = {arrays.actors[by_actor[car.name]].model for car in built.parked}
    assert len(used) < len(built.parked) / 2  # traced as instances
