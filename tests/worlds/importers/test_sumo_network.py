"""SUMO networks: lanes, connections and lines, against a hand-written network and closed forms."""

from pathlib import Path

import numpy as np
import pytest

from mmw.core.errors import InputError
from mmw.worlds.importers.sumo.lanes import build_lanes
from mmw.worlds.importers.sumo.network import read_network
from mmw.worlds.importers.sumo.plan import plan_roads
from mmw.worlds.importers.sumo.smooth_line import OFF, TURN, curve, resampled, rounded
from mmw.worlds.towns.plan_geometry import row_stations

CAR = 'disallow="pedestrian"'
NET = f"""<net version="1.20">
  <edge id=":J_0" function="internal"><lane id=":J_0_0" index="0" {CAR} speed="8" length="12" shape="0,-1.6 12,-1.6"/>
  </edge>
  <edge id=":J_1" function="internal"><lane id=":J_1_0" index="0" {CAR} speed="5" length="9" shape="0,-1.6 4,-3 6,-8"/>
  </edge>
  <edge id="a" from="W" to="J" type="highway.primary">
    <lane id="a_0" index="0" allow="pedestrian" speed="13" length="50" width="2" shape="-50,-4.2 0,-4.2"/>
    <lane id="a_1" index="1" {CAR} speed="13" length="50" width="3.2" shape="-50,-1.6 0,-1.6"/>
  </edge>
  <edge id="-b" from="J" to="E" type="highway.primary">
    <lane id="-b_0" index="0" {CAR} speed="13" length="50" shape="12,-1.6 62,-1.6"/>
  </edge>
  <edge id="c" from="J" to="S"><lane id="c_0" index="0" {CAR} speed="13" length="50" shape="6,-8 6,-58"/></edge>
  <junction id="J" type="traffic_light" x="6" y="0" shape="0,0 0,-5.2 4.4,-8 7.6,-8 12,-3.2 12,0"/>
  <connection from="a" to="-b" fromLane="1" toLane="0" via=":J_0_0" tl="J" linkIndex="0" dir="s" state="O"/>
  <connection from="a" to="c" fromLane="1" toLane="0" via=":J_1_0" tl="J" linkIndex="1" dir="r" state="o"/>
  <connection from=":J_0" to="-b" fromLane="0" toLane="0" dir="s" state="M"/>
</net>"""


def network(tmp_path: Path, text: str = NET):
    path = tmp_path / "x.net.xml"
    path.write_text(text)
    return read_network(path)


def test_lanes_and_connections(tmp_path: Path) -> None:
    graph, notes = build_lanes(network(tmp_path))
    assert not notes
    assert sorted(n for n in graph.lanes if n.startswith("road")) == ["road_a_1", "road_bb_0", "road_c_0"]
    through = {lane.successors[0]: lane for lane in graph.lanes.values() if lane.junction}
    assert set(graph.lanes["road_a_1"].successors) == {lane.name for lane in through.values()}
    straight, right = through["road_bb_0"], through["road_c_0"]
    assert straight.junction == right.junction == "junction_J"
    assert straight.priority > right.priority and straight.speed == 8
    for lane in through.values():  # no gap, no kink
        for end, other, at in ((0, graph.lanes["road_a_1"], -1), (-1, graph.lanes[lane.successors[0]], 0)):
            np.testing.assert_array_equal(lane.points[end], other.points[at])
            apart = lane.headings[0 if end == 0 else -1] - other.headings[at]
            assert abs(np.angle(np.exp(1j * apart))) < np.radians(6)
    assert straight.signal == right.signal == ""  # one arm alone has no light to wait for


def test_plan_parts_carriageway_and_sidewalk(tmp_path: Path) -> None:
    net = network(tmp_path)
    graph, _ = build_lanes(net)
    plan = plan_roads(net, graph)
    assert plan["walk"].intersection(plan["paved"]).area < 1e-3
    assert plan["walk"].area == pytest.approx(50 * 2 - 0.25 * 50, rel=0.1)  # the gutter is taken from the sidewalk
    assert plan["paint"].within(plan["paved"])
    for lane in graph.lanes.values():
        assert all(plan["paved"].covers(p) for p in map(_point, lane.points[1:-1]))


def _point(xyz: np.ndarray):
    import shapely

    return shapely.Point(xyz[:2])


@pytest.mark.parametrize("bend_deg", [5.0, 30.0, 90.0, 140.0])
def test_rounded_corners_have_tangents_and_stay_near(bend_deg: float) -> None:
    bend = np.radians(bend_deg)
    line = np.array([[-200.0, 0], [0, 0], 200 * np.array([np.cos(bend), np.sin(bend)])])
    arc = rounded(line)
    heading = np.unwrap(np.arctan2(*np.diff(arc, axis=0).T[::-1]))
    assert np.abs(np.diff(heading)).max() < np.radians(3.1)
    assert heading[-1] - heading[0] == pytest.approx(bend, abs=1e-9)
    away = float(np.linalg.norm(arc, axis=1).min())  # closed form: R (1 / cos(bend / 2) - 1)
    assert away <= max(OFF, TURN * (1 / np.cos(bend / 2) - 1)) * 1.001
    np.testing.assert_array_equal(arc[[0, -1]], line[[0, -1]])


def test_curve_is_nearly_a_quarter_circle_and_resampling_keeps_corners() -> None:
    quarter = curve(np.array([1.0, 0]), np.array([0.0, 1]), np.array([0.0, 1]), np.array([-1.0, 0]))
    np.testing.assert_allclose(np.linalg.norm(quarter, axis=1), 1.0, atol=1e-3)
    line = np.array([[0.0, 0], [2.5, 0], [2.5, 7]])
    fine = resampled(line, 1.0)
    assert np.diff(row_stations(fine)).max() <= 1.0 + 1e-12
    assert any((fine == line[1]).all(axis=1))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('speed="8"', 'speed="fast"', r"lane ':J_0_0': speed = 'fast'; a number from 0 to 1000 is needed"),
        ('shape="-50,-1.6 0,-1.6"', 'shape="-50,-1.6"', "lane 'a_1': shape '-50,-1.6'; 2 different points are needed"),
        ('shape="-50,-1.6 0,-1.6"', 'shape="a,b c,d"', "pairs of numbers are needed"),
        ('shape="-50,-1.6 0,-1.6"', 'shape="1e9,0 0,0"', "coordinates below 1e8 m are needed"),
    ],
)
def test_messages(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        network(tmp_path, NET.replace(old, new))
