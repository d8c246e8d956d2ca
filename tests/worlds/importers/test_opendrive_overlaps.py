"""Surfaces of OpenDRIVE roads that overlap or leave gaps: areas against plan polygons, one surface at every place."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from mmw.core.mesh import TriangleMesh
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.worlds.importers.opendrive.curbs import SLAB, Sheets, close_edges
from mmw.worlds.importers.opendrive.overlaps import CRACK, carriageways, cut_overlaps, pave_gaps
from mmw.worlds.importers.opendrive.road_surface import Sheet
from mmw.worlds.towns.plan_geometry import twice_areas
from tests.fixtures.xodr_files import Plan, document, lane, mark, read_xodr, road, section


def sheet(name: str, corners: list[tuple[float, float, float]], material: str = "asphalt") -> Sheet:
    """Return a quadrilateral, counter-clockwise."""
    made = Sheet(name, outline=shapely.Polygon([corner[:2] for corner in corners]))
    index = made.surface.add_points(np.array(corners, float))
    made.surface.add_faces(material, index[[[0, 1, 2], [0, 2, 3]]])
    return made


def area(part: Sheet, material: str = "asphalt") -> float:
    """Return the area in plan of what a sheet has of a material [m^2]."""
    points = np.concatenate(part.surface.points)
    return 0.5 * sum(float(twice_areas(points[faces]).sum()) for faces in part.surface.faces.get(material, []))


def rectangle(x: float, y: float, width: float, height: float, z: float = 0.0) -> list[tuple[float, float, float]]:
    """Return the corners of a rectangle from its lower left one."""
    return [(x, y, z), (x + width, y, z), (x + width, y + height, z), (x, y + height, z)]


def test_first_of_equal_roads_is_kept_and_areas_add_up_to_the_union() -> None:
    one, two = sheet("one", rectangle(0, 0, 20, 4)), sheet("two", rectangle(8, -8, 3, 20))
    assert cut_overlaps([one, two]) > 0
    assert area(one) == pytest.approx(80.0)
    assert area(two) == pytest.approx(60.0 - 12.0, abs=0.02), "up to a lap of 0.3 mm around the cut"
    assert cut_overlaps([one, two]) == 0, "nothing is left to cut"


def test_carriageway_goes_before_sidewalk_and_sidewalk_before_grass() -> None:
    green, walk = sheet("a", rectangle(0, 0, 10, 10), "grass"), sheet("b", rectangle(5, 0, 10, 10), "concrete_sidewalk")
    paved = sheet("c", rectangle(7, 0, 2, 10))
    cut_overlaps([green, walk, paved])
    assert (area(paved), area(walk, "concrete_sidewalk"), area(green, "grass")) == (
        pytest.approx(20.0), pytest.approx(80.0, abs=0.02), pytest.approx(50.0, abs=0.02)
    )  # fmt: skip


def test_cut_pieces_stay_in_their_plane() -> None:
    slope = [(x, y, 0.1 * x) for x, y, _ in rectangle(0, 0, 20, 4)]
    low, cut = sheet("low", rectangle(8, -8, 3, 20, 0.9)), sheet("slope", slope)
    cut_overlaps([low, cut])
    points = np.concatenate(cut.surface.points)
    used = points[np.unique(np.concatenate(cut.surface.faces["asphalt"]))]
    np.testing.assert_allclose(used[:, 2], 0.1 * used[:, 0], atol=1e-9)


def test_bridge_is_not_cut_by_what_it_crosses() -> None:
    road_below, bridge = sheet("road", rectangle(0, 0, 20, 4)), sheet("bridge", rectangle(8, -8, 3, 20, 6.0))
    assert cut_overlaps([road_below, bridge]) == 0


def test_gap_under_a_lane_is_paved() -> None:
    """A wedge of 1.2 m between two roads; beside the lane there is nothing to pave."""
    west, east = (
        sheet("west", rectangle(-20, -2, 20, 4)),
        sheet("east", [(0, -2, 0), (20, -2, 0), (20, 2, 0), (1.2, 2, 0)]),
    )
    points = np.column_stack([np.linspace(-15, 15, 31), np.zeros(31), np.zeros(31)])
    graph = LaneGraph({"a": Lane("a", points, 3.5, 10.0)})
    gaps = pave_gaps(graph, carriageways([west, east], 1e-4))
    assert gaps is not None
    cut_overlaps([west, east, gaps], gaps)
    half = 1.75 + 0.05
    wedge = shapely.Polygon([(0, -2), (1.2, 2), (0, 2)]).intersection(shapely.box(-20, -half, 20, half))
    assert area(gaps) == pytest.approx(wedge.area, abs=0.01)


@pytest.mark.parametrize("end", [0.0, 0.0007])
def test_crack_of_a_millimeter_where_lanes_meet_is_paved(end: float) -> None:
    """Both roads are within 2 mm of the ends of the lanes, and one joint lies in the crack."""
    west, east = sheet("west", rectangle(-20, -2, 20, 4)), sheet("east", rectangle(0.0014, -2, 20, 4))
    lines = [np.column_stack([x, np.zeros(31), np.zeros(31)]) for x in np.linspace([-15.0, end], [end, 15.0], 31).T]
    lanes = [Lane("a", lines[0], 3.5, 10.0, successors=("b",)), Lane("b", lines[1], 3.5, 10.0)]
    gaps = pave_gaps(LaneGraph({lane.name: lane for lane in lanes}), carriageways([west, east], CRACK))
    assert gaps is not None
    cut_overlaps([west, east, gaps], gaps)
    x, y = np.meshgrid(np.linspace(0.0, 0.0014, 15), np.linspace(-1.75, 1.75, 15))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    assert not np.isnan(carriageways([west, east, gaps], 1e-6).nearest(points)).any()


def test_edge_beside_a_sliver_of_the_same_sheet_has_no_side() -> None:
    """A square with a strip of 2 mm along one side, whose corners it does not share: sides under the outline only."""
    one, strip = sheet("one", rectangle(0, 0, 10, 10)).surface, rectangle(-0.002, 0, 0.002, 5)
    for shift in (0.0, 5.0):
        index = one.add_points(np.array(strip) + np.array([0.0, shift, 0.0]))
        one.add_faces("asphalt", index[[[0, 1, 2], [0, 2, 3]]])
    close_edges(one, Sheets([one]))
    sides = TriangleMesh(np.concatenate(one.points), np.concatenate(one.faces["soil"]))
    assert sides.areas.sum() == pytest.approx(SLAB * (2 * 10.0 + 2 * 10.002))


def test_lane_ends_where_it_is_too_narrow(tmp_path: Path) -> None:
    """A width that falls from 4 m to 0 over 80 m: 2 m are left after 40 m."""
    narrow = '<width sOffset="0" a="4.0" b="-0.05" c="0" d="0"/>'
    one = section(0.0, [], mark("none"), [lane(-1, "driving", 3.5), lane(-2, "driving", narrow)])
    world = read_xodr(tmp_path, document(road("1", Plan(0, 0, 0).line(80.0), one)))
    assert world.lanes is not None
    tapered = world.lanes.lanes["road_1_s0_r2"]
    assert tapered.points[-1, 0] == pytest.approx(40.0, abs=1.0)
    assert tapered.width == pytest.approx(2.0, abs=0.05)
    assert any("1 lanes end or begin where they are 2 m wide: road_1_s0_r2" in note for note in world.notes)


def test_lanes_of_sections_without_links_are_linked_by_number(tmp_path: Path) -> None:
    parts = [section(s, [], mark("none"), [lane(-1, "driving", 3.5)]) for s in (0.0, 40.0)]
    world = read_xodr(tmp_path, document(road("1", Plan(0, 0, 0).line(80.0), parts[0] + parts[1])))
    assert world.lanes is not None
    assert list(world.lanes.lanes) == ["road_1_s0_r1"]
    assert world.lanes.lanes["road_1_s0_r1"].plan_length == pytest.approx(80.0)
    assert any("lanes of successive sections are not linked" in note for note in world.notes)
