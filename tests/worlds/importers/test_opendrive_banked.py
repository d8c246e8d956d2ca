"""Banked roads of OpenDRIVE: the width of lanes in plan, what the check says of them, and vehicles on them."""

from math import cos, tan
from pathlib import Path

import pytest

from mmw.cli.import_scene import main as import_main
from mmw.worlds.checks.check import check_stage
from mmw.worlds.checks.findings import Finding
from tests.fixtures.xodr_files import Plan, document, lane, mark, read_xodr, road, section


def banked(roll: float) -> str:
    """Return a file with a straight road of 50 m and one lane of 6 m, banked about its reference line [rad]."""
    lateral = f'<superelevation s="0" a="{roll}" b="0" c="0" d="0"/>'
    one = section(0.0, [], mark("none"), [lane(-1, "driving", 6.0)])
    return document(road("1", Plan(0, 0, 0).line(50.0), one, lateral=lateral))


def checked(folder: Path, roll: float) -> list[Finding]:
    """Import such a file and return what the check finds, but for the ends of the road."""
    (folder / "banked.xodr").write_text(banked(roll))
    assert import_main([str(folder / "banked.xodr"), "--out", str(folder / "out")]) == 0
    found = check_stage(folder / "out" / "banked.usda").findings
    return [finding for finding in found if finding.severity != "info" and finding.rule != "dead_ends"]


def test_lane_is_narrower_in_plan(tmp_path: Path) -> None:
    world = read_xodr(tmp_path, banked(0.4))
    assert world.lanes is not None
    assert world.lanes.lanes["road_1_s0_r1"].width == pytest.approx(6.0 * cos(0.4), abs=1e-4)
    assert not any("gaps" in note for note in world.notes), "the edges lie 1.2 m above and below the middle"


def test_superelevation_of_a_highway_is_no_fault(tmp_path: Path) -> None:
    assert not checked(tmp_path, 0.08)


def test_steep_bank_is_a_warning(tmp_path: Path) -> None:
    (finding,) = checked(tmp_path, 0.4)
    assert (finding.severity, finding.rule) == ("warning", "bank")
    assert f"bank {tan(0.4):.3f}" in finding.message


def test_bank_that_no_road_has_is_an_error(tmp_path: Path) -> None:
    assert "height" in {finding.rule for finding in checked(tmp_path, 0.75) if finding.severity == "error"}
