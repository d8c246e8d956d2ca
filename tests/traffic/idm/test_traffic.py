"""Traffic on small towns: spawn rule, junctions, and limits in every frame of every vehicle."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.config import TrafficConfig
from mmw.core.transforms import conjugate, rotate
from mmw.traffic.demand import VehicleTrack
from mmw.traffic.idm.junctions import ConflictTable, Passage, Request, Reservation, boxes_overlap, grant_requests
from mmw.traffic.idm.simulation import simulate_idm
from mmw.traffic.idm.wait_causes import find_causes
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.traffic.route import choose_lanes, endless_lanes
from mmw.traffic.spawn import connected_ranks, nearest_points, spawn_points
from mmw.traffic.vehicle_pose import make_shape
from tests.fixtures.traffic_measures import measure, min_gap
from tests.fixtures.traffic_towns import CATALOG, SEDAN, crossroad, demand, flat, grid, hill, roundabout, surface

TRUCK = make_shape(CATALOG["box_truck"])
EAST, WEST, NORTH = "X:r0_b0>r2_f0", "X:r2_b0>r0_f0", "X:r3_b0>r1_f0"
"""Connections straight on across the middle of `cross`."""


def run(graph: LaneGraph, height=flat, **changes) -> list[VehicleTrack]:
    """Return the tracks of a short scenario."""
    return simulate_idm(demand(graph, surface(graph, height), **({"cav_ranks": (5, 2)} | changes))).tracks


@pytest.fixture(scope="module")
def cross() -> LaneGraph:
    """Return a crossroad inside a ring road."""
    return crossroad()


def queue_tracks(gap: float) -> list[VehicleTrack]:
    """Return two standing sedans one behind the other, bumpers `gap` apart."""
    pose = np.tile([0.0, 0, 0, 0, 0, 0, 1], (5, 1))
    ahead = pose + np.array([CATALOG["sedan"].length + gap, 0, 0, 0, 0, 0, 0])
    return [VehicleTrack("a", "cav", "sedan", "red", pose), VehicleTrack("b", "cav", "sedan", "red", ahead)]


@pytest.mark.parametrize("gap", [1.0, 0.2, -0.3])
def test_gap_measure_sees_distance_and_overlap(gap):
    assert min_gap(queue_tracks(gap), CATALOG) == pytest.approx(max(gap, 0.0), abs=1e-9)


@pytest.mark.parametrize("town", ["crossroad", "hill", "roundabout", "grid"])
def test_every_vehicle_is_within_limits_in_every_frame(town):
    graph, height, count = {
        "crossroad": (crossroad(), flat, 20),
        "hill": (crossroad(hill), hill, 16),
        "roundabout": (roundabout(), flat, 30),
        "grid": (grid(3, 80.0), flat, 24),
    }[town]
    for seed in range(3):
        tracks = run(graph, height, seed=seed, vehicle_count=count, frame_count=600)
        found = measure(tracks, graph, surface(graph, height), CATALOG)
        assert found.min_gap > 0.4
        assert found.max_jerk < 9.0
        assert found.max_wheel_error < 0.02
        assert found.max_lateral < 2.5
        assert found.max_offset < 1.8 and found.departed == 0
        assert found.mean_speed > 2.5


def test_no_vehicle_waits_forever():
    graph = crossroad(hill)
    tracks = run(graph, hill, frame_count=4000, vehicle_count=20, cav_ranks=(), seed=2)
    found = measure(tracks, graph, surface(graph, hill), CATALOG)
    assert found.stuck == 0 and found.longest_stop < 20.0
    travelled = [np.linalg.norm(np.diff(track.poses[:, :2], axis=0), axis=1).sum() for track in tracks]
    assert min(travelled) > 60.0


def test_body_acceleration_has_no_steps(cross):
    for track in run(cross, vehicle_count=18, frame_count=500):
        acceleration = np.diff(track.poses[:, :3], 2, axis=0) * 1e4 + [0.0, 0.0, 9.81]
        force = rotate(conjugate(track.poses[1:-1, 3:]), acceleration)
        jerk = np.diff(force, axis=0) * 100
        assert np.abs(jerk).max() < 10.0
        assert np.abs(np.diff(jerk, axis=0)).max() < 1.5  # jerk itself is continuous


def test_names_roles_and_ranks(cross):
    tracks = run(cross)
    assert [track.name for track in tracks] == ["cav_1", "cav_2", *(f"veh_{n:03d}" for n in range(1, 13))]
    assert [track.role for track in tracks] == ["cav"] * 2 + ["vehicle"] * 12
    for track in tracks:
        assert track.poses.shape == (400, 7) and track.poses.dtype == np.float64
        assert track.paint in CATALOG[track.model].paints
    assert all(CATALOG[track.model].height < 2.2 for track in tracks[:2])
    swapped = run(cross, cav_ranks=(2, 5))
    np.testing.assert_array_equal(swapped[0].poses, tracks[1].poses)
    assert not np.array_equal(swapped[0].poses, tracks[0].poses)


def test_connected_vehicles_are_drawn_from_a_pool_by_seed(cross):
    pool = TrafficConfig(vehicle_count=14, spawn_center_m=(0, 0, 0), cav_ranks=(5, 2), cav_pool=6)
    ranks = connected_ranks(pool, 1)
    assert ranks not in ((2, 5), connected_ranks(pool, 2))
    for one, same in zip(run(cross, cav_pool=6), run(cross, cav_ranks=ranks), strict=True):
        assert (one.name, one.role) == (same.name, same.role)
        np.testing.assert_array_equal(one.poses, same.poses)


def test_every_vehicle_of_the_pool_is_drawn_and_none_beyond():
    traffic = TrafficConfig(vehicle_count=20, spawn_center_m=(0, 0, 0), cav_ranks=(0, 1, 2), cav_pool=8)
    drawn = [connected_ranks(traffic, seed) for seed in range(400)]
    assert all(ranks == tuple(sorted(set(ranks))) and len(ranks) == 3 for ranks in drawn)
    counts = np.bincount([rank for ranks in drawn for rank in ranks])
    assert len(counts) == 8
    assert counts == pytest.approx(np.full(8, 150), abs=5 * np.sqrt(400 * 3 / 8 * 5 / 8))  # five standard deviations
    assert connected_ranks(traffic.model_copy(update={"cav_pool": None}), 3) == (0, 1, 2)


def test_same_seed_same_motion_whatever_the_order_of_lanes_and_models(cross):
    tracks = run(cross)
    turned = LaneGraph(dict(reversed(cross.lanes.items())))
    catalog = dict(reversed(CATALOG.items()))
    again = simulate_idm(demand(turned, surface(cross), catalog=catalog, cav_ranks=(5, 2))).tracks
    for one, two in zip(tracks, again, strict=True):
        assert (one.name, one.model, one.paint) == (two.name, two.model, two.paint)
        np.testing.assert_array_equal(one.poses, two.poses)
    other = run(cross, seed=2)
    assert any(not np.array_equal(one.poses, two.poses) for one, two in zip(tracks, other, strict=True))


def test_more_frames_do_not_change_the_first_ones(cross):
    short, long = run(cross, frame_count=100), run(cross, frame_count=900)
    for one, two in zip(short, long, strict=True):
        assert (one.name, one.model, one.paint) == (two.name, two.model, two.paint)
        np.testing.assert_allclose(one.poses, two.poses[:100], atol=1e-9)


def test_spawn_points_lie_on_the_grid_and_the_nearest_are_taken(cross):
    points = spawn_points(cross, endless_lanes(cross))
    for point in points:
        lane = cross.lanes[point.lane]
        assert not lane.junction
        assert point.station >= 10.5 and lane.length - point.station >= 10.5 - 1e-6
        assert (point.station - 10.5) % 12.0 == pytest.approx(0.0, abs=1e-9)
    center = (30.0, 5.0, 0.0)
    chosen = nearest_points(points, center, 9)
    distance = np.sort([np.linalg.norm(np.subtract(point.position, center)) for point in points])
    np.testing.assert_allclose([np.linalg.norm(np.subtract(p.position, center)) for p in chosen], distance[:9])


def test_conflicts_follow_geometry(cross):
    table = ConflictTable(cross)
    assert table.last_conflict(EAST, SEDAN, WEST, SEDAN) == -np.inf  # opposite directions pass
    assert 5.0 < table.last_conflict(EAST, SEDAN, NORTH, SEDAN) < 30.0  # crossing ones do not
    assert table.last_conflict(EAST, TRUCK, NORTH, SEDAN) > table.last_conflict(EAST, SEDAN, NORTH, SEDAN)
    assert table.last_conflict(EAST, SEDAN, EAST, SEDAN) == -np.inf  # one behind the other is car following


def passage(table: ConflictTable, name: str, requested_at: float, priority: int = 0) -> Passage:
    """Return a passage over one connection that begins at station 20."""
    length = table.graph.lanes[name].length
    exit_lane = table.graph.lanes[name].successors[0]
    return Passage(((name, 20.0, 20.0 + length),), 20.0, 18.8, 1, exit_lane, 20.0 + length, priority, requested_at)


def test_grants_go_by_priority_then_by_waiting(cross):
    table = ConflictTable(cross)

    def grant(requests, reservations, time=10.0):
        return grant_requests(table, requests, reservations, [10.0, 10.0, 10.0], time, {})

    early = Request(0, SEDAN, passage(table, EAST, 9.0), True)
    major = Request(1, SEDAN, passage(table, NORTH, 9.5, priority=50), True)
    reservations: list[Reservation] = []
    assert grant([early, major], reservations) == [1] and [reservation.name for reservation in reservations] == [NORTH]
    assert grant([early], reservations) == []
    assert grant([early], [replace(reservations[0], start=-30.0)]) == [0]  # the other one is through
    waited = Request(0, SEDAN, passage(table, EAST, 5.0), True)
    assert grant([waited, major], []) == [0]
    blocked = replace(waited, has_room=False, will_have_room=False)
    assert grant([blocked, major], []) == [1]  # its exit stands still, perhaps because of the other one
    coming = replace(waited, has_room=False)
    assert grant([coming, major], []) == []  # room will come, so the crossing stays free
    assert grant([blocked, major], [], time=25.0) == [0]  # after very long, in any case


def test_a_long_wait_blocks_later_requests(cross):
    table = ConflictTable(cross)
    reservations = [Reservation(2, SEDAN, NORTH, 20.0, 44.0)]
    station = [10.0, 10.0, 22.0]
    old = Request(0, SEDAN, passage(table, EAST, 1.0), True)
    new = Request(1, SEDAN, passage(table, NORTH, 10.0, priority=9), True)
    blockers: dict[int, list[int]] = {}
    granted = grant_requests(table, [old, new], reservations, station, 10.0, blockers)
    assert granted == []  # north would follow, but east is due
    assert blockers == {0: [2], 1: [0]}
    assert grant_requests(table, [new], list(reservations), station, 10.0, {}) == [1]
    adjacent = Request(1, SEDAN, passage(table, WEST, 10.0), True)
    assert grant_requests(table, [old, adjacent], [], station, 10.0, {}) == [0, 1]


def test_green_comes_before_waiting_and_left_turns_come_last(cross):
    table = ConflictTable(cross)
    left = "X:r0_b0>r3_f0"
    station = [10.0, 10.0]
    waits = Request(0, SEDAN, passage(table, left, 1.0), True, has_green=True, gives_way=True)
    comes = Request(1, SEDAN, passage(table, WEST, 9.9), True, has_green=True)
    assert table.last_conflict(left, SEDAN, WEST, SEDAN) > 0
    assert grant_requests(table, [waits, comes], [], station, 10.0, {}) == [1]
    assert grant_requests(table, [waits], [], station, 10.0, {}) == [0]
    in_order = replace(waits, has_green=False, gives_way=False)
    assert grant_requests(table, [in_order, comes], [], station, 10.0, {}) == [0]


def test_causes_follow_the_chain_to_its_head():
    speed = [0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0]
    blockers = {0: [1], 1: [2], 4: [5], 5: [4], 6: [4, 3]}
    assert find_causes(speed, blockers, {2}) == [True, True, True, False, False, False, True]
    assert find_causes(speed, blockers, set()) == [False] * 6 + [True]
    assert find_causes([0.0], {}, set()) == [False]  # nothing blocks it


def test_boxes_overlap_as_sampled_points_say():
    generator = np.random.Generator(np.random.PCG64(5))
    center = generator.uniform(-5, 5, (400, 2))
    heading = generator.uniform(-np.pi, np.pi, 400)
    zero = np.zeros(2)
    found = boxes_overlap(zero, np.float64(0.3), (2.4, 0.9), center, heading, (3.0, 1.2))
    u, v = np.meshgrid(np.linspace(-1, 1, 121), np.linspace(-1, 1, 61))
    local = np.stack([3.0 * u.ravel(), 1.2 * v.ravel()])
    for index in range(400):
        c, s = np.cos(heading[index]), np.sin(heading[index])
        world = center[index][:, None] + np.array([[c, -s], [s, c]]) @ local
        ca, sa = np.cos(0.3), np.sin(0.3)
        inside = np.array([[ca, sa], [-sa, ca]]) @ world
        margin = np.maximum(np.abs(inside[0]) / 2.4, np.abs(inside[1]) / 0.9).min()
        if abs(margin - 1) > 0.05:  # sampling cannot tell closer calls
            assert found[index] == (margin < 1)


def test_routes_avoid_dead_ends_and_closed_lanes():
    def lane(name, *successors):
        return Lane(name, np.array([(0.0, 0, 0), (10.0, 0, 0)]), 3.5, 10.0, successors=successors)

    graph = LaneGraph({x.name: x for x in (lane("a", "b", "c"), lane("b", "a"), lane("c", "d"), lane("d"))})
    endless = endless_lanes(graph)
    assert endless == {"a", "b"}
    chain = choose_lanes(graph, "a", 55.0, np.random.Generator(np.random.PCG64(0)), endless.__contains__)
    assert chain == ["a", "b", "a", "b", "a", "b", "a"]
    stopped = choose_lanes(graph, "a", 55.0, np.random.Generator(np.random.PCG64(0)), lambda name: name == "a")
    assert stopped == ["a"]


def test_bad_input_is_refused(cross):
    for key, value, match in (
        ("cav_ranks", (3, 3), "cav_ranks"), ("cav_ranks", (14,), "cav_ranks"), ("vehicle_count", 400, "spawn points"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=match):
            run(cross, **{key: value})
    points, faces = surface(cross)
    island = (points[faces].mean(axis=1)[:, 0]) < -80.0
    with pytest.raises(ValueError, match=r"spawn point on lane .* leaves the drivable surface for model"):
        simulate_idm(demand(cross, (points, faces[island]), frame_count=10, spawn_center_m=(60.0, 0, 0), seed=0))
