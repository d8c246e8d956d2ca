"""OpenDRIVE -> World: reference lines, surfaces, lanes and messages, against quadrature and closed forms."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from mmw.core.mesh import TriangleMesh, merge
from mmw.traffic.idm.simulation import simulate_idm
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.opendrive.cross_section import RoadShape
from mmw.worlds.importers.opendrive.document import read_document
from mmw.worlds.importers.opendrive.reference_line import make_line
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.meshes import corners_of, part_at, plumb, upward
from tests.fixtures.traffic_towns import demand
from tests.fixtures.xodr_files import (
    ARM,
    LANE,
    LEVEL,
    RADIUS,
    WALK,
    Plan,
    cubic,
    document,
    hermite,
    lane,
    link,
    loop_plans,
    mark,
    read_xodr,
    road,
    section,
    street,
    t_town,
)


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> ImportedScene:
    return read_xodr(tmp_path_factory.mktemp("xodr"), t_town())


def of(world: ImportedScene, *labels: str) -> TriangleMesh:
    """Return all meshes with some labels as one."""
    return merge(part.mesh for part in world.parts if part.label in labels)


def plan_area(parts: list[MeshPart], prefix: str) -> float:
    """Return the area in plan of the upward faces of some meshes [m2]."""
    chosen = (part.mesh for part in parts if part.path.startswith(prefix))
    return sum(float(np.maximum(mesh.crosses[:, 2], 0.0).sum() / 2) for mesh in chosen)


def drops(mesh: TriangleMesh | MeshPart, xy: np.ndarray) -> list[np.ndarray]:
    """Return, for every point in plan, the heights of all upward triangles above it, by brute force."""
    return plumb(upward(corners_of([mesh])), xy, 1e-5)


def shape_of(tmp_path: Path, text: str, name: str = "1"):
    path = tmp_path / "road.xodr"
    path.write_text(text)
    record = read_document(path).roads[name]
    return RoadShape(record, make_line(record, "road", np.zeros(2)))


def test_reference_lines_agree_with_quadrature(tmp_path: Path) -> None:
    plan = Plan(3.0, -2.0, 0.7).line(12.0).spiral(0.0, 0.05, 35.0).spiral(0.05, -0.04, 50.0).arc(-0.04, 30.0)
    before = plan.pose
    plan = plan.cubic_to(*(before[:2] + 40.0), 0.2, 60.0)
    shape = shape_of(tmp_path, document(road("1", plan, street(0.0, False, False))))
    for s, (k0, k1, start, length) in {
        30.0: (0.0, 0.05, 12.0, 35.0), 47.0: (0.0, 0.05, 12.0, 35.0), 80.0: (0.05, -0.04, 47.0, 50.0),
        127.0: (-0.04, -0.04, 97.0, 30.0),
    }.items():  # fmt: skip
        begin, heading = shape.line.at(np.array([start]))
        # A cell of 0.2 mm and a curvature of 0.05 leave the midpoint rule less than 1e-9 m.
        along = (np.arange(200000) + 0.5) * (s - start) / 200000
        angle = heading[0] + k0 * along + 0.5 * (k1 - k0) / length * along**2
        expected = begin[0] + np.array([np.cos(angle).mean(), np.sin(angle).mean()]) * (s - start)
        xy, tangent = shape.line.at(np.array([s - 1e-9]))
        np.testing.assert_allclose(xy[0], expected, atol=1e-6)
        assert tangent[0] == pytest.approx(heading[0] + k0 * (s - start) + 0.5 * (k1 - k0) / length * (s - start) ** 2)
    # The cubic is run through at equal speed, and ends at its pose.
    s = np.linspace(127.0 + 1e-9, plan.station, 4001)
    xy, tangent = shape.line.at(s)
    step = np.linalg.norm(np.diff(xy, axis=0), axis=1)
    np.testing.assert_allclose(step, step.mean(), rtol=1e-4)
    np.testing.assert_allclose(xy[-1], before[:2] + 40.0, atol=1e-9)
    assert tangent[-1] == pytest.approx(0.2)


def test_cubic_by_arc_length_and_poly3(tmp_path: Path) -> None:
    u, v, length = hermite(np.zeros(3), np.array([30.0, 5.0, 0.0]), 30.0)
    scale = length ** -np.arange(4)
    head = f'<geometry s="0" x="0" y="0" hdg="0" length="{length}">'
    plan = Plan(0, 0, 0)
    plan.station, plan.text = length, f'{head}<paramPoly3 pRange="arcLength" {cubic(u * scale, v * scale)}/></geometry>'
    end, _ = shape_of(tmp_path, document(road("1", plan, street(0.0)))).line.at(np.array([length]))
    np.testing.assert_allclose(end[0], [30.0, 5.0], atol=1e-9)
    plan.text = f'{head}<poly3 a="0" b="0" c="0.01" d="0"/></geometry>'
    xy, heading = shape_of(tmp_path, document(road("1", plan, street(0.0)))).line.at(np.array([20.0]))
    x = xy[0, 0]  # arc length of y = k x2: (2 k x sqrt(1 + (2 k x)2) + asinh(2 k x)) / (4 k)
    q = 0.02 * x
    assert (q * np.sqrt(1 + q * q) + np.arcsinh(q)) / 0.04 == pytest.approx(20.0, abs=1e-9)
    assert (xy[0, 1], heading[0]) == (pytest.approx(0.01 * x * x), pytest.approx(np.arctan(q)))


def test_areas_of_strips_in_closed_form(town: ImportedScene) -> None:
    first, second = loop_plans()
    # A strip from t0 to t1 beside a line of length L that turns by A covers (t1 - t0) L - A (t1^2 - t0^2) / 2;
    # strips that are symmetric about the reference line cover their width times L.
    for name, length in (("road_1", first.station), ("road_2", second.station), ("road_3", 50.0)):
        assert plan_area(town.parts, f"Roads/{name}/") == pytest.approx(2 * LANE * length, rel=3e-4)
        assert plan_area(town.parts, f"Sidewalks/{name}/") == pytest.approx(2 * WALK * length, rel=3e-4)
    # Yellow dashes of 3 m and gaps of 6 m, half of each on either lane.
    dashes = 5 * 3.0 + 3.0  # on 50 m: 0-3, 9-12, 18-21, 27-30, 36-39, 45-48
    assert plan_area(town.parts, "Roads/road_3/marking_yellow") == pytest.approx(0.15 * dashes, rel=1e-6)
    assert plan_area(town.parts, "Roads/road_3/marking") == pytest.approx(0.15 * dashes + 2 * 0.15 * 50.0, rel=1e-6)
    # The junction: bars of the T, and the corners between the arms outside quarter circles of radius 10.5 m.
    half, inner = LANE, ARM - LANE
    corner = inner**2 * (1 - np.pi / 4)
    paved = 2 * ARM * 2 * half + inner * 2 * half + 2 * corner
    assert plan_area(town.parts, "Roads/junction_9/") == pytest.approx(paved, rel=1e-3)
    quarter = 0.25 * np.pi * (inner**2 - (inner - WALK) ** 2)
    assert plan_area(town.parts, "Sidewalks/junction_9/walk") == pytest.approx(2 * ARM * WALK + 2 * quarter, rel=2e-3)


def test_lanes_lie_on_one_surface(town: ImportedScene) -> None:
    roads = of(town, "road", "road_line")
    for lane_ in town.lanes.lanes.values():
        assert np.linalg.norm(np.diff(lane_.points, axis=0), axis=1).max() <= 2.0
        for z, heights in zip(lane_.points[:, 2], drops(roads, lane_.points[:, :2]), strict=True):
            assert len(heights), lane_.name
            assert np.abs(heights - z).max() < 1e-3  # none missing, and no second sheet above or below
    top = max(lane_.points[:, 2].max() for lane_ in town.lanes.lanes.values())
    assert top == pytest.approx(LEVEL, abs=1e-3)


def test_nothing_looks_through_and_nothing_is_stacked(town: ImportedScene) -> None:
    ground = of(town, "road", "road_line", "sidewalk", "terrain")
    rng = np.random.default_rng(1)
    low, high = ground.bounds[0, :2] + 0.01, ground.bounds[1, :2] - 0.01
    near = rng.uniform((-16, -8), (16, 16), (600, 2))
    for heights in drops(ground, np.concatenate([rng.uniform(low, high, (600, 2)), near])):
        assert len(heights)
        top = heights.max()
        others = np.unique(np.round(top - heights, 4))
        assert all(other == 0.0 or other >= 0.04 for other in others)


def test_a_humped_way_bends_the_whole_junction(tmp_path: Path) -> None:
    half, high = ARM, 0.3
    c, d = 3 * high / half**2, -2 * high / half**3
    hump = f'<elevation s="0" a="0" b="0" c="{c}" d="{d}"/><elevation s="{half}" a="{high}" b="0" c="{-c}" d="{-d}"/>'
    head, tail = t_town().split('<road id="100"')
    world = read_xodr(
        tmp_path, head + '<road id="100"' + tail.replace("<elevationProfile>", f"<elevationProfile>{hump}", 1)
    )
    roads = of(world, "road", "road_line")
    for name in (f"road_{k}_s0_r1" for k in range(100, 106)):
        line = world.lanes.lanes[name].points
        for z, heights in zip(line[:, 2], drops(roads, line[:, :2]), strict=True):
            assert len(heights) and np.abs(heights - z).max() < 1e-3
    # Its right half lies under no other way but the turn into the north arm, so it keeps nearly its own height there.
    middle = world.lanes.lanes["road_100_s0_r1"].points
    assert 0.2 < np.interp(0.0, middle[:, 0], middle[:, 2]) <= high + 1e-6
    # Seams stay closed: just inside and just outside the ends of the arms, the heights are the same.
    for x in (-ARM, ARM):
        for y in (-3.0, -1.0, 1.0, 3.0):
            inner, outer = drops(roads, np.array([[0.9999 * x, y], [1.0001 * x, y]]))
            assert abs(inner.max() - outer.max()) < 2e-3


def test_heights_follow_the_profile(town: ImportedScene) -> None:
    first, _ = loop_plans()
    lane_ = town.lanes.lanes["road_1_s0_r1"]
    x = np.arange(ARM, ARM + 60.0, 1.0)
    s = x - ARM
    expected = LEVEL * (3 * (s / first.station) ** 2 - 2 * (s / first.station) ** 3)
    found = np.interp(x, lane_.points[:, 0][:60], lane_.points[:, 2][:60])
    np.testing.assert_allclose(found[:-2], expected[:-2], atol=1e-3)
    walk = part_at(town.parts, "Sidewalks/road_3/walk")
    np.testing.assert_allclose(walk.points[:, 2], 0.14, atol=1e-9)
    curb = part_at(town.parts, "Sidewalks/junction_9/curb")
    assert (curb.points[:, 2].min(), curb.points[:, 2].max()) == (pytest.approx(0.0, abs=1e-6), pytest.approx(0.14))


def test_lane_graph_of_the_junction(town: ImportedScene) -> None:
    lanes = town.lanes.lanes
    assert len(lanes) == 12
    ahead = {"road_100_s0_r1", "road_105_s0_r1"}
    assert set(lanes["road_3_s0_l1"].successors) == ahead
    assert lanes["road_1_s0_r1"].successors == ("road_2_s0_r1",)  # two lane sections became one lane
    for lane_ in lanes.values():
        for name in lane_.successors:
            assert np.linalg.norm(lanes[name].points[0] - lane_.points[-1]) < 1e-6
    assert max(town.lanes.kinks().values()) < np.radians(3.0)  # half a step on the smallest radius
    crossing = [lane_ for lane_ in lanes.values() if lane_.junction]
    assert {lane_.junction for lane_ in crossing} == {"junction_9"} and len(crossing) == 6
    straight, left, right = (lanes[f"road_{k}_s0_r1"].priority for k in (101, 105, 103))
    assert straight > right > left
    assert lanes["road_100_s0_r1"].priority == straight + 10  # named first by <priority>
    assert lanes["road_1_s0_l1"].speed == pytest.approx(50 / 3.6) and crossing[0].speed == 8.0
    left_turn, right_turn = lanes["road_105_s0_r1"], lanes["road_103_s0_r1"]
    assert left_turn.length == pytest.approx((ARM + LANE / 2) * np.pi / 2, rel=1e-3)
    assert right_turn.length == pytest.approx((ARM - LANE / 2) * np.pi / 2, rel=1e-3)
    assert lanes["road_1_s0_r1"].length > lanes["road_1_s0_l1"].length + 0.9 * np.pi * LANE
    assert any("1 lanes lead nowhere: road_3_s0_r1" in note for note in town.notes)
    assert RADIUS > LANE


def test_vehicles_drive_on_it(town: ImportedScene) -> None:
    roads = of(town, "road", "road_line")
    options = {"frame_count": 500, "vehicle_count": 4, "spawn_center_m": (40.0, 0.0, 0.0), "seed": 3}
    mesh = roads.points, roads.faces
    tracks = simulate_idm(demand(town.lanes, mesh, cav_ranks=(0, 1), **options)).tracks
    graph = shapely.MultiLineString([lane_.points[:, :2] for lane_ in town.lanes.lanes.values()])
    for track in tracks:
        assert np.linalg.norm(track.poses[-1, :2] - track.poses[0, :2]) > 5.0
        assert shapely.distance(shapely.points(track.poses[::20, :2]), graph).max() < 0.6
        heights = drops(roads, track.poses[::50, :2])
        for z, found in zip(track.poses[::50, 2], heights, strict=True):
            assert np.abs(found - z).min() < 0.05


def test_lanes_beside_each_other_and_sections(tmp_path: Path) -> None:
    grow = '<width sOffset="0" a="0" b="0" c="0.021" d="-0.0007"/><width sOffset="20" a="2.8" b="0" c="0" d="0"/>'
    one = section(0.0, [], mark("none"), [lane(-1, "driving", 3.5, mark("broken"), None, -1)])
    two = section(
        40.0,
        [],
        mark("none"),
        [lane(-1, "driving", 3.5, mark("broken"), -1, -1), lane(-2, "driving", grow, mark("solid"), None, -2)],
    )
    three = section(80.0, [], mark("none"), [
        lane(-1, "driving", 3.5, mark("solid"), -1), lane(-2, "driving", 2.8, mark("none"), -2)])  # fmt: skip
    world = read_xodr(tmp_path, document(road("a b", Plan(0, 0, 0).line(120.0), one + two + three)))
    lanes = world.lanes.lanes
    assert sorted(lanes) == ["road_a_b_s0_r1", "road_a_b_s1_r1", "road_a_b_s1_r2"]
    assert lanes["road_a_b_s0_r1"].successors == ("road_a_b_s1_r1",)
    # broken over 40 m and solid over 40 m: not more than half of the length may be crossed
    assert (lanes["road_a_b_s1_r1"].right, lanes["road_a_b_s1_r2"].left) == ("", "")
    world = read_xodr(tmp_path, document(road("a b", Plan(0, 0, 0).line(110.0), one + two + three)))
    lanes = world.lanes.lanes
    assert (lanes["road_a_b_s1_r1"].right, lanes["road_a_b_s1_r2"].left) == ("road_a_b_s1_r2", "road_a_b_s1_r1")
    assert lanes["road_a_b_s1_r1"].left == ""
    area = 3.5 * 110 + 2.8 * 50 + 0.021 * 20**3 / 3 - 0.0007 * 20**4 / 4
    assert plan_area(world.parts, "Roads/") == pytest.approx(area, rel=1e-4)


def test_superelevation_border_offset_and_lane_height(tmp_path: Path) -> None:
    border = '<border sOffset="0" a="-3.0" b="0" c="0" d="0"/>'
    one = section(
        0.0,
        [],
        mark("none"),
        [lane(-1, "driving", border), lane(-2, "sidewalk", 1.5, '<height sOffset="0" inner="0.1" outer="0.2"/>')],
    )
    text = road("1", Plan(0, 0, 0).line(30.0), one, lateral='<superelevation s="0" a="0.1" b="0" c="0" d="0"/>',
                offset='<laneOffset s="0" a="0.5" b="0" c="0" d="0"/>')  # fmt: skip
    world = read_xodr(tmp_path, document(text))
    asphalt = part_at(world.parts, "Roads/road_1/asphalt").points
    cos, sin = np.cos(0.1), np.sin(0.1)
    assert (asphalt[:, 1].max(), asphalt[:, 1].min()) == (pytest.approx(0.5 * cos), pytest.approx(-2.5 * cos))
    assert (asphalt[:, 2].max(), asphalt[:, 2].min()) == (pytest.approx(0.5 * sin), pytest.approx(-2.5 * sin))
    walk = part_at(world.parts, "Sidewalks/road_1/walk").points
    assert sorted(set(np.round(walk[:, 2], 6))) == [
        pytest.approx(-4 * sin + 0.2, abs=1e-6),
        pytest.approx(-2.5 * sin + 0.1, abs=1e-6),
    ]


def test_left_hand_traffic_and_no_speed(tmp_path: Path) -> None:
    plan = Plan(0, 0, 0).line(40.0)
    right = read_xodr(tmp_path, document(road("1", plan, street(0.0, False, False), speed="")))
    left = read_xodr(
        tmp_path, document(road("1", plan, street(0.0, False, False), rule="LHT", speed='<speed max="30" unit="mph"/>'))
    )
    for name in ("road_1_s0_l1", "road_1_s0_r1"):
        np.testing.assert_allclose(left.lanes.lanes[name].points[::-1, :2], right.lanes.lanes[name].points[:, :2])
        assert left.lanes.lanes[name].speed == pytest.approx(13.4112)
    assert right.lanes.lanes["road_1_s0_r1"].headings[0] == pytest.approx(0.0)
    assert any("no speed limit; 50 km/h assumed" in note for note in right.notes)
    assert any("falls into 2 parts" in note for note in right.notes)


def test_bridge_gets_a_deck_and_far_coordinates_an_origin(tmp_path: Path) -> None:
    x, y = 452000.0, 5411000.0
    low = road("1", Plan(x - 40, y, 0).line(80.0), street(0.0, False, False))
    high = road("2", Plan(x, y - 40, np.pi / 2).line(80.0), street(0.0, False, False),
                elevation='<elevation s="0" a="6" b="0" c="0" d="0"/>')  # fmt: skip
    world = read_xodr(tmp_path, document(low, high))
    deck = part_at(world.parts, "Bridges/road_2/deck")
    assert deck.points[:, 2].min() == pytest.approx(6 - 0.6, abs=0.15) and deck.label == "bridge"
    assert max(np.abs(part.points[:, :2]).max() for part in world.parts) < 200
    assert any("the origin was moved to x = 452000 m, y = 5411000 m" in note for note in world.notes)
    ground = part_at(world.parts, "Terrain/ground")
    under = [z.max() for z in drops(ground, np.array([[3.0, 7.5], [-3.0, -7.5]]))]
    assert max(under) < 4.0  # the lower road keeps its height, and the ground rises only beyond the abutments


def test_same_file_same_world(town: ImportedScene, tmp_path: Path) -> None:
    again = read_xodr(tmp_path, t_town())
    assert [part.path for part in again.parts] == [part.path for part in town.parts]
    for one, other in zip(again.parts, town.parts, strict=True):
        assert np.array_equal(one.points, other.points) and np.array_equal(one.faces, other.faces)


GOOD = road("7", Plan(0, 0, 0).line(40.0), street(0.0, False, False))
LOST = GOOD.replace("<link>", "<link>" + link("successor", "road", "8", "start"), 1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<OpenDRIVE><road", "broken XML .*export the file again"),
        ("<osm/>", "root element <osm>; <OpenDRIVE> is needed"),
        (document(), "has no road"),
        (document(GOOD.replace("<line/>", "<nurbs/>")), "road '7': geometry at s = 0 holds <nurbs>; one of line, arc"),
        (document(GOOD.replace('length="40.0"><l', 'length="forty"><l')), "road '7': .*length.* is 'forty'"),
        (document(LOST), "end of road '7' .to road '8'.: the link names a road that does not exist"),
        (document(GOOD.replace("km/h", "knots")), "speed unit 'knots'; m/s, km/h or mph"),
        (document(GOOD.replace("RHT", "MIDDLE")), "rule 'MIDDLE'; RHT or LHT is needed"),
        (document(GOOD, GOOD), "road '7': the id is used twice"),
        (document(GOOD.replace('id="-2"', 'id="-3"', 1)), "road '7' at s = 0 .*1, 3.*: lanes are not numbered"),
        (
            document(GOOD.replace('length="40.0"', 'length="4e9"')),
            "road '7': <road> attribute length is '4e9'; .* 50000",
        ),
        (
            document(GOOD.replace('length="40.0"', 'length="49e3"', 1)),
            "road '7' .49000 m, drawn to 40 m.: its geometry ends",
        ),
        (document(GOOD.replace("<line/>", '<arc curvature="1e9"/>')), "road '7': <arc> attribute curvature is '1e9'"),
        (
            document(GOOD.replace("<line/>", '<spiral curvStart="0" curvEnd="90"/>')),
            "curvEnd is 90 over 40 m, 3600 rad",
        ),
        (document(GOOD.replace(' x="0.0"', ' x="1e300"')), "road '7': <geometry> attribute x is '1e300'"),
        (
            document(GOOD.replace('a="3.5"', 'a="1e9"', 1)),
            "road '7': lane 1: <width> reaches 1e\\+09 at s = 0 m; -100 to 100",
        ),
        (document(GOOD.replace('a="3.5" b="0"', 'a="3.5" b="70"', 1)), "<width> reaches .* at s = .* m; -100 to 100"),
        (
            document(GOOD.replace("<elevationProfile>", '<elevationProfile><elevation s="0" a="0" d="9"/>')),
            "<elevation> reach",
        ),
        (
            document(GOOD.replace('laneSection s="0.0"', 'laneSection s="41"')),
            "no laneSection begins before its end at 40 m",
        ),
        (
            document(GOOD, GOOD.replace('id="7"', 'id="8"').replace(' x="0.0"', ' x="3e4"')),
            "the map: reaches over 3.*e\\+04 m",
        ),
        (document(GOOD.replace('id="-2"', 'id="-2e9"', 1)), "<lane> attribute id is '-2e9'; a number from -100 to 100"),
    ],
)
def test_messages(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        read_xodr(tmp_path, text, strict=True)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("gap", "is_error"), [(0.3, False), (0.8, True)])
def test_gaps_between_lanes(tmp_path: Path, gap: float, is_error: bool) -> None:
    first = road(
        "1", Plan(0, 0, 0).line(40.0), street(0.0, before=False), links=link("successor", "road", "2", "start")
    )
    second = road(
        "2", Plan(40, gap, 0).line(40.0), street(0.0, after=False), links=link("predecessor", "road", "1", "end")
    )
    if is_error:
        with pytest.raises(ValueError, match=r"ends at \(40.00, -1.75, 0.00\), 0.80 m from lane road_2_s0_r1"):
            read_xodr(tmp_path, document(first, second), strict=True)
        return
    world = read_xodr(tmp_path, document(first, second))
    lanes = world.lanes.lanes
    np.testing.assert_allclose(lanes["road_2_s0_r1"].points[0], lanes["road_1_s0_r1"].points[-1], atol=1e-9)
    np.testing.assert_allclose(lanes["road_2_s0_r1"].points[20:, 1], gap - LANE / 2, atol=1e-9)
