"""Town05: size and roads of the real town, the elevated ring road, the skybridges, the car park, the glass corners."""

import numpy as np
import pytest
import shapely
from pxr import Usd

from mmw.config import load_config
from mmw.core.resources import configs_dir
from tests.fixtures import town_checks as checks
from tests.fixtures.meshes import plumb

NAME = "town05"


def heights_above(prim: Usd.Prim, xy: tuple[float, float]) -> np.ndarray:
    """Return the heights at which a plumb line meets the meshes at or below a prim [m], ascending."""
    corners = []
    for mesh in checks.meshes_below(prim):
        assert (np.array(mesh.GetFaceVertexCountsAttr().Get()) == 3).all()
        index = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
        corners.append(np.array(mesh.GetPointsAttr().Get(), np.float64)[index])
    return plumb(np.concatenate(corners), np.array([xy]))[0]


def test_extent_is_that_of_the_table(network):
    """Research table of the real town: x -271..202, y -200..199."""
    checks.assert_extent(network, (-271, 202), (-200, 199))


def test_ring_road_is_elevated(network):
    """More than 800 m long, more than 390 m of it 9.8 m up or higher, and both ends on the ground."""
    line = network.centre_lines["ring"]
    steps = np.linalg.norm(np.diff(line[:, :2], axis=0), axis=1)
    z = line[:, 2]
    assert steps.sum() >= 800
    assert steps[(z[:-1] >= 9.8) & (z[1:] >= 9.8)].sum() >= 400
    assert z.max() == pytest.approx(10.0, abs=0.01) and abs(z[[0, -1]]).max() < 0.01


def test_ramps_climb_gently(network):
    """One ramp is more than twice as long as the other; neither is steeper than 0.13, and the lanes follow them."""
    line = network.centre_lines["ring"]
    station = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(line[:, :2], axis=0), axis=1))]
    grade = np.diff(line[:, 2]) / np.diff(station)
    up, down = (np.diff(station)[side].sum() for side in (grade > 0.002, grade < -0.002))
    assert 80 < up < 130 and 240 < down < 300
    assert 0.09 < grade.max() < 0.13 and -0.05 < grade.min() < -0.035
    for lane in network.lanes.lanes.values():
        run = np.linalg.norm(np.diff(lane.points[:, :2], axis=0), axis=1)
        assert np.abs(np.diff(lane.points[:, 2]) / run).max() < 0.14, lane.name


def test_street_passes_below_the_deck(stage):
    """Clear height where the west street passes the ring road; the deck above it is 1.2 m thick."""
    at = (-239.0, 0.0)
    street = heights_above(stage.GetPrimAtPath("/Town/Roads"), at)
    deck = heights_above(stage.GetPrimAtPath("/Town/Bridges"), at)
    assert max(street) < 0.3
    assert 8.6 < deck[0] - max(street) < 9.0
    assert deck[-1] - deck[0] == pytest.approx(1.2, abs=0.15)


def test_piers_stand_beside_the_streets(stage, network):
    """Every pier reaches the ground, and none stands on a carriageway."""
    piers = checks.points_of(stage.GetPrimAtPath("/Town/Bridges/ring/piers"))
    feet = piers[piers[:, 2] < 0.5]
    assert len(feet) > 40 and feet[:, 2].max() < 0.0
    assert not shapely.intersects_xy(network.carriageway, *feet[:, :2].T).any()


def test_skybridges_hang_6_5_m_above_the_street(stage):
    """8 m wide, from one mall to the other, glass on both sides."""
    bridges = stage.GetPrimAtPath("/Town/Skybridges").GetChildren()
    assert len(bridges) == 2
    walls = [f"/Town/Buildings/mall_{side}/facade" for side in ("west", "east")]
    malls = [checks.points_of(stage.GetPrimAtPath(path)) for path in walls]
    for bridge in bridges:
        own = checks.points_of(bridge)
        assert own[:, 2].min() == pytest.approx(6.5, abs=0.05)
        assert np.ptp(own[:, 1]) == pytest.approx(8.0, abs=0.05)
        assert own[:, 0].min() == pytest.approx(malls[0][:, 0].max(), abs=0.1)
        assert own[:, 0].max() == pytest.approx(malls[1][:, 0].min(), abs=0.1)
        assert np.ptp(checks.points_of(bridge.GetChild("glass"))[:, 1]) > 7.5
        road = heights_above(stage.GetPrimAtPath("/Town/Roads"), (30.0, float(own[:, 1].mean())))
        under = heights_above(bridge.GetChild("underside"), (30.0, float(own[:, 1].mean())))
        assert under[0] - road[-1] == pytest.approx(6.5, abs=0.1)


def test_car_park_holds_about_70_cars(stage):
    """They stand on the car park, level, and none overlaps another."""
    plans = []
    for car in stage.GetPrimAtPath("/Town/Parked").GetChildren():
        assert car.GetAttribute("mmw:actor:role").Get() == "vehicle"
        points = checks.points_of(car)
        assert points[:, 2].min() == pytest.approx(0.0, abs=0.3)
        plans.append(shapely.convex_hull(shapely.multipoints(points[:, :2])))
    assert 60 <= len(plans) <= 80
    lots = shapely.box(-117, 15, -57, 81)
    assert all(shapely.contains(lots, plan) for plan in plans)
    first, second = shapely.STRtree(plans).query(plans, predicate="intersects")
    assert np.all(first == second)


def test_glass_stands_on_all_four_corners_of_the_business_crossroad(stage):
    """Tall buildings with large panes in every quadrant of (30, 0), within 60 m."""
    corners = {}
    for component, points in checks.components(stage, "Buildings"):
        glass = component.GetChild("glass")
        if not glass or np.ptp(points[:, 2]) < 25:
            continue
        bound = checks.material_of(checks.meshes_below(glass)[0].GetPrim()).GetName()
        offset = checks.points_of(glass)[:, :2] - (30.0, 0.0)
        if bound == "glass_facade" and np.hypot(*offset.T).min() < 60:
            corners.setdefault(tuple(np.sign(offset.mean(axis=0)).astype(int)), []).append(component.GetName())
    assert set(corners) == {(-1, -1), (-1, 1), (1, -1), (1, 1)}, corners


def test_the_unit_of_the_ring_road_stands_on_the_parapet(stage):
    (scenario,) = load_config(configs_dir() / "scenarios" / "town05_ring_road.yaml").scenarios
    at = scenario.rsus[0].position_m
    parapet = checks.points_of(stage.GetPrimAtPath("/Town/Bridges/ring/parapet"))
    near = parapet[np.abs(parapet[:, 1] - at[1]) < 15]  # the deck is straight here
    west = near[near[:, 0] < -239, 0]
    assert west.min() < at[0] < west.max() and abs(at[2] - near[:, 2].max()) < 0.02
