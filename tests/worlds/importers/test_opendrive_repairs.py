"""Faults of OpenDRIVE files: mended or left out with one note that names them, and refused where read strictly."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from mmw.core.errors import InputError
from mmw.worlds.importers.opendrive import read_opendrive as reader
from mmw.worlds.importers.opendrive.ground import MIN_PART, build_ground
from tests.fixtures.xodr_files import LANE, Plan, document, link, read_xodr, road, section, street, t_town

STREET = road("1", Plan(0, 0, 0).line(40.0), street(0.0, False, False))
ELSEWHERE = Plan(0, 100, 0).line(40.0)
EMPTY = section(0.0, [], "", [])
HEIGHT = '<height sOffset="0" outer="0.1"/>'


def chain(middle: float, gap: float = 0.0) -> str:
    """Return two streets of 40 m with a road of some length between them, and a gap to the side behind it [m]."""
    first = road(
        "1", Plan(0, 0, 0).line(40.0), street(0.0, before=False), links=link("successor", "road", "2", "start")
    )
    ends = link("predecessor", "road", "1", "end") + link("successor", "road", "3", "start")
    short = road("2", Plan(40, 0, 0).line(middle), street(0.0), links=ends)
    last = road(
        "3", Plan(40 + middle, gap, 0).line(40.0), street(0.0, after=False),
        links=link("predecessor", "road", "2", "end"),
    )  # fmt: skip
    return document(first, short, last)


FAULTS = {
    "only a center lane": (
        document(STREET, road("8", ELSEWHERE, EMPTY)),
        "town.xodr: road '8': has only a center lane; it was left out",
    ),
    "a micrometre": (
        chain(2e-7),
        "town.xodr: road '2' (2e-07 m): is shorter than 0.05 m; its neighbors were joined to each other",
    ),
    "a link to no road": (
        document(STREET.replace("<link>", "<link>" + link("successor", "road", "9", "start"), 1)),
        "town.xodr: end of road '1' (to road '9'): the link names a road that does not exist; the link was left out",
    ),
    "a link without an end": (
        document(STREET.replace("<link>", "<link>" + link("successor", "road", "9"), 1)),
        "town.xodr: road '1' (to road '9'): the link has no contactPoint; the link was left out",
    ),
    "a link to no lane": (
        chain(10.0).replace('<successor id="-1"/>', '<successor id="-5"/>', 1),
        "town.xodr: lane -1 of road '1' (to lane -5 at the start of road '2'): the link names a lane that does not "
        "exist; the link was left out",
    ),
    "lanes far apart": (
        chain(10.0, gap=3.2).replace(' predecessor="2"', ""),
        "town.xodr: lane road_2_s0_r1 (ends at (50.00, -1.75, 0.00), 3.20 m from lane road_3_s0_r1), lane "
        "road_3_s0_l1 (ends at (50.00, 4.95, 0.00), 3.20 m from lane road_2_s0_l1): the lanes are linked and lie over "
        "0.5 m apart; the link was left out",
    ),
    "numbers with a gap": (
        document(STREET.replace('lane id="-2"', 'lane id="-3"')),
        "town.xodr: road '1' at s = 0 ([1, 3]): lanes are not numbered 1, 2, 3 ...; those that are missing were given "
        "the width 0",
    ),
    "half a height": (
        document(STREET.replace("</lane>\n</right>", f"{HEIGHT}</lane>\n</right>")),
        "town.xodr: road '1': lane -2 at s = 0: <height> attribute inner is missing; the record was left out",
    ),
    "a speed in knots": (
        document(STREET.replace("km/h", "knots")),
        "town.xodr: road '1': speed unit 'knots'; m/s, km/h or mph is needed; the speed limit was left out",
    ),
    "a length without geometry": (
        document(STREET.replace('length="40.0"', 'length="160.0"', 1)),
        "town.xodr: road '1' (160 m, drawn to 40 m): its geometry ends before its length; it ends where its geometry "
        "does",
    ),
    "an unknown geometry": (
        document(STREET, road("8", ELSEWHERE, street(0.0, False, False)).replace("<line/>", "<nurbs/>")),
        "town.xodr: road '8': geometry at s = 0 holds <nurbs>; it was left out",
    ),
    "an id twice": (document(STREET, STREET), "town.xodr: road '1': the id is used twice; it was left out"),
}  # fmt: skip


@pytest.mark.parametrize("cause", list(FAULTS))
def test_a_fault_costs_its_element_and_one_note(tmp_path: Path, cause: str) -> None:
    text, note = FAULTS[cause]
    world = read_xodr(tmp_path, text)
    assert [found for found in world.notes if found.startswith("town.xodr")] == [note]
    assert world.lanes is not None and {"road_1_s0_r1", "road_1_s0_l1"} <= set(world.lanes.lanes)
    with pytest.raises(InputError, match=r"town\.xodr: .*; .+") as caught:
        read_xodr(tmp_path, text, strict=True)
    assert "\n" not in str(caught.value)


def test_the_only_road_keeps_its_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"road '1': has only a center lane; .*remove the road"):
        read_xodr(tmp_path, document(road("1", ELSEWHERE, EMPTY)))


def test_a_short_road_is_welded_both_ways(tmp_path: Path) -> None:
    world = read_xodr(tmp_path, chain(2e-7))
    assert world.lanes is not None
    lanes = world.lanes.lanes
    assert set(lanes) == {f"road_{key}_s0_{side}1" for key in (1, 3) for side in "lr"}
    assert lanes["road_1_s0_r1"].successors == ("road_3_s0_r1",)
    assert lanes["road_3_s0_l1"].successors == ("road_1_s0_l1",)
    np.testing.assert_allclose(lanes["road_1_s0_r1"].points[-1], [40.0, -LANE / 2, 0.0], atol=1e-6)


def test_a_lost_road_is_noted_once(tmp_path: Path) -> None:
    """Links to a road that was left out are no faults of their own."""
    text = chain(10.0)
    first, rest = text.split('<road id="2"')
    second, last = rest.split('<road id="3"')
    world = read_xodr(tmp_path, f'{first}<road id="2"{second.replace("<line/>", "<nurbs/>")}<road id="3"{last}')
    assert [note for note in world.notes if note.startswith("town.xodr")] == [
        "town.xodr: road '2': geometry at s = 0 holds <nurbs>; it was left out"
    ]
    assert world.lanes is not None and world.lanes.lanes["road_1_s0_r1"].successors == ()


def test_a_section_without_lanes_is_a_gap(tmp_path: Path) -> None:
    """The road goes on behind it, and its area lacks that of the section."""
    sections = street(0.0, False, False) + section(10.0, [], "", []) + street(30.0, False, False)
    world = read_xodr(tmp_path, document(road("1", Plan(0, 0, 0).line(40.0), sections)))
    paved = [part for part in world.parts if part.label in ("road", "road_line")]
    area = sum(float(np.maximum(part.mesh.crosses[:, 2], 0.0).sum() / 2) for part in paved)
    assert area == pytest.approx(2 * LANE * 20.0, rel=1e-6)
    assert world.lanes is not None and len(world.lanes.lanes) == 4


def test_slivers_between_roads_change_no_ground(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Overlays leave thousands, around which GEOS draws borders for minutes."""
    given: list = []
    monkeypatch.setattr(reader, "build_ground", lambda *both: given.append(both) or build_ground(*both))
    (tmp_path / "t.xodr").write_text(t_town())
    reader.read_opendrive(tmp_path / "t.xodr")
    ((area, sheets),) = given
    x, y, *_ = area.bounds
    slivers = [shapely.box(x - 5.0, y - k, x - 4.99, y - k + 0.05) for k in range(40)]
    assert max(sliver.area for sliver in slivers) < MIN_PART
    whole = shapely.MultiPolygon([*shapely.get_parts(area), *slivers])
    first, second = build_ground(area, sheets), build_ground(whole, sheets)
    assert np.array_equal(first.points, second.points) and np.array_equal(first.faces, second.faces)
