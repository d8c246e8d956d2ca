"""Town07: size and roads of the real town, the hill, the open crossroad, the silos beside the single-lane road."""

import numpy as np
import pytest
import shapely

from mmw.worlds.towns.description import load_town
from tests.fixtures import town_checks as checks

NAME = "town07"


def test_extent_and_junctions_are_those_of_the_table(network):
    """Research table: x -203..84, y -123..247; 28 junctions of three arms and 3 of four; 2.32 km between junctions."""
    checks.assert_extent(network, (-203, 84), (-123, 247))
    description = load_town(checks.folder_of(NAME) / f"{NAME}.yaml")
    arms = [sum(node in (road.start, road.end) for road in description.roads) for node in description.nodes]
    assert sorted(arms) == [3] * 28 + [4] * 3
    assert description.nodes["K"][:2] == (-4, 3)
    between = sum(shapely.LineString(line).length for line in network.centre_lines.values())
    assert 1900 < between < 2800


def test_roads_are_narrow(network):
    """7.2 m between the edges of a rural road, no walk; one lane a direction everywhere."""
    checks.assert_widths(network, network.centre_lines["w2_w3"], 7.2, 7.2 + 2 * 1.5)
    assert not any(lane.left or lane.right for lane in network.lanes.lanes.values())


def test_hill_road_rises_at_eight_to_nine_percent_at_most(lanes):
    """From 0 to 9.4 m, and no lane of the town is steeper than 9 % by more than what the inside of a bend adds."""
    heights = np.concatenate([lane.points[:, 2] for lane in lanes.lanes.values()])
    assert heights.min() > -0.01 and heights.max() == pytest.approx(9.4, abs=0.01)
    steepest = {}
    for name, lane in lanes.lanes.items():
        step = np.diff(lane.points, axis=0)
        steepest[name] = float(np.max(np.abs(step[:, 2]) / np.hypot(step[:, 0], step[:, 1])))
    assert 0.07 < max(steepest[name] for name in ("w4_n2_f0", "n2_t4_f0")) < 0.1
    assert max(steepest.values()) < 0.11


def test_roads_wind(network):
    """At least a third of the road length lies in bends."""
    bent = whole = 0.0
    for line in network.centre_lines.values():
        step = np.diff(line[:, :2], axis=0)
        length, heading = np.linalg.norm(step, axis=1), np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
        bent += float(length[1:][np.abs(np.diff(heading)) > 0.005].sum())
        whole += float(length.sum())
    assert bent > whole / 3


def test_silos_stand_close_to_the_single_lane_road(stage, network):
    """Three brick cylinders of 6 m and 12 to 16 m height, within 12 m of the road's middle and off its surface."""
    road = shapely.LineString(network.centre_lines["ss1_ss2"][:, :2])
    walls = [prim for prim in stage.GetPrimAtPath("/Town/Props").GetChildren() if prim.GetName().startswith("silo")]
    assert len(walls) == 3
    for prim in walls:
        own = checks.points_of(prim.GetChild("wall"))
        size = np.ptp(own, axis=0)
        assert size[:2] == pytest.approx([6, 6], abs=0.15) and 12 < own[:, 2].max() - 0.0 < 16.5
        middle = shapely.Point(0.5 * (own.min(axis=0) + own.max(axis=0))[:2])
        assert 3.6 + 3.0 < shapely.distance(road, middle) < 12
        bound = checks.material_of(prim.GetChild("wall"))
        assert bound.GetAttribute("mmw:radio:itu").Get() == "itu_brick"


def test_crossroad_is_open(stage):
    """Within 45 m of the crossroad nothing is taller than a person, but signs and a house."""
    tall = []
    for group in ("Buildings", "Props"):
        for prim, points in checks.components(stage, group):
            if np.hypot(*(points[:, :2].mean(axis=0) - (-4, 3))) < 45 and points[:, 2].max() > 2.0:
                tall.append(prim.GetName())
    assert sum("sign" not in name for name in tall) <= 3, tall


def test_houses_are_of_brick(stage):
    found = [
        checks.material_of(prim.GetChild("facade")).GetName()
        for prim in stage.GetPrimAtPath("/Town/Buildings").GetChildren()
    ]
    assert len(found) > 50 and set(found) == {"brick_facade"}
