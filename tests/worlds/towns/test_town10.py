"""Town10: size and roads of the real town, the H with its U-turns, the arcs, the wide skybridge."""

import numpy as np
import pytest
import shapely

from mmw.worlds.towns.description import load_town
from tests.fixtures import town_checks as checks
from tests.fixtures.meshes import part_at

NAME = "town10"


def test_extent_and_junctions_are_those_of_the_table(network):
    """Research table of the real town: x -112..108, y -136..67; 8 junctions of three arms and 1 of four; level."""
    checks.assert_extent(network, (-112, 108), (-136, 67))
    description = load_town(checks.folder_of(NAME) / f"{NAME}.yaml")
    arms = [sum(node in (road.start, road.end) for road in description.roads) for node in description.nodes]
    assert sorted(arms) == [3] * 8 + [4]
    assert description.nodes["X"][:2] == (-47, -19)
    between = sum(shapely.LineString(line).length for line in network.centre_lines.values())
    assert 600 < between < 1000  # the table has 820 m outside junctions
    assert max(abs(lane.points[:, 2]).max() for lane in network.lanes.lanes.values()) < 1e-6


def test_streets_are_wide(network):
    """Between the outer edges of the walks: 31.2 m for a street, 36.7 m with a median, and the kerbs."""
    for road, width, paved in (("x_a", 31.2, 19.2), ("n2_a", 36.7, 19.8)):
        verges = 2 * (0.5 + 0.15)  # of the profile: grass and kerb stone
        checks.assert_widths(network, network.centre_lines[road], paved, width + verges)


def test_crossroad_is_a_box_of_38_by_44_m(network):
    size = np.ptp(part_at(network.parts, "Roads/junction_X/asphalt").mesh.bounds, axis=0)
    assert sorted(size[:2]) == pytest.approx([38, 44], abs=2.5)


def test_curvy_road_winds(network):
    """Two arcs of 34.8 to 42 m that turn by 78 to 91 degrees to the right, and bends to either side between them."""
    line = network.centre_lines["n2_s2"]
    heading = np.unwrap(np.arctan2(*np.diff(line[:, :2], axis=0).T[::-1]))
    radii, bend = checks.arc_radii(line), np.degrees(np.diff(heading))
    sharp = (radii > 33) & (radii < 43) & (bend < -0.5)
    begins = np.flatnonzero(np.diff(np.r_[0, sharp.astype(int)]) == 1)
    ends = np.flatnonzero(np.diff(np.r_[sharp.astype(int), 0]) == -1)
    turns = [float(-bend[a : b + 1].sum()) for a, b in zip(begins, ends, strict=True)]
    wide = [turn for turn in turns if turn > 40]
    assert len(wide) == 2 and min(wide) > 74 and max(wide) < 92
    between = bend[ends[0] + 2 : begins[-1] - 1]
    assert between[between > 0].sum() > 10 and between[between < 0].sum() < -10
    assert radii.min() > 33


def test_vehicles_may_turn_back_on_the_bars_of_the_h(lanes):
    """From either bar a U-turn leads back onto the same road, at a radius that a car can drive."""
    back = [lane for lane in lanes.lanes.values() if lane.junction and abs(abs(checks.turned(lane)) - 180) < 15]
    roads = {lane.successors[0].rsplit("_", 1)[0] for lane in back}
    assert roads >= {"n1_x", "x_b", "b_s1", "n2_a", "a_c", "c_s2"}
    before = lanes.predecessors
    for lane in back:
        (first,) = before[lane.name]
        (last,) = lane.successors
        assert first.rsplit("_", 1)[0] == last.rsplit("_", 1)[0] and first != last
        assert checks.turned(lane) > 0  # traffic keeps to the right
        assert checks.arc_radii(lane.points).min() > 4.9


def test_skybridge_crosses_the_boulevard(stage, network):
    """25 m wide, underside 7 m above the carriageway all the way across, between two buildings."""
    points = np.concatenate([p for _, p in checks.components(stage, "Skybridges")])
    low, high = points.min(axis=0), points.max(axis=0)
    assert high[1] - low[1] == pytest.approx(25.0, abs=0.01)
    (bridge,) = stage.GetPrimAtPath("/Town/Skybridges").GetChildren()
    own = checks.points_of(bridge.GetChild("underside"))
    assert np.allclose(own[:, 2], 7.0, atol=1e-3)
    deck = shapely.box(*own[:, :2].min(axis=0), *own[:, :2].max(axis=0))
    columns = checks.points_of(bridge.GetChild("columns"))
    assert np.abs(columns[:, 0] - 42).max() < 2.45 and columns[:, 2].min() < 0  # they stand on the median
    road = shapely.LineString(network.centre_lines["n2_a"][:, :2]).buffer(19.0)
    crossed = shapely.intersection(road, shapely.box(-500, low[1], 500, high[1]))
    assert shapely.difference(crossed, deck).area < 0.01 * crossed.area
    for name, x in (("bridge_west", low[0]), ("bridge_east", high[0])):
        own = checks.points_of(stage.GetPrimAtPath(f"/Town/Buildings/{name}"))
        assert own[:, 0].min() - 0.5 < x < own[:, 0].max() + 0.5 and own[:, 2].max() > 20
