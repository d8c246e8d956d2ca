"""SUMO networks as towns: areas beside closed forms, floating-car data of SUMO on their lanes, faults."""

from pathlib import Path

import numpy as np
import pytest

from mmw.__main__ import main
from mmw.config import TrafficConfig
from mmw.traffic.demand import TrafficDemand
from mmw.traffic.engine import simulate_traffic
from mmw.traffic.roads.town_asset import open_town
from mmw.worlds.importers.formats import find_importer, read_scene
from tests.fixtures.recordings import fcd_of_car, net_street
from tests.fixtures.traffic_towns import CATALOG


def test_lanes_are_those_of_the_network(tmp_path: Path):
    (tmp_path / "s.net.xml").write_text(net_street())
    assert find_importer(tmp_path / "s.net.xml") == "sumo"
    scene = read_scene(tmp_path / "s.net.xml")
    assert scene.lanes is not None
    found = {lane.name: (lane.successors, lane.left, lane.right) for lane in scene.lanes.lanes.values()}
    assert found == {
        "road_a_1": (("road_b_1",), "road_a_2", ""), "road_a_2": (("road_b_2",), "", "road_a_1"),
        "road_b_1": ((), "road_b_2", ""), "road_b_2": ((), "", "road_b_1"),
    }  # fmt: skip
    areas: dict[str, float] = {}
    for part in scene.parts:
        if part.material != "curb":  # kerbs stand upright
            areas[part.label] = areas.get(part.label, 0.0) + float(part.mesh.areas.sum())
    # lanes with a gutter of 0.25 m and 0.6 m beyond their ends
    assert areas["road"] + areas["road_line"] == pytest.approx((80 + 1.2) * (7 + 0.5), rel=0.01)
    assert areas["sidewalk"] == pytest.approx((80 + 1.2) * (2 - 0.25), rel=0.02)


def test_floating_car_data_drives_on_the_lanes(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "s.net.xml").write_text(net_street())
    (tmp_path / "fcd.xml").write_text(fcd_of_car())
    assert main(["import", str(tmp_path / "s.net.xml"), "--out", str(tmp_path / "t")]) == 0
    town_file = tmp_path / "t" / "s.usda"
    assert main(["town", "check", str(town_file)]) == 0, capsys.readouterr().out
    center = (0.0, 0.0, 0.0)
    traffic = TrafficConfig(engine="replay", trajectories="fcd.xml", cav_ids=("31",), spawn_center_m=center)
    (track,) = simulate_traffic(TrafficDemand(open_town(town_file), traffic, CATALOG, 201, 1, tmp_path)).tracks
    assert track.poses[:, 1] == pytest.approx(1.75, abs=1e-3)
    assert np.diff(track.poses[:, 0]) * 100 == pytest.approx(8.0, rel=1e-3)


def test_faults_name_the_file(tmp_path: Path):
    path = tmp_path / "s.net.xml"
    path.write_text(net_street().replace('disallow="pedestrian"', 'allow="rail"'))
    with pytest.raises(ValueError, match=r"s.net.xml: no <lane> lets vehicles of class passenger in; one is needed"):
        read_scene(path)
    path.write_text(net_street().replace('shape="0,5.25 40,5.25"', 'shape="0,5.25 4000000,5.25"'))
    with pytest.raises(
        ValueError, match=r"lane 'b_2' reaches 4000 km from the origin; 20 km or less are needed; corre"
    ):
        read_scene(path)
    path.write_text("<routes/>")
    with pytest.raises(ValueError, match=r"s.net.xml: root element <routes>; <net> is needed"):
        read_scene(path)
