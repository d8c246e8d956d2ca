"""Lanes of OpenStreetMap extracts, by way of SUMO's netconvert (extra osm)."""

import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest
import shapely

from mmw.core.errors import InputError, MissingPackageError
from mmw.core.mesh import merge
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.osm.bounds import read_bbox
from mmw.worlds.importers.osm.driving_side import tell_driving_side
from mmw.worlds.importers.osm.feature import Extract
from mmw.worlds.importers.osm.ground import KERB_HEIGHT
from mmw.worlds.importers.osm.read_osm import read_osm
from mmw.worlds.importers.sumo.netconvert import find_netconvert
from mmw.worlds.importers.sumo.plan import KERB
from tests.fixtures.meshes import area
from tests.fixtures.osm_files import ORIGIN, Map, needs_netconvert, quarter, to_degrees


def read(tmp_path: Path, town: Map, **options: str) -> ImportedScene:
    needs_netconvert()
    path = tmp_path / "extract.osm"
    path.write_text(town.text())
    return read_osm(path, ORIGIN, traffic=True, **options)


def lanes_of(scene: ImportedScene) -> LaneGraph:
    assert scene.lanes is not None
    return scene.lanes


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> ImportedScene:
    return read(tmp_path_factory.mktemp("osm"), quarter())


def plan_of(scene: ImportedScene, *labels: str) -> shapely.Geometry:
    corners = [part.points[part.faces][:, :, :2] for part in scene.parts if part.label in labels]
    return shapely.union_all(shapely.polygons(np.concatenate(corners)), grid_size=1e-4)


def test_lanes_lie_in_the_frame_of_the_buildings(town: ImportedScene) -> None:
    # street A lies on y = 0: lanes on the right, half a lane's width from it
    roads = [lane for lane in lanes_of(town).lanes.values() if not lane.junction]
    east = [lane for lane in roads if abs(lane.points[0, 1] - lane.points[-1, 1]) < 0.1 and len(lane.points) > 20]
    assert len(east) == 4
    for lane in east:
        forward = np.sign(lane.points[-1, 0] - lane.points[0, 0])
        np.testing.assert_allclose(lane.points[:, 1], -forward * 0.5 * lane.width, atol=0.02)
        assert np.abs(lane.points[:, 0]).max() == pytest.approx(100, abs=0.02)  # the ends of the way
        assert np.diff(lane.station).max() <= 2.0
        assert np.all(lane.points[:, 2] == 0)


def test_every_arm_of_the_crossing_leads_to_the_three_others(town: ImportedScene) -> None:
    graph = lanes_of(town)
    arms = [lane for lane in graph.lanes.values() if lane.successors and not lane.junction]
    assert len(arms) == 4
    for lane in arms:
        onward = {graph.lanes[name].successors[0] for name in lane.successors}
        assert len(onward) == 3
        for name in lane.successors:
            through = graph.lanes[name]
            np.testing.assert_array_equal(through.points[0], lane.points[-1])
            np.testing.assert_array_equal(through.points[-1], graph.lanes[through.successors[0]].points[0])


def test_asphalt_lies_under_every_lane_and_nothing_stands_on_it(town: ImportedScene) -> None:
    paved = plan_of(town, "road", "road_line").buffer(1e-3)
    for lane in lanes_of(town).lanes.values():
        assert paved.covers(shapely.LineString(lane.points[:, :2]).buffer(1.2, cap_style="flat")), lane.name
    for part in town.parts:
        low = part.points[part.faces].min(axis=1)[:, 2] < 4.5
        if part.label in ("building", "vegetation") and low.any():
            near = shapely.multipoints(part.points[np.unique(part.faces[low])][:, :2])
            assert not any(
                shapely.LineString(lane.points[:, :2]).distance(near) < 1.25 for lane in lanes_of(town).lanes.values()
            ), part.path


def test_the_ground_has_no_gaps_and_sidewalks_go_on_around_the_corner(town: ImportedScene) -> None:
    ground = [p for p in town.parts if p.label in ("road", "road_line", "sidewalk", "terrain", "water")]
    flat = [p for p in ground if "kerb" not in p.path]
    low = np.min([part.points[:, :2].min(axis=0) for part in flat], axis=0)
    high = np.max([part.points[:, :2].max(axis=0) for part in flat], axis=0)
    assert area(merge(flat)) == pytest.approx(float(np.prod(high - low)), rel=1e-6)
    raised = [p for p in flat if "raised" in p.path]
    assert raised and all(np.all(part.points[:, 2] == KERB_HEIGHT) for part in raised)
    kerbs = merge([p for p in ground if "kerb" in p.path])
    corners = shapely.union_all(shapely.polygons(np.concatenate([p.points[p.faces][..., :2] for p in raised])))
    assert area(kerbs) == pytest.approx(KERB_HEIGHT * corners.buffer(1e-4).length, rel=0.01)
    pieces = shapely.get_parts(corners.buffer(0.01))
    assert sum(piece.area > 5 for piece in pieces) == 4  # one in each quarter of the crossing


def test_inner_corners_of_the_kerb_are_round(town: ImportedScene) -> None:
    # closing with a disc fills every inner corner of a smaller radius; 1.5 m^2 where bends end in steps
    paved = plan_of(town, "road", "road_line")
    filled = shapely.difference(paved.buffer(0.9 * KERB).buffer(-0.9 * KERB), paved)
    assert shapely.intersection(filled, shapely.box(-14, -14, 14, 14)).area < 0.05


def test_left_hand_traffic(tmp_path: Path) -> None:
    scene = read(tmp_path, quarter(), driving_side="left")
    lane = max(lanes_of(scene).lanes.values(), key=lambda lane: lane.points[-1, 0] - lane.points[0, 0])
    assert np.all(lane.points[:, 1] > 1.0)


def test_bbox_cuts_lanes_and_ground(tmp_path: Path) -> None:
    (south, west), (north, east) = to_degrees(-60, -50), to_degrees(40, 60)
    scene = read(tmp_path, quarter(), bbox=f"{west},{south},{east},{north}")
    every = np.concatenate([lane.points for lane in lanes_of(scene).lanes.values()])
    np.testing.assert_allclose(every[:, :2].min(axis=0), [-60, -50], atol=0.05)
    np.testing.assert_allclose(every[:, :2].max(axis=0), [40, 60], atol=0.05)


def test_lights_of_facing_arms_are_green_together(tmp_path: Path) -> None:
    town = quarter()
    town.ways = town.ways.replace('"lanes" v="2"', '"lanes" v="4"')
    text = town.text().replace(f'<node id="{town.node(0, 0)}" ', f'<node id="{town.node(0, 0)}" version="1" ')
    marker = f'id="{town.node(0, 0)}" version="1" '
    start = text.index(marker)
    end = text.index("/>", start)
    text = f'{text[:end]}><tag k="highway" v="traffic_signals"/></node>{text[end + 2 :]}'
    needs_netconvert()
    path = tmp_path / "lights.osm"
    path.write_text(text)
    scene = read_osm(path, ORIGIN, traffic=True)
    graph = lanes_of(scene)
    phases: dict[str, set[str]] = {"x": set(), "y": set()}
    for lane in graph.lanes.values():
        for name in lane.successors:
            if graph.lanes[name].signal:
                along = np.abs(lane.points[-1] - lane.points[0])
                phases["x" if along[0] > along[1] else "y"].add(graph.lanes[name].signal)
    assert len(phases["x"]) == len(phases["y"]) == 1 and phases["x"] != phases["y"]
    assert sum(part.path.endswith("/post") for part in scene.parts) == 4


def test_a_bridge_over_another_road_has_no_lanes(tmp_path: Path) -> None:
    town = Map()
    town.way([(-100, 0), (100, 0)], {"highway": "residential"})
    town.way([(0, -80), (0, 80)], {"highway": "primary", "bridge": "yes", "layer": "1"})
    scene = read(tmp_path, town)
    every = np.concatenate([lane.points for lane in lanes_of(scene).lanes.values()])
    assert np.abs(every[:, 1]).max() < 5
    assert any("1 roads that cross others on a bridge have no lanes" in note for note in scene.notes)


def test_negative_ids_and_a_building_in_the_road(tmp_path: Path) -> None:
    town = Map()
    town.way([(-100, 0), (100, 0)], {"highway": "tertiary", "lanes": "2"})
    town.box(-5, -8, 12, 16, building="yes", height="12")
    needs_netconvert()
    path = tmp_path / "josm.osm"
    path.write_text(town.text().replace('id="', 'id="-').replace('ref="', 'ref="-'))
    scene = read_osm(path, ORIGIN, traffic=True)
    assert len(lanes_of(scene).lanes) == 2
    walls = [part for part in scene.parts if part.label == "building"]
    assert any(part.points[:, 2].min() > 4.5 for part in walls)


def test_without_roads_there_is_no_traffic(tmp_path: Path) -> None:
    town = Map()
    town.box(0, 0, 10, 10, building="yes")
    path = tmp_path / "houses.osm"
    path.write_text(town.text())
    with pytest.raises(InputError, match="no road that cars may use"):
        read_osm(path, traffic=True)


def test_without_netconvert_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda *_, **__: None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda *_: None)
    with pytest.raises(MissingPackageError, match=r"netconvert, which is not installed; pip install .*\[osm\]"):
        find_netconvert()


@pytest.mark.parametrize("text", ["1,2,3", "a,b,c,d", "2,1,1,2", "1,2,2,1", "0,0,181,1", "nan,0,1,1"])
def test_bbox_messages(text: str) -> None:
    with pytest.raises(InputError, match=r"--bbox .*WEST,SOUTH,EAST,NORTH"):
        read_bbox(text)


@pytest.mark.parametrize(
    ("place", "side"),
    [
        ((51.5, -0.1), "left"), ((53.35, -6.3), "left"), ((35.7, 139.7), "left"), ((-33.9, 151.2), "left"),
        ((-36.8, 174.8), "left"), ((28.6, 77.2), "left"), ((13.7, 100.5), "left"), ((1.35, 103.8), "left"),
        ((-6.2, 106.8), "left"), ((-26.2, 28.0), "left"), ((-1.3, 36.8), "left"), ((22.3, 114.2), "left"),
        ((48.9, 2.3), "right"), ((50.95, 1.86), "right"), ((40.7, -74.0), "right"), ((37.57, 127.0), "right"),
        ((25.05, 121.5), "right"), ((22.55, 114.1), "right"), ((30.0, 31.2), "right"), ((-23.5, -46.6), "right"),
        ((16.8, 96.2), "right"), ((9.0, 38.7), "right"), ((35.2, 129.1), "right"), ((52.5, 13.4), "right"),
    ],
)  # fmt: skip
def test_driving_side_by_place(place: tuple[float, float], side: str) -> None:
    assert tell_driving_side(Extract(Path("x.osm"), place), "")[0] == side
    assert tell_driving_side(Extract(Path("x.osm"), place), "right") == ("right", "as given")
