"""Checks of a town: every rule finds its defect, names the prim and the place, and is silent without it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from mmw.__main__ import main
from mmw.traffic.roads.lane_graph import Lane
from mmw.worlds.checks.check import Report, check_stage
from mmw.worlds.checks.findings import merge_spots
from tests.fixtures.circuit import RADIUS_M, add_block, add_thing, on_ring, ring_lanes, shown_material, write_circuit
from tests.fixtures.stages import add_box, add_polygons, animate, new_stage
from tests.fixtures.stages import label as set_label


def check(stage: Usd.Stage) -> Report:
    stage.Save()
    return check_stage(Path(stage.GetRootLayer().realPath))


def of_rule(report: Report, rule: str) -> list:
    return [finding for finding in report.findings if finding.rule == rule]


def only(report: Report, rule: str):
    """Return the one finding that is no information, which must be of a rule."""
    found = [finding for finding in report.findings if finding.severity != "info"]
    assert [finding.rule for finding in found] == [rule], "\n".join(map(str, found))
    return found[0]


def test_a_clean_town_is_clean(tmp_path: Path) -> None:
    report = check(write_circuit(tmp_path / "town.usda"))
    assert [str(finding) for finding in report.findings if finding.severity != "info"] == []
    assert {finding.rule for finding in report.findings} == {"size", "open"}
    assert report.summary.endswith("0 errors, 0 warnings")


def test_a_stage_without_lanes_says_which_rules_do_not_apply(tmp_path: Path) -> None:
    report = check(write_circuit(tmp_path / "town.usda", lanes={}))
    silent = {finding.rule for finding in report.findings if finding.message.startswith("does not apply")}
    assert silent == {"holes", "grade", "clearance", "obstacles", "lanes", "backs"}
    assert report.count("error") == 0


def test_all_prims_without_material_or_label_are_listed_and_instances_once(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "foreign.usda")
    add_box(stage, "/World/first", (1, 1, 1), (0, 0, 0))
    add_box(stage, "/World/second", (1, 1, 1), (5, 0, 0), shown_material(stage, "paint", itu=""))
    stage.CreateClassPrim("/Proto")
    add_box(stage, "/Proto/part", (1, 1, 1), (0, 5, 0))
    for k in range(3):
        prim = UsdGeom.Xform.Define(stage, f"/World/copy_{k}")
        prim.AddTranslateOp().Set(Gf.Vec3d(3.0 * k, 0, 0))
        prim.GetPrim().GetReferences().AddInternalReference("/Proto")
        prim.GetPrim().SetInstanceable(True)
    report = check(stage)
    assert [f.path for f in of_rule(report, "radio_material")] == [
        "/World/copy_0/part",
        "/World/first",
        "/World/second",
    ]
    assert [f.path for f in of_rule(report, "visual_material")] == ["/World/copy_0/part", "/World/first"]
    assert [f.path for f in of_rule(report, "label")] == ["/World/copy_0/part", "/World/first", "/World/second"]
    assert "3 uses" in of_rule(report, "label")[0].message
    mapped = check_stage(tmp_path / "foreign.usda", {"/World/*": "itu_concrete"})
    assert of_rule(mapped, "radio_material") == []


def test_a_material_out_of_range_is_an_error(tmp_path: Path) -> None:
    stage = write_circuit(tmp_path / "town.usda")
    stage.GetPrimAtPath("/World/Materials/building").CreateAttribute(
        "mmw:radio:scattering", Sdf.ValueTypeNames.Float
    ).Set(3.0)
    finding = only(check(stage), "radio_material")
    assert finding.path == "/World/House"
    assert "scattering = 3" in finding.message


def test_usd_validators_are_asked(tmp_path: Path) -> None:
    stage = write_circuit(tmp_path / "town.usda")
    stage.DefinePrim("/World/thing", "Xform").CreateRelationship("material:binding").AddTarget("/nowhere")
    assert any("/World/thing" in finding.path for finding in of_rule(check(stage), "usd"))


def test_broken_meshes_do_not_stop_the_check(tmp_path: Path) -> None:
    stage = write_circuit(tmp_path / "town.usda")
    bad = add_thing(stage, "/World/Bad", np.array([[9, 0, 1], [9, 1, 1], [9, 0, 2]]), np.array([[0, 1, 2]]), "building")
    UsdGeom.Mesh(bad).GetPointsAttr().Set([(9, 0, 1), (9, 1, 1), (float("nan"), 0, 2)])
    found = of_rule(check(stage), "mesh")
    assert [finding.path for finding in found] == ["/World/Bad"]
    assert "not finite" in found[0].message


# ---- faces in one plane ----------------------------------------------------------------------------------------------


def test_a_decal_in_the_plane_of_the_road_is_an_error(tmp_path: Path) -> None:
    stage = write_circuit(tmp_path / "town.usda")
    decal = np.array([[29.0, -1, 0.001], [31, -1, 0.001], [31, 1, 0.001], [29, 1, 0.001]])
    add_thing(stage, "/World/Decal", decal, np.array([[0, 1, 2, 3]]), "road_line")
    finding = only(check(stage), "coplanar")
    assert finding.path == "/World/Road and /World/Decal"
    assert "4.000 m2" in finding.message
    assert abs(finding.place[0] - 30.0) < 1.1


def test_a_house_that_stands_on_the_field_only_touches_it(tmp_path: Path) -> None:
    stage = write_circuit(tmp_path / "town.usda")
    add_block(stage, "/World/Shed", (4, 4, 3), (12, 0, 1.3))
    report = check(stage)
    assert report.count("error") == 0
    (finding,) = of_rule(report, "touching")
    assert finding.path == "/World/Field and /World/Shed"
    assert "16.000 m2" in finding.message


def test_overlaps_inside_one_mesh_are_found(tmp_path: Path) -> None:
    stage = write_circuit(tmp_path / "town.usda")
    plate = np.array([[12, 0, 4], [16, 0, 4], [16, 3, 4], [12, 3, 4]])
    one, two = plate, plate + np.array((2, 0, 0))
    legs = np.array([[12, 0, -1], [16, 0, -1], [16, 3, -1], [12, 3, -1]])
    points, faces = np.concatenate([one, two, legs]), [[0, 1, 2, 3], [4, 5, 6, 7], [0, 8, 9, 1]]
    add_thing(stage, "/World/Roof", points, np.array(faces, dtype=object), "building")
    (finding,) = of_rule(check(stage), "coplanar")
    assert finding.path == "/World/Roof"
    assert "6.000 m2" in finding.message


# ---- the road under the lanes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("segment", [0, 37, 90, 133])
def test_a_missing_quad_of_the_road_is_a_hole(tmp_path: Path, segment: int) -> None:
    finding = only(check(write_circuit(tmp_path / "town.usda", missing=[segment])), "holes")
    middle = on_ring(RADIUS_M, np.array([segment + 0.5]))[0]
    assert np.linalg.norm(np.array(finding.place) - middle) < 1.5
    assert ("north" if 0 < segment < 89 else "south") in finding.path or segment in (0, 90)


def test_two_holes_are_two_spots(tmp_path: Path) -> None:
    report = check(write_circuit(tmp_path / "town.usda", missing=[10, 11, 60]))
    assert len(of_rule(report, "holes")) == 2


def test_a_lane_off_the_road_is_told(tmp_path: Path) -> None:
    lanes = {name: replace(lane, points=lane.points + np.array((0, 0, 0.05))) for name, lane in ring_lanes().items()}
    found = of_rule(check(write_circuit(tmp_path / "town.usda", lanes=lanes)), "height")
    assert found
    assert "-5.0 cm" in found[0].message


def test_a_step_across_the_lane_is_told(tmp_path: Path) -> None:
    stage = write_circuit(tmp_path / "town.usda")
    add_block(stage, "/World/Kerb", (0.4, 0.4, 0.14), (31.3, 0.0, 0.07), "road")
    found = of_rule(check(stage), "height")
    assert len(found) == 1
    assert "+14.0 cm" in found[0].message


def test_a_steep_lane_is_an_error(tmp_path: Path) -> None:
    lanes = ring_lanes()
    points = lanes["north"].points.copy()
    points[40:45, 2] += 0.25
    lanes["north"] = replace(lanes["north"], points=points)
    (finding,) = of_rule(check(write_circuit(tmp_path / "town.usda", lanes=lanes)), "grade")
    assert finding.path == "lane north"
    assert "2 segments" in finding.message


def test_a_low_bridge_takes_headroom_and_a_high_one_does_not(tmp_path: Path) -> None:
    for height, rules in ((4.2, ["clearance"]), (4.6, [])):
        stage = write_circuit(tmp_path / f"town_{rules}.usda")
        add_block(stage, "/World/Deck", (20, 3, 0.5), (30, 0, height + 0.25), "bridge")
        add_block(stage, "/World/Pier", (1, 1, 8), (39, 0, 0.8), "bridge")
        found = [finding for finding in check(stage).findings if finding.severity == "error"]
        assert [finding.rule for finding in found] == rules
        for finding in found:
            assert finding.path == "/World/Deck"
            assert "4.20 m" in finding.message


def test_a_thin_pole_in_the_lane_is_in_the_way_and_one_beside_it_is_not(tmp_path: Path) -> None:
    for x, rules in ((31.0, ["obstacles"]), (31.5, [])):
        stage = write_circuit(tmp_path / f"town_{x}.usda")
        add_block(stage, "/World/Pole", (0.1, 0.1, 6.0), (x, 0.0, 2.7), "pole")
        found = [finding for finding in check(stage).findings if finding.severity == "error"]
        assert [finding.rule for finding in found] == rules
        for finding in found:
            assert finding.path == "/World/Pole"
            assert "0.95 m" in finding.message


# ---- the lane graph --------------------------------------------------------------------------------------------------


def test_islands_and_dead_ends(tmp_path: Path) -> None:
    lanes = ring_lanes()
    lanes["spur"] = replace(lanes["north"], name="spur", successors=())
    report = check(write_circuit(tmp_path / "town.usda", lanes=lanes))
    assert [f.path for f in of_rule(report, "islands")] == ["lane spur"]
    assert sorted(f.message for f in of_rule(report, "dead_ends")) == ["leads nowhere", "no lane leads to it"]


def test_a_lane_that_is_reached_by_changing_lanes_is_no_island(tmp_path: Path) -> None:
    lanes = ring_lanes()
    lanes["inner"] = Lane("inner", lanes["north"].points * (0.9, 0.9, 1.0), 3.5, 10.0, right="north")
    lanes["north"] = replace(lanes["north"], left="inner")
    report = check(write_circuit(tmp_path / "town.usda", lanes=lanes))
    assert not of_rule(report, "islands")
    assert not of_rule(report, "neighbours")


def test_lanes_that_do_not_meet(tmp_path: Path) -> None:
    lanes = ring_lanes()
    short = replace(lanes["north"], points=lanes["north"].points[:-1])
    finding = only(check(write_circuit(tmp_path / "a.usda", lanes=lanes | {"north": short})), "gaps")
    assert finding.path == "lane north and lane south"
    assert "1.05 m" in finding.message
    points = lanes["north"].points.copy()
    points[-2] += [0.2, 0.0, 0.0]
    bent = replace(lanes["north"], points=points)
    assert only(check(write_circuit(tmp_path / "b.usda", lanes=lanes | {"north": bent})), "kinks").path.startswith(
        "lane north"
    )


@pytest.mark.parametrize(
    ("right", "left", "turned", "message"),
    [
        ("b", "", False, "not the first to the other side"),
        ("b", "a", True, "180.0 deg apart"),
        ("b", "a", False, ""),
    ],
)
def test_neighbours_are_parallel_and_mutual(tmp_path: Path, right: str, left: str, turned: bool, message: str) -> None:
    x = np.linspace(0.0, 40.0, 41)
    a = np.stack([x, np.zeros(41), np.zeros(41)], axis=1)
    b = a - [0, 3.5, 0]
    lanes = {
        "a": Lane("a", a, 3.5, 10.0, right=right),
        "b": Lane("b", b[::-1] if turned else b, 3.5, 10.0, left=left),
    }
    found = of_rule(check(write_circuit(tmp_path / "town.usda", lanes=lanes)), "neighbours")
    assert bool(found) == bool(message)
    assert all(message in finding.message for finding in found[:1])


# ---- things that stand -----------------------------------------------------------------------------------------------


def test_floating_sunken_standing_and_hanging(tmp_path: Path) -> None:
    stage = write_circuit(tmp_path / "town.usda")
    add_block(stage, "/World/Floats", (1, 1, 1), (12, 0, 0.4))  # 0.1 m over the field
    add_block(stage, "/World/Buried", (1, 1, 1), (12, 5, -1.0))
    add_block(stage, "/World/Stands", (1, 1, 1), (12, 10, 0.32))  # 0.02 m over it
    add_block(stage, "/World/Hangs", (1, 1, 1), (5.5, 0, 5.0))  # on the wall of the house
    add_block(stage, "/World/Rope", (0.1, 0.1, 1), (5.5, 0, 4.0))  # on that
    found = [finding for finding in check(stage).findings if finding.severity == "error"]
    assert [(finding.rule, finding.path) for finding in found] == [
        ("floating", "/World/Floats"), ("sunken", "/World/Buried"),
    ]  # fmt: skip
    assert "0.10 m above" in found[0].message


def test_a_parked_car_in_the_air_is_named(tmp_path: Path) -> None:
    for z, rules in ((0.0, ["floating"]), (-0.19, [])):
        stage = write_circuit(tmp_path / f"town_{z}.usda")
        car = UsdGeom.Xform.Define(stage, "/World/Car")
        car.AddTranslateOp().Set(Gf.Vec3d(15, 0, z))
        car.GetPrim().CreateAttribute("mmw:actor:role", Sdf.ValueTypeNames.Token).Set("vehicle")
        add_block(stage, "/World/Car/body", (4, 2, 1), (0, 0, 1.0), "car")
        add_block(stage, "/World/Car/wheel", (0.5, 0.2, 0.4), (1, 0, 0.2), "car")  # apart from the body, but one car
        found = [finding for finding in check(stage).findings if finding.severity == "error"]
        assert [finding.rule for finding in found] == rules
        assert all(finding.path == "/World/Car" for finding in found)


def test_moving_cars_are_not_in_the_way(tmp_path: Path) -> None:
    stage = write_circuit(tmp_path / "town.usda")
    animate(stage, "/World/Car", np.array([[30.0, 0, 1.0], [30.0, 1, 1.0]]))
    add_block(stage, "/World/Car/body", (4, 2, 1), (0, 0, 1.0), "car")
    report = check(stage)
    assert not of_rule(report, "obstacles")
    assert not of_rule(report, "floating")


# ---- solids ----------------------------------------------------------------------------------------------------------


def test_a_house_inside_out(tmp_path: Path) -> None:
    stage = write_circuit(tmp_path / "town.usda")
    add_block(stage, "/World/Turned", (4, 4, 6), (14, 0, 2.0), turned=True)
    report = check(stage)
    assert [f.path for f in of_rule(report, "inside_out")] == ["/World/Turned"]
    assert "96.000 m3" in of_rule(report, "inside_out")[0].message
    (finding,) = of_rule(report, "backs")
    assert (finding.path, finding.severity) == ("/World/Turned", "error")


def test_faces_that_disagree_and_faces_without_area(tmp_path: Path) -> None:
    stage = write_circuit(tmp_path / "town.usda")
    wall = np.array([[12, 0, -1], [12, 4, -1], [12, 4, 3], [12, 0, 3], [12, 8, -1], [12, 8, 3]])
    add_thing(stage, "/World/Wall", wall, np.array([[0, 1, 2, 3], [1, 2, 5, 4]]), "wall")
    flat = np.array([[15, 0, 0], [16, 0, 0], [17, 0, 0], [15, 0, -1]])
    add_thing(stage, "/World/Flat", flat, np.array([[0, 1, 2], [0, 3, 1]]), "building")
    report = check(stage)
    assert [f.path for f in of_rule(report, "winding")] == ["/World/Wall"]
    assert "at 1 edges" in of_rule(report, "winding")[0].message
    (finding,) = of_rule(report, "degenerate")
    assert finding.path == "/World/Flat"
    assert "1 of 2" in finding.message


# ---- units -----------------------------------------------------------------------------------------------------------


def test_centimetres_and_a_world_on_its_side(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "large.usda")
    add_block(stage, "/World/House", (1000, 1000, 800), (0, 0, 400))
    add_block(stage, "/World/Far", (1000, 1000, 800), (30000, 0, 400))
    assert "31 km wide" in of_rule(check(stage), "units")[0].message
    stage = new_stage(tmp_path / "side.usda")
    ground = np.array([[-50, 0, -50], [50, 0, -50], [50, 0, 50], [-50, 0, 50]])
    add_thing(stage, "/World/Ground", ground, np.array([[3, 2, 1, 0]]), "terrain")
    assert of_rule(check(stage), "up_axis")
    UsdGeom.SetStageUpAxis(stage, "Y")
    assert not of_rule(check(stage), "up_axis")


# ---- the command -----------------------------------------------------------------------------------------------------


def test_command_prints_findings_and_returns_1_only_for_errors(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    good, bad = tmp_path / "good.usda", tmp_path / "bad.usda"
    write_circuit(good).Save()
    write_circuit(bad, missing=[20]).Save()
    assert main(["town", "check", str(good)]) == 0
    assert capsys.readouterr().out.splitlines()[-1].endswith("0 errors, 0 warnings")
    assert main(["town", "check", str(bad)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("error: holes: lane north at (")
    assert lines[-1].endswith("1 errors, 0 warnings (holes 1)")
    assert main(["town", "check", str(bad), "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert (report["errors"], report["warnings"]) == (1, 0)
    assert report["findings"][0]["rule"] == "holes"
    assert len(report["findings"][0]["place"]) == 3


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["nowhere.usda"], "no such file"),
        (["atlantis"], "shipped towns are"),
        (["a.usda", "--material-map", "x"], "GLOB"),
    ],
)
def test_what_cannot_be_checked_is_said(arguments: list[str], part: str, capsys: pytest.CaptureFixture) -> None:
    assert main(["town", "check", *arguments]) == 2
    assert part in capsys.readouterr().err


def test_spots_hang_together() -> None:
    points = np.array([[0, 0, 0], [100, 0, 0], [3, 0, 0], [6, 0, 0], [103, 0, 0]], dtype=float)
    assert [spot.tolist() for spot in merge_spots(points)] == [[0, 2, 3], [1, 4]]
    assert merge_spots(np.zeros((0, 3))) == []


def test_own_polygons_of_a_stage_count(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "empty.usda")
    assert only(check(stage), "size").message.startswith("no visible mesh")
    mesh = add_polygons(stage, "/World/one", np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0]]), [[0, 1, 2]])
    set_label(mesh.GetPrim(), "terrain")
    (finding,) = of_rule(check(stage), "size")
    assert finding.message.startswith("1 triangles in 1 meshes")
