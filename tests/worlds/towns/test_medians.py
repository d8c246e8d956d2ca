"""Raised medians, wide cross-sections and large junctions."""

from typing import Any

import numpy as np
import pytest
import shapely

from mmw.worlds.towns.description import Profile
from mmw.worlds.towns.network import RoadNetwork
from tests.fixtures.meshes import corners_of, part_at
from tests.fixtures.road_towns import build, flyover, ground_frame


def test_median_is_a_closed_kerbed_island_beside_the_lanes() -> None:
    town = flyover()
    town["roads"][-1] = {"id": "over", "from": "W", "to": "E", "profile": "deck", "priority": 2}
    town["roads"] = [road for road in town["roads"] if road["id"] != "sn"]
    town["profiles"]["deck"] |= {"median": "grass"}
    network = build(town)
    island = [part for part in network.parts if "median" in part.path]
    assert {part.label for part in island} == {"sidewalk", "terrain"}
    top = corners_of([part for part in island if part.label == "terrain"])
    assert np.allclose(top[:, :, 2], 0.14)
    hole = shapely.Polygon([(120, 80 - 0.89), (140, 80 - 0.89), (140, 80 + 0.89), (120, 80 + 0.89)])
    assert not shapely.intersects(network.carriageway, hole)
    assert shapely.contains_xy(network.corridor, 130, 80)
    # With its island the ground is closed again: only the frame has free edges.
    _, free, on_frame = ground_frame(network)
    assert on_frame[free].all()
    kerb = network.carriageway.boundary
    lanes = [lane for name, lane in network.lanes.lanes.items() if name.startswith("over_")]
    assert min(shapely.distance(shapely.LineString(lane.points[:, :2]), kerb) for lane in lanes) == pytest.approx(2.05)


def test_median_needs_room_and_two_directions() -> None:
    with pytest.raises(ValueError, match=r"center of 1\.3 m or more"):
        Profile(lanes=2, centre=1.0, median="grass")
    with pytest.raises(ValueError, match="two directions"):
        Profile(lanes=2, centre=3.0, median="concrete", oneway=True)


# Wide junctions


def wide_town() -> dict[str, Any]:
    """Return four arms that meet in a box of 44 x 38 m, on a ring of roads with four lanes a direction."""
    wide = {"lanes": 2, "walk": 6.0}
    ends = [("S", "E", [150, -150]), ("E", "N", [150, 150]), ("N", "W", [-150, 150]), ("W", "S", [-150, -150])]
    return {
        "name": "wide",
        "profiles": {
            "main": wide | {"shoulder": 2.6, "centre": 0.8},
            "park": wide | {"shoulder": 3.0, "centre": 6.0, "median": "grass"},
            "four": {"lanes": 4, "walk": 6.0, "shoulder": 2.6, "centre": 3.5, "median": "concrete"},
        },
        "nodes": {"X": [0, 0, 0], "W": [-150, 0, 0], "E": [150, 0, 0], "S": [0, -150, 0], "N": [0, 150, 0]},
        "roads": [
            {"id": "xe", "from": "X", "to": "E", "profile": "main", "priority": 1},
            {"id": "wx", "from": "W", "to": "X", "profile": "main", "priority": 1},
            {"id": "xn", "from": "X", "to": "N", "profile": "park"},
            {"id": "sx", "from": "S", "to": "X", "profile": "park"},
            *(
                {"id": f"ring_{a}{b}".lower(), "from": a, "to": b, "profile": "four", "via": [[*corner, 40]]}
                for a, b, corner in ends
            ),
        ],
    }


@pytest.fixture(scope="module")
def wide() -> RoadNetwork:
    return build(wide_town())


def test_large_box_has_its_size_and_crosswalks_on_every_arm(wide: RoadNetwork) -> None:
    pad = part_at(wide.parts, "Roads/junction_X/asphalt").mesh
    np.testing.assert_allclose(pad.bounds[:, :2], [(-22, -19), (22, 19)], atol=1e-9)
    paint = shapely.union_all(
        shapely.polygons(corners_of([part for part in wide.parts if part.label == "road_line"])[:, :, :2])
    )
    for line in ([(-24, -8), (-24, 8)], [(24, -8), (24, 8)], [(-10, 21), (10, 21)], [(-10, -21), (10, -21)]):
        bars = shapely.intersection(paint, shapely.LineString(line))
        assert shapely.get_num_geometries(bars) >= 14


def test_lanes_that_appear_behind_a_junction_are_fed(wide: RoadNetwork) -> None:
    """At a T two lanes lead to four; each of the four has a way that leads to it."""
    graph = wide.lanes
    for name, lane in graph.lanes.items():
        assert graph.predecessors[name], name
        assert lane.successors
    assert {f"ring_en_f{k}" for k in range(4)} <= set(graph.lanes)


def test_a_lane_that_nobody_feeds_is_refused() -> None:
    town = flyover()
    town["profiles"]["away"] = {"lanes": 2, "oneway": True}
    town["nodes"] |= {"P": [80, -60, 0]}
    town["roads"] += [
        {"id": "pa", "from": "P", "to": "A", "profile": "away"},
        {"id": "ps", "from": "P", "to": "S", "profile": "away"},
    ]
    with pytest.raises(ValueError, match=r"lane 'p[as]_f0' has no predecessor; join a road that leads to it"):
        build(town)
