"""OpenDRIVE as other tools export it: dead ends of SUMO, ways back that do not fit, turns tighter than a lane."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from mmw.cli.import_scene import main as import_main
from mmw.cli.town import main as town_main
from tests.fixtures.xodr_files import LANE, Plan, document, lane, link, mark, read_xodr, road, section, street

HALF = LANE / 2
ON_LINE = f'<laneOffset s="0" a="{HALF}" b="0" c="0" d="0"/>'
"""Puts the middle of lane -1 on the reference line."""


def way(number: str, plan: Plan, before: str, after: str, links: str) -> str:
    """Return a road with one lane that carries traffic along its reference line."""
    one = lane(-1, "driving", LANE, "", *(int(n) if n else None for n in (before, after)))
    return road(number, plan, section(0.0, [], mark("none"), [one]), "5" if number == "10" else "-1", links,
                offset=ON_LINE)  # fmt: skip


def dead_end(turn: Plan) -> str:
    """Return a street whose start is linked to a junction that is missing, and whose end has a way back."""
    ends = link("predecessor", "junction", "77") + link("successor", "junction", "5")
    back = way("10", turn, "-1", "1", link("predecessor", "road", "1", "end") + link("successor", "road", "1", "end"))
    connection = '<connection id="0" incomingRoad="1" connectingRoad="10" contactPoint="start">'
    junction = f'<junction id="5">{connection}<laneLink from="-1" to="-1"/></connection></junction>'
    return document(
        road("1", Plan(0, 0, 0).line(60.0), street(0.0, False, False), links=ends), back, junctions=junction
    )


def test_a_way_back_that_fits_is_driven(tmp_path: Path) -> None:
    world = read_xodr(tmp_path, dead_end(Plan(60, -HALF, 0).arc(1 / HALF, np.pi * HALF)))
    assert world.lanes.lanes["road_1_s0_r1"].successors == ("road_10_s0_r1",)
    assert world.lanes.lanes["road_10_s0_r1"].successors == ("road_1_s0_l1",)
    assert "1 roads end at junctions that the file does not have, such as '77': dead ends" in world.notes


def test_a_way_back_that_does_not_fit_is_left_out(tmp_path: Path) -> None:
    crude = Plan(60.6, -1.5, np.radians(30)).line(1.0)
    x, y, _ = crude.pose
    crude.pose = np.array([x, y, np.radians(90)])
    crude.line(float(-2 * y))
    crude.pose[2] = np.radians(150)
    world = read_xodr(tmp_path, dead_end(crude.line(1.0)))
    assert set(world.lanes.lanes) == {"road_1_s0_l1", "road_1_s0_r1"}
    assert not any(found.successors for found in world.lanes.lanes.values())
    assert "1 U-turns left out, over 0.5 m from what they link: road_10_s0_r1" in world.notes


def turning(side: float) -> str:
    """Return a street of 3.5 m that turns left in a junction, on a parabola within a square."""
    turn = Plan(0, 0, 0).cubic_to(side, side, np.pi / 2, 2 * side)
    links = link("predecessor", "road", "1", "end") + link("successor", "road", "2", "start")
    connection = '<connection id="0" incomingRoad="1" connectingRoad="10" contactPoint="start">'
    return document(
        way("1", Plan(-40, 0, 0).line(40.0), "", "", link("successor", "junction", "5")),
        way("10", turn, "-1", "-1", links),
        way("2", Plan(side, side, np.pi / 2).line(40.0), "", "", link("predecessor", "junction", "5")),
        junctions=f'<junction id="5">{connection}<laneLink from="-1" to="-1"/></connection></junction>',
    )


@pytest.mark.parametrize("side", [HALF, 2.5, 8.0])
def test_a_turn_tighter_than_half_a_lane_is_paved(tmp_path: Path, side: float) -> None:
    """A lane covers what lies within half its width from its middle, also where its inner border folds."""
    world = read_xodr(tmp_path, turning(side))
    (part,) = [part for part in world.parts if part.path == "Roads/junction_5/asphalt"]
    cells = shapely.polygons(part.points[part.faces][..., :2])
    t = np.linspace(0, 1, 2001)
    middle = shapely.LineString(np.stack([side * (2 * t - t * t), side * t * t], axis=1))
    swept = middle.buffer(HALF, quad_segs=64, cap_style="flat")
    outside = shapely.union(shapely.box(-40, -HALF, 0, HALF), shapely.box(side - HALF, side, side + HALF, side + 40))
    paved = shapely.union_all([*cells, outside])
    assert shapely.union_all(cells).area == pytest.approx(swept.difference(outside).area, rel=4e-3)
    assert middle.buffer(HALF - 0.02, quad_segs=64, cap_style="flat").difference(paved).area < 1e-4  # no hole
    assert shapely.union_all(cells).area == pytest.approx(shapely.area(cells).sum(), abs=1e-4)  # nothing twice


def test_the_town_check_has_nothing_to_say_but_dead_ends(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    source = tmp_path / "turn.xodr"
    source.write_text(turning(8.0))
    assert import_main([str(source), "--out", str(tmp_path)]) == 0
    capsys.readouterr()
    assert town_main(["check", str(tmp_path / "turn.usda")]) == 0
    rules = {line.split(": ")[1] for line in capsys.readouterr().out.splitlines() if line.startswith("warning")}
    assert rules == {"dead_ends", "islands"}
