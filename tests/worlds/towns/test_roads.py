"""Roads, junctions, roundabouts, terrain: a closed surface, lanes on the mesh, and what is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import yaml
from scipy.sparse.csgraph import connected_components

from mmw.core.mesh import separate
from mmw.core.resources import assets_dir
from mmw.worlds.towns.description import TownDescription, load_town
from mmw.worlds.towns.network import RoadNetwork, build_network
from tests.fixtures.meshes import corners_of, free_edges, top, welded
from tests.fixtures.road_towns import drivable, small_town

TOWN03 = assets_dir() / "towns" / "town03" / "town03.yaml"


@pytest.fixture(scope="module")
def town03() -> TownDescription:
    return load_town(TOWN03)


@pytest.fixture(scope="module")
def network(town03: TownDescription) -> RoadNetwork:
    return build_network(town03)


# The shipped town


def test_surface_is_closed_and_lies_once_over_every_point(network: RoadNetwork) -> None:
    """Welded, every edge has two faces but those of the frame; areas in plan add up to the rectangle."""
    parts = [*network.parts, *network.terrain]
    corners = corners_of(parts)
    low, high = corners.reshape(-1, 3).min(axis=0), corners.reshape(-1, 3).max(axis=0)
    points, faces = welded(corners)
    ends = points[free_edges(faces)][:, :, :2]
    on_frame = np.isclose(ends, low[:2]) | np.isclose(ends, high[:2])
    assert np.all(np.any(on_frame.all(axis=1), axis=1))
    area = 0.5 * separate(corners).crosses[:, 2]
    assert np.all(area > -1e-9)
    assert area.sum() == pytest.approx(np.prod((high - low)[:2]), rel=1e-9)


def test_no_face_is_degenerate_and_all_look_up_or_at_the_road(network: RoadNetwork) -> None:
    for part in (*network.parts, *network.terrain):
        corners, normal, area = part.mesh.corners, part.mesh.crosses, 2.0 * part.mesh.areas
        is_cut = part.material in ("asphalt", "drain_grate", "manhole_cover")  # a cover's outline cuts lane cells
        assert area.min() > (2e-5 if is_cut else 2e-4), part.path
        upright = np.abs(normal[:, 2]) < 1e-9 * area
        assert np.all(normal[~upright, 2] > 0), part.path
        assert part.material == "curb" or not np.any(upright), part.path
        if np.any(upright):
            beside = corners[upright].mean(axis=1)[:, :2] + 0.05 * (normal[upright] / area[upright, None])[:, :2]
            assert np.all(shapely.contains_xy(network.carriageway, beside[:, 0], beside[:, 1])), part.path


def test_lane_points_lie_on_the_mesh(network: RoadNetwork) -> None:
    triangles = corners_of(drivable(network))
    points = np.concatenate([lane.points for lane in network.lanes.lanes.values()])
    chosen = points[np.random.default_rng(1).choice(len(points), 1500, replace=False)]
    z = top(triangles, chosen[:, :2])
    assert np.max(np.abs(z - chosen[:, 2])) < 1e-3  # NaN, a miss, fails too


def test_random_drops_on_the_carriageway_all_hit(network: RoadNetwork) -> None:
    triangles = corners_of(drivable(network))
    low, high = np.array(network.carriageway.bounds).reshape(2, 2)
    xy = np.random.default_rng(2).uniform(low, high, (4000, 2))
    xy = xy[shapely.contains_xy(network.carriageway, xy[:, 0], xy[:, 1])]
    assert len(xy) > 500
    z = top(triangles, xy)
    assert not np.any(np.isnan(z))
    np.testing.assert_allclose(network.height(xy[:, 0], xy[:, 1]), z, atol=1e-9)


def test_lanes_are_smooth_closed_and_wide_enough(network: RoadNetwork) -> None:
    graph = network.lanes
    for (before, after), kink in graph.kinks().items():
        assert np.degrees(kink) <= 1.5, (before, after)
        np.testing.assert_array_equal(graph.lanes[before].points[-1], graph.lanes[after].points[0])
    for lane in graph.lanes.values():
        step = np.linalg.norm(np.diff(lane.points, axis=0), axis=1)
        assert step.max() <= 2.0
        assert lane.successors
        assert graph.predecessors[lane.name]
        if lane.junction:
            turn = np.abs(np.diff(np.unwrap(lane.headings)))
            radius = 0.5 * (step[1:] + step[:-1]) / np.maximum(turn, 1e-12)
            assert radius.min() >= 5.5, lane.name
            assert np.ptp(lane.points[:, 2]) < 1e-9, lane.name  # pads are level
    lines = [shapely.LineString(lane.points[:, :2]) for lane in graph.lanes.values()]
    assert min(shapely.distance(lines, network.carriageway.boundary)) >= 1.3


def test_every_lane_reaches_every_lane(network: RoadNetwork) -> None:
    graph = network.lanes
    names = {name: k for k, name in enumerate(graph.lanes)}
    steps = np.zeros((len(names), len(names)), dtype=bool)
    for lane in graph.lanes.values():
        steps[names[lane.name], [names[after] for after in lane.successors]] = True
    assert connected_components(steps, connection="strong")[0] == 1


def test_roundabout_runs_counter_clockwise_and_goes_first(network: RoadNetwork) -> None:
    graph = network.lanes
    centre = np.array([-0.5, -0.5])
    ring = {name: lane for name, lane in graph.lanes.items() if name.startswith("rb_") and "_to_" not in name}
    on_road = [lane for lane in ring.values() if not lane.junction]
    assert len(on_road) == 8
    for lane in on_road:
        away = lane.points[:, :2] - centre
        expected = 26.0 if lane.name.endswith("f0") else 29.5
        np.testing.assert_allclose(np.linalg.norm(away, axis=1), expected, atol=1e-6)
        angle = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
        assert np.all(np.diff(angle) > 0)
    entries = [lane for lane in graph.lanes.values() if lane.junction == "rb_east" and "rb_to_c1_b" in lane.name]
    circling = [lane for lane in graph.lanes.values() if lane.junction == "rb_east" and "rb_east_rb_south" in lane.name]
    assert entries and circling
    assert max(lane.priority for lane in entries) < min(lane.priority for lane in circling)


def test_town03_has_the_places_of_the_scenarios(town03: TownDescription, network: RoadNetwork) -> None:
    def roads_at(node: str) -> list[str]:
        return [road.id for road in town03.roads if node in (road.start, road.end)]

    assert town03.nodes["T1"] == (150, 133, 8) and len(roads_at("T1")) == 3
    assert town03.nodes["X1"] == (83, 135, 8) and len(roads_at("X1")) == 4
    assert town03.nodes["F5"] == (-83, -5, 0) and len(roads_at("F5")) == 5
    north = network.centre_lines["t1_n3"]
    grade = np.abs(np.diff(north[:, 2])) / np.linalg.norm(np.diff(north[:, :2], axis=0), axis=1)
    assert 7 <= np.ptp(north[:, 2]) <= 8
    assert 0.15 <= grade.max() <= 0.18
    for name in ("x1_a3", "x1_x2", "x1_north"):
        z = network.centre_lines[name][:, 2]
        assert 6.4 <= np.ptp(z) <= 8.01
    extent = np.array(network.carriageway.bounds)
    # CARLA's town ends at y 206; ours goes on, so that the hill road is level again before it turns.
    np.testing.assert_allclose(extent, [-158, -202, 244, 241], atol=6)
    count = sum(len(part.faces) for part in (*network.parts, *network.terrain))
    assert 40_000 <= count <= 90_000


def test_paint_and_asphalt_share_the_carriageway(network: RoadNetwork) -> None:
    area = {"road": 0.0, "road_line": 0.0}
    for part in network.parts:
        if part.label in area:
            area[part.label] += 0.5 * float(part.mesh.crosses[:, 2].sum())
    assert sum(area.values()) == pytest.approx(network.carriageway.area, rel=1e-6)
    assert 0.02 < area["road_line"] / sum(area.values()) < 0.12


def painted(network: RoadNetwork, xy: np.ndarray) -> np.ndarray:
    lines = shapely.union_all(
        shapely.polygons(corners_of([part for part in network.parts if part.label == "road_line"])[:, :, :2])
    )
    shapely.prepare(lines)
    return shapely.contains_xy(lines, xy[:, 0], xy[:, 1])


def test_lines_of_the_ring_go_on_across_its_junctions(network: RoadNetwork) -> None:
    angle = 2 * np.pi * np.arange(3600) / 3600
    for radius, least, most, longest in ((27.75, 0.3, 0.6, 5.5), (24.25, 0.9, 1.0, 1.5), (31.25, 0.3, 0.7, 3.0)):
        ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1) - 0.5
        paint = painted(network, ring)
        assert least < paint.mean() < most
        gap = np.diff(np.flatnonzero(paint), append=np.flatnonzero(paint)[0] + len(paint)) * radius * 2 * np.pi / 3600
        assert gap.max() < longest


def test_every_arm_of_a_signalled_junction_has_a_stop_line(network: RoadNetwork, town03: TownDescription) -> None:
    assert "T1" in town03.props.signalled
    for road in ("x1_t1", "t1_c3", "t1_n3"):  # the last two are of the highest priority
        lane = next(lane for name, lane in network.lanes.lanes.items() if name == f"{road}_{'bf'[road == 'x1_t1']}0")
        along = np.stack([np.interp(lane.length - np.linspace(3.5, 4.5, 11), lane.station, lane.points[:, k])
                          for k in range(2)], axis=1)  # fmt: skip
        assert painted(network, along).any()


def test_terrain_stays_outside_the_corridor_and_between_its_heights(network: RoadNetwork) -> None:
    middle = corners_of(network.terrain).mean(axis=1)
    assert not np.any(shapely.contains_xy(network.corridor, middle[:, 0], middle[:, 1]))
    drive = network.centre_lines["gas_drive"]  # the only road without a kerb
    for part in network.terrain:  # harmonic: no bump above the verges
        beside_drive = np.linalg.norm(part.points[:, None, :2] - drive[None, :, :2], axis=2).min() < 3.0
        assert part.points[:, 2].min() >= (0.0 if beside_drive else 0.14) - 1e-6, part.path
        assert part.points[:, 2].max() <= 8.14 + 1e-6, part.path
    island = network.height(np.array([-0.5]), np.array([-0.5]))
    assert island[0] == pytest.approx(0.14)
    assert np.isnan(network.height(np.array([1e4]), np.array([0.0])))[0]


# Small towns, good and bad


def test_main_road_goes_before_side_road() -> None:
    graph = build_network(TownDescription.model_validate(small_town())).lanes
    ways = [lane for lane in graph.lanes.values() if lane.junction == "B"]
    main = [lane.priority for lane in ways if "_bc_" in lane.name.split("B_")[1][:6] or lane.name.startswith("B_bc")]
    side = [lane.priority for lane in ways if lane.name.startswith("B_ab")]
    assert main and side and min(main) > max(side)


def change(**parts: Any) -> dict[str, Any]:
    town = small_town()
    town["nodes"].update(parts.get("nodes", {}))
    town["roads"] += parts.get("roads", [])
    town["profiles"].update(parts.get("profiles", {}))
    return town


@pytest.mark.parametrize(
    ("town", "message"),
    [
        (change(nodes={"C": [80, 90, 12], "D": [0, 90, 12]}), r"road 'bc': grade 0\.\d+ between .* lengthen the slope"),
        (
            change(nodes={"P": [40, -60, 0]}, roads=[{"id": "end", "from": "A", "to": "P", "profile": "street"}]),
            "node 'P': roads that meet here: end; 2 or more are needed",
        ),
        (
            change(roads=[{"id": "cross", "from": "A", "to": "C", "profile": "street"}])
            | {"corner_radius": 5, "roads": [*small_town()["roads"], *({
                "id": f"x{k}", "from": a, "to": b, "profile": "street"} for k, (a, b) in enumerate(["AC", "BD"]))]},
            r"cross at \(40\.0, 45\.0\) with 0\.0 m between them; 5\.0 m are needed",
        ),
        (
            change(roads=[{"id": "close", "from": "A", "to": "B", "profile": "street", "via": [[40, 6, 10]]}]),
            r"open by 8\.5 deg; 30 deg or more",
        ),
        (change(nodes={"B": [30, 0, 0], "C": [30, 90, 0]}), "road 'ab': 30.0 m from node to node; its junctions need"),
        (change(profiles={"street": {"lanes": 1, "width": 2.5, "shoulder": 0.2, "centre": 0}}) | {"corner_radius": 3},
         "(has a radius of|from a kerb)"),
        (small_town() | {"props": {"signalled": ["A", "Q"]}}, "signalled = 'Q': names no junction; junctions are A, B"),
        (small_town() | {"props": {"give_way": ["A*", "rb_*"]}}, r"give_way = 'rb_\*': names no junction"),
    ],
    ids=["grade", "dead-end", "crossing", "angle", "short", "tight", "signals", "signs"],
)  # fmt: skip
def test_what_cannot_be_built_is_refused(town: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build_network(TownDescription.model_validate(town))


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        ({"profil": {}}, "profil = {}: unknown key; did you mean `profiles`"),
        ({"corner_radius": 1}, "corner_radius = 1: .*greater than or equal to 3"),
        ({"nodes": {"A": [1e6, 0, 0]}}, "nodes.A.0 = 1000000.0: -20,000 to 20,000 is needed"),
        ({"junctions": {"Q": {}}}, "'Q' is no node"),
        ({"roads": [{"id": "r", "from": "A", "to": "Z", "profile": "street"}]}, "road 'r': to = 'Z'; nodes are: A, B"),
        ({"roads": [{"id": "r", "from": "A", "to": "B", "profile": "x"}]}, "profile = 'x'; profiles are: street, wide"),
        ({"roads": [*small_town()["roads"], small_town()["roads"][0]]}, "ab names two roads"),
    ],
)
def test_loading_names_file_key_and_value(tmp_path: Path, edit: dict[str, Any], message: str) -> None:
    path = tmp_path / "town.yaml"
    path.write_text(yaml.safe_dump(small_town() | edit))
    with pytest.raises(ValueError, match=message) as caught:
        load_town(path)
    assert str(path) in str(caught.value)


def test_loading_a_missing_or_broken_file(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no such file"):
        load_town(tmp_path / "none.yaml")
    path = tmp_path / "town.yaml"
    path.write_text("a: [1")
    with pytest.raises(ValueError, match="not valid YAML"):
        load_town(path)
