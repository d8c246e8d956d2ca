"""CommonRoad lanelets: lanes and areas beside closed forms, traffic of the same file on them, faults."""

from pathlib import Path

import numpy as np
import pytest

from mmw.__main__ import main
from mmw.config import TrafficConfig
from mmw.traffic.demand import TrafficDemand
from mmw.traffic.engine import simulate_traffic
from mmw.traffic.roads.town_asset import open_town
from mmw.worlds.importers.commonroad import SHOULDER
from mmw.worlds.importers.formats import find_importer, read_scene
from mmw.worlds.importers.osm.ground import MARGIN
from tests.fixtures.import_files import write_mitsuba
from tests.fixtures.recordings import lanelet_scenario
from tests.fixtures.traffic_towns import CATALOG

EXPECTED = {
    "lanelet_1": (("lanelet_3",), "lanelet_2", "", 13.89), "lanelet_2": (("lanelet_4",), "", "lanelet_1", 50 / 3.6),
    "lanelet_3": ((), "lanelet_4", "", 50 / 3.6), "lanelet_4": ((), "", "lanelet_3", 50 / 3.6),
}  # fmt: skip
"""Successors, left and right neighbor and speed of each lane: two of 40 m side by side, and two behind them."""


def test_lanes_and_areas_are_those_of_the_lanelets(tmp_path: Path):
    (tmp_path / "s.xml").write_text(lanelet_scenario())
    scene = read_scene(tmp_path / "s.xml")
    assert scene.lanes is not None
    found = {lane.name: (lane.successors, lane.left, lane.right, lane.speed) for lane in scene.lanes.lanes.values()}
    assert found == EXPECTED
    for name, y, start in (("lanelet_1", 1.75, -40.0), ("lanelet_2", 5.25, -40.0), ("lanelet_3", 1.75, 0.0)):
        lane = scene.lanes.lanes[name]
        assert lane.points[[0, -1]] == pytest.approx(np.array([[start, y, 0.0], [start + 40.0, y, 0.0]]))
        assert np.linalg.norm(np.diff(lane.points, axis=0), axis=1).max() <= 1.0 + 1e-9
        assert lane.width == pytest.approx(3.5)
    areas: dict[str, float] = {}
    for part in scene.parts:
        areas[part.label] = areas.get(part.label, 0.0) + float(part.mesh.areas.sum())
    road, walk = (80 + 2 * SHOULDER) * (7 + 2 * SHOULDER), 80 * (2.0 - SHOULDER)
    assert areas["road"] == pytest.approx(road, rel=1e-4)
    assert areas["sidewalk"] == pytest.approx(walk, rel=1e-4)
    width, depth = 80 + 2 * SHOULDER + 2 * MARGIN, 7 + SHOULDER + 2.0 + 2 * MARGIN
    assert sum(areas.values()) == pytest.approx(width * depth, rel=1e-4)


def test_the_traffic_of_the_file_drives_on_its_lanelets(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Also 500 km from the origin of the file, where roads and trajectories move together."""
    for x in (0.0, 500_000.0):
        source = tmp_path / f"s{x:.0f}.xml"
        source.write_text(lanelet_scenario(x))
        out = tmp_path / f"t{x:.0f}"
        assert main(["import", str(source), "--out", str(out)]) == 0
        town_file = out / f"{source.stem}.usda"
        assert main(["town", "check", str(town_file)]) == 0, capsys.readouterr().out
        traffic = TrafficConfig(
            engine="replay", trajectories=source.name, cav_ids=("31",), spawn_center_m=(0.0, 0.0, 0.0)
        )
        demand = TrafficDemand(open_town(town_file), traffic, CATALOG, 201, 1, tmp_path)
        (track,) = simulate_traffic(demand).tracks
        assert track.poses[:, 1] == pytest.approx(1.75, abs=1e-3)
        assert np.diff(track.poses[:, 0]) * 100 == pytest.approx(8.0, rel=1e-3)


def test_xml_files_are_told_apart_by_their_root(tmp_path: Path):
    (tmp_path / "s.xml").write_text(lanelet_scenario())
    (tmp_path / "broken.xml").write_text("<scene")
    assert find_importer(tmp_path / "s.xml") == "commonroad"
    assert find_importer(write_mitsuba(tmp_path / "m")) == "mitsuba"
    assert find_importer(tmp_path / "broken.xml") == "mitsuba"


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("<x>-40.0</x>", "<x>west</x>", r"<lanelet id='1'> leftBound point 0 x is 'west'; a number is needed; correct"),
        ("<x>-40.0</x>", "<x>1e7</x>", r"<lanelet id='1'> reaches .* km from the origin; 20 km or less are needed"),
        ('lanelet id="2"', 'lanelet id="1"', r"<lanelet id='1'>: there is another one of this id; ids must differ"),
        ("<additionalValue>13.89", "<additionalValue>fast", r"<trafficSign id='90'> additionalValue is 'fast'"),
        ("lanelet id", "lane id", r"<commonRoad> has no <lanelet> with two bounds"),
    ],
)
def test_faults_name_the_lanelet(old: str, new: str, match: str, tmp_path: Path):
    text = lanelet_scenario()
    (tmp_path / "s.xml").write_text(
        text.replace(old, new, 1) if old != "lanelet id" else text.replace("lanelet", "lane")
    )
    with pytest.raises(ValueError, match=match):
        read_scene(tmp_path / "s.xml")


def test_bad_links_cost_the_link(tmp_path: Path):
    text = lanelet_scenario().replace('<successor ref="3"/>', '<successor ref="77"/>')
    text = text.replace('<successor ref="4"/>', '<successor ref="3"/>')
    (tmp_path / "s.xml").write_text(text)
    scene = read_scene(tmp_path / "s.xml")
    assert scene.lanes is not None
    assert not any(lane.successors for lane in scene.lanes.lanes.values())
    assert "links between lanelets left out, over 0.5 m apart: 1" in scene.notes
    assert "links between lanelets left out, to lanelets that do not exist: 1" in scene.notes
