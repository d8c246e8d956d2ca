"""Roads that cross outside a common junction: hand-made files, and lanes whose crossings are known in closed form."""

from pathlib import Path

import numpy as np
import pytest

from mmw.traffic.idm.junctions import ConflictTable
from mmw.traffic.roads.lane_graph import Lane
from mmw.traffic.vehicle_pose import make_shape
from mmw.usd.vehicle_catalog import load_catalog
from mmw.worlds.importers.opendrive.crossings import LONGEST, join_crossings
from tests.fixtures.xodr_files import Plan, document, lane, link, mark, read_xodr, road, section

WAY = section(0.0, [], mark("none"), [lane(-1, "driving", 3.5, before=-1, after=-1)])


def ways(first: int, x: float, y: float, heading: float, middle: float, z: float = 0.0) -> list[str]:
    """Return three one-way roads one behind the other, the second around a point of its reference line."""
    plans, length = [], 0.5 * middle + 40.0
    cos, sin = np.cos(heading), np.sin(heading)
    for start, size in ((-length, 40.0), (-0.5 * middle, middle), (0.5 * middle, 40.0)):
        plans.append(Plan(x + start * cos, y + start * sin, heading).line(size))
    links = [
        link("successor", "road", f"{first + 1}", "start"),
        link("predecessor", "road", f"{first}", "end") + link("successor", "road", f"{first + 2}", "start"),
        link("predecessor", "road", f"{first + 1}", "end"),
    ]
    high = f'<elevation s="0" a="{z}" b="0" c="0" d="0"/>'
    return [road(f"{first + k}", plans[k], WAY, links=links[k], elevation=high) for k in range(3)]


def test_lanes_of_roads_that_cross_give_way_to_each_other(tmp_path: Path) -> None:
    world = read_xodr(tmp_path, document(*ways(1, 0, 0, 0.0, 20.0), *ways(4, 0, 0, np.pi / 2, 20.0)))
    assert world.lanes is not None
    crossing = {"road_2_s0_r1", "road_5_s0_r1"}
    assert {n: x.junction for n, x in world.lanes.lanes.items() if x.junction} == dict.fromkeys(
        crossing, "crossing_road_2_s0_r1"
    )
    assert any("1 pairs of lanes cross outside a common junction" in note for note in world.notes)
    shape = make_shape(load_catalog()["sedan"])
    away = ConflictTable(world.lanes).last_conflict("road_2_s0_r1", shape, "road_5_s0_r1", shape)
    assert away > 10.0, "the crossing lies 11.75 m from the start of the lane"


def test_bridge_and_long_roads_are_no_junction(tmp_path: Path) -> None:
    text = document(*ways(1, 0, 0, 0.0, 20.0), *ways(4, 0, 0, np.pi / 2, 20.0, z=6.0))
    bridge = read_xodr(tmp_path, text)
    assert bridge.lanes is not None
    assert not any(x.junction for x in bridge.lanes.lanes.values())
    middle = LONGEST + 1.0
    long = read_xodr(tmp_path, document(*ways(1, 0, 0, 0.0, middle), *ways(4, 0, 0, np.pi / 2, 20.0)))
    assert long.lanes is not None
    assert not any(x.junction for x in long.lanes.lanes.values())
    assert any("1 pairs of lanes cross without a junction, such as road_2_s0_r1" in note for note in long.notes)


def straight(name: str, start: tuple[float, float], end: tuple[float, float], junction: str) -> Lane:
    """Return a straight lane of 21 points."""
    xy = np.linspace(start, end, 21)
    return Lane(name, np.column_stack([xy, np.zeros(21)]), 3.5, 10.0, junction)


@pytest.mark.parametrize(("x", "names"), [(10.0, {"j1"}), (0.5, {"j1", "j2"})])
def test_junctions_whose_lanes_cross_become_one(x: float, names: set[str]) -> None:
    """A crossing half a meter from the end of a lane is none: lanes lie beside each other there."""
    lanes = [straight("a", (0, 0), (20, 0), "j1"), straight("b", (x, -10), (x, 10), "j2")]
    made, _ = join_crossings({each.name: each for each in lanes}, {"a": 1, "b": 1})
    assert {each.junction for each in made.values()} == names
