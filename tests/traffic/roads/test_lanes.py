"""Lanes: the graph, and its round trip through USD."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.traffic.roads.lane_prims import read_lanes, write_lanes
from tests.fixtures.stages import new_stage


def make_graph() -> LaneGraph:
    """Two roads joined by a left turn and by a connection straight on."""
    straight = np.array([[0.0, 0, 1], [1, 0, 1], [2, 0, 1.5]])
    arc = np.radians([0, 30, 60, 90])
    turn = np.stack([2 + np.sin(arc), 1 - np.cos(arc), np.full(4, 1.5)], axis=1)
    return LaneGraph(
        {
            "a_f0": Lane("a_f0", straight, 3.5, 13.9, successors=("N_left", "N_on")),
            "N_left": Lane("N_left", turn, 3.5, 8.3, "N", 31, ("b_f0",)),
            "N_on": Lane("N_on", straight + np.array([2, 0, 0.5]), 3.25, 13.9, "N", 33, ()),
            "b_f0": Lane("b_f0", np.array([[3.0, 1, 1.5], [3, 3, 1.5]]), 3.5, 11.1),
        }
    )


def test_station_is_arc_length() -> None:
    lane = make_graph().lanes["a_f0"]
    np.testing.assert_allclose(lane.station, [0, 1, 1 + np.hypot(1, 0.5)], rtol=1e-15)
    assert lane.length == lane.station[-1]


def test_predecessors_are_the_reverse_of_successors() -> None:
    graph = make_graph()
    assert graph.predecessors == {"a_f0": (), "N_left": ("a_f0",), "N_on": ("a_f0",), "b_f0": ("N_left",)}


def test_kinks_are_changes_of_heading() -> None:
    kinks = make_graph().kinks()
    assert kinks["a_f0", "N_on"] == pytest.approx(0, abs=1e-12)
    assert np.degrees(kinks["a_f0", "N_left"]) == pytest.approx(15)  # half of the first 30 deg of the arc
    assert np.degrees(kinks["N_left", "b_f0"]) == pytest.approx(15)


def test_unknown_successor_is_an_error() -> None:
    with pytest.raises(ValueError, match="leads to 'nowhere', which does not exist"):
        LaneGraph({"a": Lane("a", np.zeros((2, 3)), 3.5, 10, successors=("nowhere",))})


def test_usd_round_trip_keeps_everything(tmp_path: Path) -> None:
    graph, stage = make_graph(), new_stage(tmp_path / "lanes.usda")
    write_lanes(stage, "/Town/Lanes", graph)
    again = read_lanes(stage, "/Town")
    assert sorted(again.lanes) == sorted(graph.lanes)
    for name, lane in graph.lanes.items():
        other = again.lanes[name]
        np.testing.assert_allclose(other.points, lane.points, rtol=0, atol=1e-6)  # float32 in the file
        assert (other.junction, other.priority, other.successors) == (lane.junction, lane.priority, lane.successors)
        assert (other.width, other.speed) == pytest.approx((lane.width, lane.speed), rel=1e-7)


def test_lane_prims_are_guides_with_extent() -> None:
    stage = Usd.Stage.CreateInMemory()
    write_lanes(stage, "/Town/Lanes", make_graph())
    curve = UsdGeom.BasisCurves.Get(stage, "/Town/Lanes/N_left")
    assert curve.ComputePurpose() == UsdGeom.Tokens.guide
    assert curve.GetTypeAttr().Get() == UsdGeom.Tokens.linear
    low, high = np.array(curve.GetExtentAttr().Get())
    points = np.array(curve.GetPointsAttr().Get())
    np.testing.assert_array_equal(low, points.min(axis=0))
    np.testing.assert_array_equal(high, points.max(axis=0))


def test_lanes_follow_the_transform_of_the_town(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "lanes.usda")
    town = UsdGeom.Xform.Define(stage, "/World/Town")
    town.AddTranslateOp().Set(Gf.Vec3d(100, 0, 5))
    town.AddRotateZOp().Set(90)
    write_lanes(stage, "/World/Town/Lanes", make_graph())
    points = read_lanes(stage, "/World/Town").lanes["b_f0"].points
    np.testing.assert_allclose(points, [[99, 3, 6.5], [97, 3, 6.5]], atol=1e-9)


def test_lanes_of_a_stage_in_centimetres_with_y_up_are_in_metres_with_z_up(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "lanes.usda", up="Y", metres_per_unit=0.01)
    ahead = np.array([[100.0, 50, 0], [100, 50, -300]])
    write_lanes(stage, "/Town/Lanes", LaneGraph({"a": Lane("a", ahead, 3.5, 10.0, successors=("a",))}))
    np.testing.assert_allclose(read_lanes(stage, "/Town").lanes["a"].points, [[1, 0, 0.5], [1, 3, 0.5]], atol=1e-6)


@pytest.mark.parametrize(
    ("path", "message"),
    [("/Nowhere", "no prim /Nowhere"), ("/Empty", "no lanes below /Empty"), ("/Town", "has no mmw:lane:speed")],
)
def test_reading_names_what_is_wrong(path: str, message: str) -> None:
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.Scope.Define(stage, "/Empty")
    write_lanes(stage, "/Town/Lanes", make_graph())
    stage.GetPrimAtPath("/Town/Lanes/a_f0").RemoveProperty("mmw:lane:speed")
    with pytest.raises(ValueError, match=message):
        read_lanes(stage, path)


def test_a_name_that_is_no_identifier_is_an_error() -> None:
    lane = Lane("1st lane", np.array([[0.0, 0, 0], [1, 0, 0]]), 3.5, 10)
    with pytest.raises(ValueError, match="not a prim name"):
        write_lanes(Usd.Stage.CreateInMemory(), "/Town/Lanes", LaneGraph({lane.name: lane}))
