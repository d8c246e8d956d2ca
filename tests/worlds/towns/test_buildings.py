"""Solids, facades, lots and props: closed, outward, of the right area, and never on the road."""

import math
from collections import Counter

import numpy as np
import pytest
import shapely

from mmw.core.mesh import TriangleMesh, merge
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.usd.material_library import LIBRARY
from mmw.usd.semantics import CARLA_TAG
from mmw.worlds.towns import primitives as solids
from mmw.worlds.towns.block_description import BlockDescription, BuildingStyle
from mmw.worlds.towns.blocks import Lot, find_blocks, place_lots, start_west
from mmw.worlds.towns.buildings import Site, build_building
from mmw.worlds.towns.facades import GLASS, WALL, facade_cells, height_of
from mmw.worlds.towns.ground_height import Ground
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.prop_placement import PropPlacer, add_at_approaches, approaches, place_props
from mmw.worlds.towns.props import PROPS, build_prop
from tests.fixtures.meshes import area, by_name, open_edges, volume

L_SHAPE = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [0, 3]], float)

CLOSED = {
    "box": (solids.box((1, 2, 3), (4, 5, 6)), 6.0),
    "prism": (solids.prism(L_SHAPE, -1.0, 1.0), 12.0),
    "cone": (solids.lathe([(1, 0), (0, 3)], 4), 2.0),
    "frustum": (solids.lathe([(2, 0), (1, 3)], 4), 14.0),
    "spindle": (solids.lathe([(0, 0), (1, 1), (0, 3)], 4), 2.0),
    "beam": (solids.beam((0, 0, 0), (3, 4, 0), 0.2), 0.2),
    "upright beam": (solids.beam((1, 1, 1), (1, 1, 3), 0.5), 0.5),
}


@pytest.mark.parametrize("name", CLOSED)
def test_solid_is_closed_and_encloses_its_volume(name):
    mesh, enclosed = CLOSED[name]
    assert open_edges(mesh) == 0
    assert volume(mesh) == pytest.approx(enclosed, rel=1e-12)  # positive: normals point outward


def test_ball_is_closed_and_inside_its_ellipsoid():
    mesh = solids.ball((1, 2, 3), (5, 5, 5), 12, 8)
    assert open_edges(mesh) == 0
    full = 4 / 3 * np.pi * 6
    assert 0.8 * full < volume(mesh) < full
    assert np.all((((mesh.points - 5) / [1, 2, 3]) ** 2).sum(axis=1) <= 1 + 1e-9)


def test_place_turns_then_moves():
    mesh = solids.place(solids.box((2, 0.2, 0.2), (1, 0, 0)), (10, 20, 30), math.pi / 2)
    assert mesh.points.mean(axis=0) == pytest.approx([10, 21, 30])
    assert volume(mesh) == pytest.approx(0.08)


def test_weld_keeps_the_order_of_first_use():
    points = np.array([[2.0, 0, 0], [1, 0, 0], [2 + 1e-9, 0, 0], [0, 1, 0]])
    mesh = solids.weld(TriangleMesh(points, np.array([[0, 1, 3], [2, 3, 1]], np.int32)))
    assert mesh.points.tolist() == [[2, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 1]]


@pytest.mark.parametrize("windows", ["punched", "ribbon", "curtain"])
@pytest.mark.parametrize("door", [False, True])
@pytest.mark.parametrize("is_plain", [False, True])
def test_facade_cells_fill_the_wall_exactly_and_share_their_edges(windows, door, is_plain):
    style = BuildingStyle(windows=windows)
    grid = facade_cells(style, 23.0, 5, -1.5, 0.0, 0.9, door, True)
    meshes = solids.wall_cells((3, 1), (3 + 23 * 0.6, 1 + 23 * 0.8), *grid, is_plain=is_plain)
    top = height_of(style, 5) + 0.9
    assert sum(area(mesh) for mesh in meshes.values()) == pytest.approx(23.0 * (top + 1.5), rel=1e-12)
    whole = merge(meshes.values())
    assert np.allclose(whole.normals, [0.8, -0.6, 0])
    outline = 4 if is_plain else 2 * (len(grid[0]) + len(grid[1]) - 2)
    assert open_edges(whole) == outline  # only the outline of the wall is open: no T-vertex, no gap
    assert 0.1 < area(meshes[GLASS]) / area(whole) < 0.95
    assert meshes[WALL].points[:, 2].min() == -1.5
    assert set(meshes) == ({0, 1, 2} if door else {0, 1})


SITE = Site((30.0, -20.0), 0.7, 24.0, 16.0, -1.0, 0.5)


@pytest.mark.parametrize("form", ["flat", "gable", "hip"])
@pytest.mark.parametrize("podium", [0, 2])
def test_building_stands_on_its_plan_and_looks_outward(form, podium):
    style = BuildingStyle(roof_form=form, podium_storeys=podium if form == "flat" else 0)
    parts = build_building("b", style, SITE, 4, np.random.default_rng(0))
    meshes = by_name(parts)
    walls = merge([meshes["facade"], meshes["glass"], meshes["door"]])
    upright = np.abs(walls.normals[:, 2]) < 1e-6
    middle = walls.points[walls.faces].mean(axis=1) - [*SITE.center, 0]
    reach = (walls.normals * middle)[upright].sum(axis=1)
    outward = reach > 0
    assert outward.mean() > 0.9  # the inner sides of parapets look inward
    plan = shapely.Polygon(SITE.ring).buffer(0.3, join_style="mitre")
    assert shapely.contains_xy(plan, *walls.points[:, :2].T).all()
    assert walls.points[:, 2].min() == -1.0
    storeys = walls.points[:, 2].max() - SITE.floor
    assert storeys >= height_of(style, 4) - 1e-9
    assert meshes["roof"].points[:, 2].max() >= SITE.floor + height_of(style, 4) - 1e-9
    for part in parts:
        assert part.material in LIBRARY and part.label in CARLA_TAG
        assert part.faces.max() < len(part.points) and area(part.mesh) > 0


@pytest.mark.parametrize("form", ["gable", "hip"])
@pytest.mark.parametrize("size", [(10.0, 16.0), (16.0, 10.0)])
def test_pitched_roof_is_closed(form, size):
    style = BuildingStyle(roof_form=form)
    roof = by_name(build_building("b", style, Site((0, 0), 0.0, *size, -1, 0), 2, np.random.default_rng(0)))["roof"]
    assert open_edges(roof) == 0
    assert volume(roof) > 0


def cross() -> tuple[shapely.Geometry, shapely.Geometry, Ground]:
    """Return carriageway, corridor and ground of a crossing on a gentle slope."""
    lines = shapely.MultiLineString([[(-100, 0), (100, 0)], [(0, -100), (0, 100)]])
    corners = np.array([[-140, -140], [140, -140], [140, 140], [-140, 140]], float)
    points = np.column_stack([corners, 0.02 * corners[:, 0]])
    ground = MeshPart("Terrain/g", points, np.array([[0, 1, 2], [0, 2, 3]], np.int32), "grass", "terrain")
    return lines.buffer(7, cap_style="flat"), lines.buffer(9.5, cap_style="flat"), Ground([ground])


def describe(**props) -> BlockDescription:
    styles = {
        "block": {"storeys": [3, 6]},
        "house": {"roof_form": "gable", "facade": "brick_facade", "front_m": [10, 12], "depth_m": [8, 10]},
    }
    districts = [
        {"name": "core", "center": [0, 0], "radius_m": 60, "styles": {"block": 1}},
        {"name": "rim", "center": [0, 0], "radius_m": 500, "styles": {"house": 1}},
    ]
    blocks = {"seed": 4, "reach_m": 40, "styles": styles, "districts": districts}
    return BlockDescription.model_validate({"blocks": blocks, "props": props})


LAND = shapely.box(-140, -140, 140, 140)


def lots_of(description: BlockDescription) -> list[Lot]:
    _, corridor, ground = cross()
    return place_lots(description, corridor, LAND, ground)[0]


def test_blocks_are_the_land_beside_the_corridor():
    _, corridor, _ = cross()
    blocks = find_blocks(corridor, LAND, 30)
    assert sum(block.area for block in blocks) == pytest.approx(
        shapely.buffer(corridor, 30).intersection(LAND).area - corridor.area, rel=1e-9
    )
    assert all(not block.intersects(corridor.buffer(-1e-6)) for block in blocks)


def test_lots_keep_clear_of_roads_and_each_other_and_stand_in_the_ground():
    _, corridor, ground = cross()
    lots = lots_of(describe())
    assert len(lots) > 20
    plans = [lot.outline for lot in lots]
    assert min(plan.distance(corridor) for plan in plans) >= 2.8
    pairs = [a.distance(b) for i, a in enumerate(plans) for b in plans[:i]]
    assert min(pairs) >= 4.0 - 1e-6
    for lot in lots:
        heights = ground.height(*lot.site.ring.T)
        assert lot.site.foot < heights.min() - 0.5
        front = ground.height(*lot.site.ring[:2].T)
        assert lot.site.floor >= front.max()
    assert {lot.style for lot in lots} == {"block", "house"}


def test_front_of_a_lot_faces_its_street():
    _, corridor, _ = cross()
    for lot in lots_of(describe()):
        ring = lot.site.ring
        front, back = (shapely.Point(ring[i : i + 2].mean(axis=0)).distance(corridor) for i in (0, 2))
        assert front < back


def test_same_description_gives_the_same_lots():
    assert lots_of(describe()) == lots_of(describe())


def test_ring_starts_at_the_same_corner_whatever_the_last_bits():
    ring = shapely.LinearRing([(5, 0), (5, 9), (1e-13, 9), (0, 0)])
    assert shapely.get_coordinates(start_west(ring))[0].tolist() == [0, 0]


def test_building_on_a_road_is_refused():
    _, corridor, ground = cross()
    data = describe().model_dump()
    data["buildings"] = [{"name": "x", "style": "block", "center": [0, 5], "size_m": [10, 10]}]
    with pytest.raises(ValueError, match=r"building 'x'.*on a road"):
        place_lots(BlockDescription.model_validate(data), corridor, LAND, ground)


def test_unknown_styles_are_refused():
    with pytest.raises(ValueError, match="uses style 'nope'"):
        BlockDescription.model_validate(
            {"buildings": [{"name": "x", "style": "nope", "center": [0, 5], "size_m": [10, 10]}]}
        )
    district = {"name": "a", "center": [0, 0], "radius_m": 1, "styles": {"nope": 1}}
    with pytest.raises(ValueError, match="uses style 'nope'"):
        BlockDescription.model_validate({"blocks": {"districts": [district]}})


@pytest.mark.parametrize("kind", PROPS)
def test_prop_is_closed_rooted_and_described(kind):
    parts = build_prop("p", kind, (3, 4, 5), 0.3, np.random.default_rng(1))
    for part in parts:
        assert volume(part.mesh) > 0
        assert open_edges(part.mesh) == 0
        assert part.material in LIBRARY and part.label in CARLA_TAG
    low = min(part.points[:, 2].min() for part in parts)
    assert low < 5.0 - 0.1  # reaches into the ground
    assert max(part.points[:, 2].max() for part in parts) < 5 + 20
    assert sum(len(part.faces) for part in parts) < 700


def test_unknown_prop_is_refused():
    with pytest.raises(ValueError, match="kind 'spaceship'; known kinds are"):
        build_prop("p", "spaceship", (0, 0, 0), 0.0, np.random.default_rng(0))


def lane_graph() -> LaneGraph:
    def lane(name, a, b, successors=(), junction="", priority=0):
        t = np.linspace(0, 1, 50)[:, None]
        points = np.hstack([(1 - t) * a + t * np.asarray(b, float), np.zeros((50, 1))])
        return Lane(name, points, 3.5, 13.0, junction, priority, successors)

    lanes = [
        lane("west_in", (-90, -1.75), (-10, -1.75), ("ahead",)),
        lane("ahead", (-10, -1.75), (10, -1.75), ("east_out",), "X", 30),
        lane("east_out", (10, -1.75), (90, -1.75)),
        lane("south_in", (1.75, -90), (1.75, -10), ("turn",)),
        lane("turn", (1.75, -10), (10, -1.75), ("east_out",), "X", 10),
    ]
    return LaneGraph({lane.name: lane for lane in lanes})


def test_approaches_and_who_gives_way():
    assert [lane.name for lane in approaches(lane_graph(), ["X"])] == ["south_in", "west_in"]
    assert [lane.name for lane in approaches(lane_graph(), ["*"], yielding=True)] == ["south_in"]
    assert approaches(lane_graph(), ["Y*"]) == []


def test_signs_stand_at_the_right_kerb_and_look_at_the_drivers():
    carriageway, _, ground = cross()
    placer = PropPlacer(carriageway, [], ground)
    add_at_approaches(placer, "give_way_sign", approaches(lane_graph(), ["X"]), 0.7, 2.0)
    south, west = placer.spots
    assert south.xy[0] > 7.5 and west.xy[1] < -7.5
    assert math.cos(south.yaw + math.pi / 2) == pytest.approx(1)  # looks south, at those who drive north
    assert math.cos(west.yaw - math.pi) == pytest.approx(1)


def test_arm_of_a_traffic_light_reaches_over_the_lanes():
    parts = by_name(build_prop("t", "traffic_light", (0, -8, 0), math.pi, np.random.default_rng(0)))
    heads = parts["heads"].points
    over = heads[heads[:, 1] > -6]
    assert len(over) and over[:, 2].min() > 5.0  # drivers come from -x; their lanes are at larger y


def test_furniture_leaves_the_carriageway_free_and_is_repeatable():
    carriageway, corridor, ground = cross()
    rows = [
        {"kind": "street_lamp", "every_m": 20, "offset_m": 0.6},
        {"kind": "broadleaf_tree", "every_m": 9, "offset_m": 4.0, "clear_m": 2.5, "jitter_m": 1.0},
    ]
    description = describe(rows=rows, signalled=["X"], fences=True, scattered_trees=20)
    lots, blocks = place_lots(description, corridor, LAND, ground)
    first, second = (place_props(description, carriageway, lane_graph(), lots, blocks, ground) for _ in range(2))
    kinds = Counter(part.path.split("/")[1].rsplit("_", 1)[0] for part in first)
    assert kinds["street_lamp"] > 30 and kinds["broadleaf_tree"] > 60 and kinds["fence"] > 5 and kinds["oak"] > 2
    plans = shapely.union_all([lot.outline for lot in lots])
    for part in first:
        low = part.points[part.points[:, 2] < ground.height(*part.points[:, :2].T) + 2.0]
        if len(low):
            assert not shapely.intersects_xy(carriageway, *low[:, :2].T).any(), part.path
            assert not shapely.intersects_xy(plans, *low[:, :2].T).any(), part.path
    assert [part.path for part in first] == [part.path for part in second]
    assert all(np.array_equal(a.points, b.points) for a, b in zip(first, second, strict=True))
    lamps = [part for part in first if "street_lamp" in part.path and part.path.endswith("lantern")]
    over = [shapely.intersects_xy(carriageway, *part.points[:, :2].mean(axis=0)) for part in lamps]
    assert np.mean(over) > 0.9  # lanterns hang over the road


def test_nothing_stands_below_the_canopy_of_a_gas_station():
    carriageway, _, ground = cross()
    rows = [{"kind": "broadleaf_tree", "every_m": 5, "offset_m": 4.0, "clear_m": 1.0}]
    placed = [{"kind": "gas_canopy", "at": [40, 19], "yaw_deg": 270}]
    parts = place_props(describe(rows=rows, placed=placed), carriageway, LaneGraph(), [], [], ground)
    canopy = next(part for part in parts if part.path.endswith("gas_canopy_001/canopy")).points
    plan = shapely.convex_hull(shapely.MultiPoint(canopy[:, :2]))
    trunks = [part.points[:, :2].mean(axis=0) for part in parts if part.path.endswith("trunk")]
    distance = shapely.distance(shapely.points(np.array(trunks)), plan)
    assert len(trunks) > 20 and 1.0 <= distance.min() < 6.0  # the row would run across it
