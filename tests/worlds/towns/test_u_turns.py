"""Turning back: the curve, the lane it leads to, and vehicles that really do it."""

from typing import Any

import numpy as np
import pytest
import shapely

from mmw.core.mesh import merge
from mmw.core.transforms import quaternion_to_ypr
from mmw.traffic.idm.simulation import simulate_idm
from mmw.worlds.towns.description import TownDescription
from mmw.worlds.towns.network import RoadNetwork, build_network
from mmw.worlds.towns.u_turns import KERB_CLEARANCE, MIN_U_TURN_RADIUS, u_turn, u_turn_curve
from tests.fixtures.town_checks import arc_radii
from tests.fixtures.traffic_measures import measure
from tests.fixtures.traffic_towns import CATALOG, demand

STEP = np.radians(1.5)


@pytest.mark.parametrize(("aside", "radius"), [(3.5, 5.0), (9.0, 5.5), (9.99, 5.0), (12.5, 6.25), (16.0, 5.0)])
def test_loop_turns_back_with_its_radius(aside, radius):
    points = u_turn_curve(aside, radius, STEP)
    np.testing.assert_allclose(points[[0, -1]], [[0, 0], [0, aside]], atol=1e-9)
    way = np.diff(points, axis=0)
    heading = np.unwrap(np.arctan2(way[:, 1], way[:, 0]))
    assert abs(heading[0]) <= 0.5 * STEP and heading[-1] == pytest.approx(np.pi, abs=0.5 * STEP)
    assert arc_radii(points).min() > radius - 0.05
    length = np.linalg.norm(way, axis=1).sum()
    swing = np.arccos(min(1.0, (0.5 * aside + radius) / (2 * radius)))
    assert length == pytest.approx(radius * (np.pi + 4 * swing) + max(0.0, aside - 2 * radius), rel=2e-3)
    np.testing.assert_allclose(points[:, 1] + points[::-1, 1], aside, atol=1e-9)  # symmetric


def test_the_innermost_lane_with_room_is_taken():
    exits = [np.array([0.0, d]) for d in (9.0, 12.5)]

    def found(depth: float, half: float) -> tuple[int, np.ndarray] | None:
        y0, y1 = 4.5 - half, 4.5 + half
        outline = np.array([[0.0, y0], [depth, y0], [depth, y1], [0.0, y1]])
        return u_turn(np.zeros(2), 0.0, exits, outline, [outline], STEP)

    wide = found(20.0, 12.0)
    assert wide is not None and wide[0] == 0
    np.testing.assert_allclose(wide[1][-1], exits[0])
    flat = found(6.25 + KERB_CLEARANCE + 0.05, 16.0)  # too flat for the teardrop, deep enough for the half circle
    assert flat is not None and flat[0] == 1
    assert arc_radii(flat[1]).min() > 6.2
    assert found(6.0, 16.0) is None


def town(**profile: Any) -> dict[str, Any]:
    """Return a block with a diagonal road; vehicles may turn back at two corners."""
    ends = [("ab", "AB"), ("bc", "BC"), ("cd", "CD"), ("da", "DA")]
    roads = [{"id": name, "from": a, "to": b, "profile": "street", "speed": 10.0} for name, (a, b) in ends]
    outer = [[-80, -60, 25], [60, -90, 25], [220, -40, 25], [200, 110, 25]]
    return {
        "name": "block",
        "profiles": {"street": {"walk": 2.0} | profile},
        "nodes": {"A": [0, 0, 0], "B": [120, 0, 0], "C": [120, 110, 0], "D": [0, 110, 0]},
        "roads": [*roads, {"id": "ac", "from": "A", "to": "C", "profile": "street", "via": outer}],
        "junctions": {"A": {"uturn": True}, "C": {"uturn": True}},
    }


def ways_back(network: RoadNetwork) -> list[str]:
    """Return the ways that lead back into the road that they come from."""
    lanes = network.lanes.lanes
    road = {name: name.rsplit("_", 1)[0] for name in lanes}
    return [
        lane.name
        for lane in lanes.values()
        if lane.junction and road[network.lanes.predecessors[lane.name][0]] == road[lane.successors[0]]
    ]


@pytest.mark.parametrize(
    ("profile", "target"),
    [({"lanes": 2, "centre": 5.5, "shoulder": 2.6}, "0"), ({"lanes": 1, "centre": 6.0, "shoulder": 2.0}, "0")],
)
def test_built_ways_back_are_drivable(profile, target):
    network = build_network(TownDescription.model_validate(town(**profile)))
    ways = ways_back(network)
    assert sorted({network.lanes.lanes[name].junction for name in ways}) == ["A", "C"] and len(ways) == 6
    for name in ways:
        lane = network.lanes.lanes[name]
        assert lane.successors[0].endswith(target)
        assert arc_radii(lane.points[:, :2]).min() > MIN_U_TURN_RADIUS - 0.05
        line = shapely.LineString(lane.points[:, :2])
        assert all(line.distance(shapely.LinearRing(edge[:, 0, :2])) > 1.3 for edge in network.edges)


def test_no_room_to_turn_back_is_an_error():
    with pytest.raises(ValueError, match=r"node 'A': uturn: true, but no arm has room .* increase corner_radius"):
        build_network(TownDescription.model_validate(town(lanes=1, shoulder=0.6)))


def test_vehicles_turn_back():
    network = build_network(TownDescription.model_validate(town(lanes=2, centre=5.5, shoulder=2.6)))
    roads = merge(part.mesh for part in network.parts if part.path.startswith("Roads/"))
    mesh = roads.points, roads.faces
    done = 0
    for seed in range(2):
        result = simulate_idm(demand(network.lanes, mesh, frame_count=2500, vehicle_count=20, seed=seed))
        laws = measure(result.tracks, network.lanes, mesh, CATALOG)
        assert laws.min_gap > 0.4 and laws.max_jerk < 10.0 and laws.departed == 0 and laws.stuck == 0
        assert laws.max_wheel_error < 0.02 and laws.max_lateral < 2.5
        for track in result.tracks:
            heading = np.unwrap(quaternion_to_ypr(track.poses[:, 3:])[:, 0])
            for name in set(ways_back(network)) & set(result.routes[track.name]):
                lane = network.lanes.lanes[name].points[:, :2]
                near = [np.linalg.norm(track.poses[:, :2] - lane[k], axis=1) < 3.0 for k in (0, len(lane) // 2, -1)]
                if all(frames.any() for frames in near):
                    first, last = int(np.argmax(near[0])), len(heading) - 1 - int(np.argmax(near[2][::-1]))
                    done += abs(heading[last] - heading[first] - np.pi) < 0.5
    assert done >= 2
