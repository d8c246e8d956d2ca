"""Checks of a town: every rule finds its defect, names the prim and the place, and is silent without it."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

from mmw.__main__ import main
from mmw.traffic.roads.lane_graph import Lane
from mmw.worlds.checks.check import Report, check_stage
from mmw.worlds.checks.findings import Finding, merge_spots
from mmw.worlds.checks.road import _banks
from tests.fixtures.circuit import RADIUS_M, add_block, add_thing, on_ring, ring_lanes, shown_material, write_circuit
from tests.fixtures.stages import add_box, add_polygons, animate, new_stage
from tests.fixtures.stages import label as set_label


def check(stage: Usd.Stage) -> Report:
    stage.Save()
    return check_stage(Path(stage.GetRootLayer().realPath))


def of_rule(report: Report, rule: str) -> list[Finding]:
    return [finding for finding in report.findings if finding.rule == rule]


def only(report: Report, rule: str) -> Finding:
    """Return the one finding that is no information, which must be of a rule."""
    found = [finding for finding in report.findings if finding.severity != "info"]
    assert [finding.rule for finding in found] == [rule], "\n".join(map(str, found))
    return found[0]


@pytest.fixture
def town(tmp_path: Path) -> Usd.Stage:
    """Return a clean town, to which a test adds a defect."""
    return write_circuit(tmp_path / "town.usda")


def check_lanes(folder: Path, **lanes: Lane) -> Report:
    """Check the clean town with some of its lanes changed or added."""
    return check(write_circuit(folder / "town.usda", lanes=ring_lanes() | lanes))


def test_a_clean_town_is_clean(town: Usd.Stage) -> None:
    report = check(town)
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
    unbound = ["/World/copy_0/part", "/World/first"]
    for rule, paths in (
        ("radio_material", [*unbound, "/World/second"]),
        ("visual_material", unbound),
        ("label", [*unbound, "/World/second"]),
    ):
        assert [finding.path for finding in of_rule(report, rule)] == paths
    assert "3 uses" in of_rule(report, "label")[0].message
    mapped = check_stage(tmp_path / "foreign.usda", {"/World/*": "itu_concrete"})
    assert of_rule(mapped, "radio_material") == []


def test_usd_validators_are_asked(town: Usd.Stage) -> None:
    town.DefinePrim("/World/thing", "Xform").CreateRelationship("material:binding").AddTarget("/nowhere")
    assert any("/World/thing" in finding.path for finding in of_rule(check(town), "usd"))


def damage_material(stage: Usd.Stage) -> None:
    prim = stage.GetPrimAtPath("/World/Materials/building")
    prim.CreateAttribute("mmw:radio:scattering", Sdf.ValueTypeNames.Float).Set(3.0)


def unknown_row(stage: Usd.Stage) -> None:
    prim = stage.GetPrimAtPath("/World/Materials/building")
    prim.CreateAttribute("mmw:radio:model", Sdf.ValueTypeNames.Token).Set("itu")
    prim.CreateAttribute("mmw:radio:itu", Sdf.ValueTypeNames.Token).Set("itu_cheese")


def unknown_name(stage: Usd.Stage) -> None:
    material = UsdShade.Material.Define(stage, "/World/Materials/itu_cheese")
    UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath("/World/House")).Bind(material)


def add_broken_mesh(stage: Usd.Stage) -> None:
    bad = add_thing(stage, "/World/Bad", np.array([[9, 0, 1], [9, 1, 1], [9, 0, 2]]), np.array([[0, 1, 2]]), "building")
    UsdGeom.Mesh(bad).GetPointsAttr().Set([(9, 0, 1), (9, 1, 1), (float("nan"), 0, 2)])


def thing(name: str, label: str, points: list, faces: list) -> Callable[[Usd.Stage], object]:
    return lambda stage: add_thing(stage, f"/World/{name}", np.array(points), np.array(faces, dtype=object), label)


def block(name: str, *given: Any, **options: bool) -> Callable[[Usd.Stage], object]:
    return lambda stage: add_block(stage, f"/World/{name}", *given, **options)


DECAL = thing("Decal", "road_line", [[29, -1, 0.001], [31, -1, 0.001], [31, 1, 0.001], [29, 1, 0.001]], [[0, 1, 2, 3]])
ROOF = thing(  # two plates that overlap, on two legs
    "Roof", "building",
    [[12, 0, 4], [16, 0, 4], [16, 3, 4], [12, 3, 4], [14, 0, 4], [18, 0, 4], [18, 3, 4], [14, 3, 4], [12, 0, -1],
     [16, 0, -1]],
    [[0, 1, 2, 3], [4, 5, 6, 7], [0, 8, 9, 1]],
)  # fmt: skip
WALL = thing(
    "Wall", "wall", [[12, 0, -1], [12, 4, -1], [12, 4, 3], [12, 0, 3], [12, 8, -1], [12, 8, 3]],
    [[0, 1, 2, 3], [1, 2, 5, 4]],
)  # fmt: skip
FLAT = thing("Flat", "building", [[15, 0, 0], [16, 0, 0], [17, 0, 0], [15, 0, -1]], [[0, 1, 2], [0, 3, 1]])
KERB = block("Kerb", (0.4, 0.4, 0.14), (31.3, 0, 0.07), "road")
TURNED = block("Turned", (4, 4, 6), (14, 0, 2.0), turned=True)


@pytest.mark.parametrize(
    ("spoil", "rule", "severity", "path", "text"),
    [
        (damage_material, "radio_material", "error", "/World/House", "scattering = 3"),
        (unknown_row, "radio_material", "error", "/World/House", "mmw:radio:itu = 'itu_cheese'; one of itu_vacuum, "),
        (unknown_name, "radio_material", "error", "/World/House", "radio material 'itu_cheese' of its name does not"),
        (add_broken_mesh, "mesh", "error", "/World/Bad", "not finite"),
        (DECAL, "coplanar", "error", "/World/Road and /World/Decal", "4.000 m2"),
        (ROOF, "coplanar", "error", "/World/Roof", "6.000 m2"),
        (block("Shed", (4, 4, 3), (12, 0, 1.3)), "touching", "info", "/World/Field and /World/Shed", "16.000 m2"),
        (KERB, "height", "error", "lane north, south", "+14.0 cm"),
        (TURNED, "inside_out", "error", "/World/Turned", "96.000 m3"),
        (TURNED, "backs", "error", "/World/Turned", ""),
        (WALL, "winding", "warning", "/World/Wall", "at 1 edges"),
        (FLAT, "degenerate", "warning", "/World/Flat", "1 of 2"),
    ],
)  # fmt: skip
def test_a_defect_is_named_once(
    town: Usd.Stage, spoil: Callable[[Usd.Stage], object], rule: str, severity: str, path: str, text: str
) -> None:
    spoil(town)
    report = check(town)
    (finding,) = of_rule(report, rule)
    assert (finding.severity, finding.path) == (severity, path) and text in finding.message
    if spoil in (damage_material, DECAL):
        assert only(report, rule) is finding
    if spoil is DECAL:
        assert abs(finding.place[0] - 30.0) < 1.1
    if severity == "info":
        assert report.count("error") == 0


Blocks = Sequence[tuple[Any, ...]]
"""Prim below `/World`, size, middle and class of some boxes."""


@pytest.mark.parametrize(
    ("blocks", "errors"),
    [
        ([("Deck", (20, 3, 0.5), (30, 0, 4.45), "bridge"), ("Pier", (1, 1, 8), (39, 0, 0.8), "bridge")],
         [("clearance", "Deck", "4.20 m")]),
        ([("Deck", (20, 3, 0.5), (30, 0, 4.85), "bridge"), ("Pier", (1, 1, 8), (39, 0, 0.8), "bridge")], []),
        ([("Pole", (0.1, 0.1, 6.0), (31.0, 0.0, 2.7), "pole")], [("obstacles", "Pole", "0.95 m")]),
        ([("Pole", (0.1, 0.1, 6.0), (31.5, 0.0, 2.7), "pole")], []),
        ([("Floats", (1, 1, 1), (12, 0, 0.4))], [("floating", "Floats", "0.10 m above")]),
        ([("Buried", (1, 1, 1), (12, 5, -1.0))], [("sunken", "Buried", "")]),
        ([("Stands", (1, 1, 1), (12, 10, 0.32))], []),  # 0.02 m over the field
        ([("Hangs", (1, 1, 1), (5.5, 0, 5.0)), ("Rope", (0.1, 0.1, 1), (5.5, 0, 4.0))], []),  # on the wall of the house
    ],
    ids=["low-bridge", "high-bridge", "pole-in-lane", "pole-beside", "floating", "buried", "standing", "hanging"],
)  # fmt: skip
def test_blocks_that_stand_wrong_are_errors(
    town: Usd.Stage, blocks: Blocks, errors: Sequence[tuple[str, str, str]]
) -> None:
    for name, *block in blocks:
        add_block(town, f"/World/{name}", *block)
    found = [finding for finding in check(town).findings if finding.severity == "error"]
    assert [(f.rule, f.path) for f in found] == [(rule, f"/World/{name}") for rule, name, _ in errors]
    assert all(text in finding.message for finding, (_, _, text) in zip(found, errors, strict=True))


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
    found = of_rule(check_lanes(tmp_path, **lanes), "height")
    assert found
    assert "-5.0 cm" in found[0].message


def test_bank_is_what_most_probes_of_a_section_tell() -> None:
    """A bank of 0.1, a kerb of 0.14 m under the two outer probes, a step of 5 cm under all, and no fault at all."""
    offset = np.tile(np.arange(-1.5, 1.75, 0.25), 4)
    section = np.repeat(np.arange(4), 13)
    off = np.select(
        [section == 0, section == 1, section == 2], [0.1 * offset, 0.14 * (offset > 1.1), 0.05], 0.03 * offset
    )
    bank = _banks(off, offset, section, (np.abs(off) > 0.04) & (section < 3))
    np.testing.assert_allclose(bank[::13], [0.1, 0.0, 0.0, 0.0], atol=1e-12)


def test_a_steep_lane_is_an_error(tmp_path: Path) -> None:
    north = ring_lanes()["north"]
    north.points[40:45, 2] += 0.25
    (finding,) = of_rule(check_lanes(tmp_path, north=north), "grade")
    assert finding.path == "lane north"
    assert "2 segments" in finding.message


# ---- the lane graph --------------------------------------------------------------------------------------------------


def test_islands_and_dead_ends(tmp_path: Path) -> None:
    report = check_lanes(tmp_path, spur=replace(ring_lanes()["north"], name="spur", successors=()))
    assert [f.path for f in of_rule(report, "islands")] == ["lane spur"]
    assert sorted(f.message for f in of_rule(report, "dead_ends")) == ["leads nowhere", "no lane leads to it"]


def test_a_lane_that_is_reached_by_changing_lanes_is_no_island(tmp_path: Path) -> None:
    north = replace(ring_lanes()["north"], left="inner")
    inner = Lane("inner", north.points * (0.9, 0.9, 1.0), 3.5, 10.0, right="north")
    report = check_lanes(tmp_path, north=north, inner=inner)
    assert not of_rule(report, "islands")
    assert not of_rule(report, "neighbours")


def test_lanes_that_do_not_meet(tmp_path: Path) -> None:
    north = ring_lanes()["north"]
    finding = only(check_lanes(tmp_path, north=replace(north, points=north.points[:-1])), "gaps")
    assert finding.path == "lane north and lane south"
    assert "1.05 m" in finding.message


def test_lanes_that_meet_at_an_angle(tmp_path: Path) -> None:
    north = ring_lanes()["north"]
    north.points[-2] += [0.2, 0.0, 0.0]
    assert only(check_lanes(tmp_path, north=north), "kinks").path.startswith("lane north")


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


# ---- actors ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("z", "rules"), [(0.0, ["floating"]), (-0.19, [])])
def test_a_parked_car_in_the_air_is_named(town: Usd.Stage, z: float, rules: list[str]) -> None:
    car = UsdGeom.Xform.Define(town, "/World/Car")
    car.AddTranslateOp().Set(Gf.Vec3d(15, 0, z))
    car.GetPrim().CreateAttribute("mmw:actor:role", Sdf.ValueTypeNames.Token).Set("vehicle")
    add_block(town, "/World/Car/body", (4, 2, 1), (0, 0, 1.0), "car")
    add_block(town, "/World/Car/wheel", (0.5, 0.2, 0.4), (1, 0, 0.2), "car")  # apart from the body, but one car
    found = [finding for finding in check(town).findings if finding.severity == "error"]
    assert [finding.rule for finding in found] == rules
    assert all(finding.path == "/World/Car" for finding in found)


def test_moving_cars_are_not_in_the_way(town: Usd.Stage) -> None:
    animate(town, "/World/Car", np.array([[30.0, 0, 1.0], [30.0, 1, 1.0]]))
    add_block(town, "/World/Car/body", (4, 2, 1), (0, 0, 1.0), "car")
    report = check(town)
    assert not of_rule(report, "obstacles")
    assert not of_rule(report, "floating")


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
