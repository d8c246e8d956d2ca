"""Vehicles that leave a network at its open ends, and those that enter: who, when and where."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.core.errors import InputError
from mmw.traffic.demand import TrafficResult
from mmw.traffic.idm.open_ends import OpenNetwork
from mmw.traffic.idm.simulation import simulate_idm
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.spawn import SpawnPoint
from tests.fixtures.traffic_measures import min_gap
from tests.fixtures.traffic_towns import CATALOG, crossroad, demand, make_town, surface

ARMS = {"X": (0.0, 0.0), "E": (130.0, 0.0), "N": (0.0, 130.0), "W": (-130.0, 0.0), "S": (0.0, -130.0)}


@pytest.fixture(scope="module")
def star() -> LaneGraph:
    """Return a crossroad whose four arms end; lanes towards the ends are `r0_f0`, those from there `r0_b0`."""
    return make_town(ARMS, [("X", name, 1, False, [], 0) for name in "ENWS"])


@pytest.fixture(scope="module")
def result(star: LaneGraph) -> TrafficResult:
    """Return ten seconds on it."""
    return simulate_idm(demand(star, surface(star), frame_count=1000, vehicle_count=12, cav_ranks=(0, 1)))


def test_network_has_exits_entries_and_times(star: LaneGraph) -> None:
    network = OpenNetwork(star)
    assert network.exits == {f"r{k}_f0" for k in range(4)}
    assert network.entries == [f"r{k}_b0" for k in range(4)]
    assert network.usable == set(star.lanes)
    arm = star.lanes["r0_b0"].plan_length
    ways = [star.lanes[name].plan_length for name in star.lanes["r0_b0"].successors]
    assert network.time["r0_b0"] == pytest.approx((2 * arm + max(ways)) / 12.0)
    assert network.time_left(SpawnPoint("r0_f0", 30.0, (0, 0, 0))) == pytest.approx((arm - 30.0) / 12.0)


def test_closed_network_has_neither() -> None:
    network = OpenNetwork(crossroad())
    assert not network.exits and not network.entries and set(network.time.values()) == {np.inf}


def test_lane_that_ends_beside_one_that_goes_on_is_no_exit() -> None:
    """Nobody drives on it: vehicles would have to vanish in the middle of a road."""
    town = make_town({"A": (0.0, 0.0), "B": (100.0, 0.0), "C": (200.0, 0.0)}, [
        ("A", "B", 2, True, [], 0), ("B", "C", 2, True, [], 0),
    ])  # fmt: skip
    lanes = dict(town.lanes)
    lanes["r0_f1"] = replace(lanes["r0_f1"], successors=())
    network = OpenNetwork(LaneGraph(lanes))
    assert network.exits == {"r1_f0", "r1_f1"}
    assert "r0_f1" not in network.usable and "r0_f0" in network.usable


def test_vehicles_leave_and_as_many_enter(star: LaneGraph, result: TrafficResult) -> None:
    there = np.stack([np.isfinite(track.poses).all(axis=1) for track in result.tracks])
    assert (~there[:, -1]).sum() >= 3, "vehicles reach the ends within ten seconds"
    assert there.sum(axis=0).max() <= 12
    assert there[:, -1].sum() >= 9, "others come for those that left"
    for track, present in zip(result.tracks, there, strict=True):
        inside = np.flatnonzero(present)
        assert np.all(np.diff(inside) == 1), "a vehicle is there once, without gaps"
        bumper = CATALOG[track.model].length
        if inside[-1] < 999:
            assert np.abs(track.poses[inside[-1], :2]).max() == pytest.approx(118.0, abs=bumper)
        if inside[0] > 0:
            assert np.abs(track.poses[inside[0], :2]).max() > 118.0 - 20.0


def test_cavs_are_there_in_all_frames(result: TrafficResult) -> None:
    cavs = [track for track in result.tracks if track.role == "cav"]
    assert [cav.name for cav in cavs] == ["cav_1", "cav_2"]
    assert all(np.isfinite(cav.poses).all() for cav in cavs)


def test_nobody_stands_without_cause_nor_touches_another(result: TrafficResult) -> None:
    poses = np.stack([track.poses for track in result.tracks])
    speed = 100.0 * np.linalg.norm(poses[:, -1, :2] - poses[:, -2, :2], axis=1)
    waits = np.array([track.waits is not None and track.waits[-1] for track in result.tracks])
    assert not ((speed < 0.5) & ~waits).any()
    assert min_gap(result.tracks, CATALOG) > 0.0


def test_motion_is_smooth_where_vehicles_enter_and_leave(result: TrafficResult) -> None:
    """Presence changes nothing about the drive: no jump of speed in the first or last frames."""
    for track in result.tracks:
        inside = np.flatnonzero(np.isfinite(track.poses).all(axis=1))
        speed = 100.0 * np.linalg.norm(np.diff(track.poses[inside, :2], axis=0), axis=1)
        assert np.abs(np.diff(speed)).max(initial=0.0) < 100.0 * 0.01 * 0.08  # 8 m/s^2 at 100 Hz


def test_same_seed_same_arrivals(star: LaneGraph, result: TrafficResult) -> None:
    again = simulate_idm(demand(star, surface(star), frame_count=1000, vehicle_count=12, cav_ranks=(0, 1)))
    assert [track.name for track in again.tracks] == [track.name for track in result.tracks]
    for one, other in zip(again.tracks, result.tracks, strict=True):
        assert np.array_equal(one.poses, other.poses, equal_nan=True)


def test_a_scenario_of_two_frames_has_vehicles(star: LaneGraph) -> None:
    short = simulate_idm(demand(star, surface(star), frame_count=2, vehicle_count=12, cav_ranks=(0, 1)))
    assert len(short.tracks) >= 10
    assert all(np.isfinite(track.poses).all() for track in short.tracks)


def test_models_are_those_that_the_configuration_names(star: LaneGraph) -> None:
    options = {"frame_count": 300, "vehicle_count": 8, "cav_ranks": (), "models": ("suv", "van")}
    some = simulate_idm(demand(star, surface(star), **options))
    assert {track.model for track in some.tracks} == {"suv", "van"}
    with pytest.raises(InputError, match="models holds 'tank': there are the vehicle models box_truck"):
        simulate_idm(demand(star, surface(star), models=("tank",)))


def test_cav_on_a_short_road_drives_to_the_last_frame() -> None:
    """Ten seconds on 50 m, from the middle: at 2.5 m/s it would have to wait at the end."""
    graph = make_town({"A": (0.0, 0.0), "B": (74.0, 0.0)}, [("A", "B", 1, True, [], 0)])
    options = {"frame_count": 1000, "vehicle_count": 1, "cav_ranks": (0,), "spawn_center_m": (34.6, 0.0, 0.0)}
    (cav,) = simulate_idm(demand(graph, surface(graph), **options)).tracks
    speed = 100.0 * np.linalg.norm(np.diff(cav.poses[:, :2], axis=0), axis=1)
    assert cav.role == "cav" and speed[-1] > 1.0


def test_reason_of_a_lane_that_no_body_can_drive_is_told() -> None:
    """The road is cut in two: a wheel leaves it, also where the route of a CAV has been tried before."""
    graph = make_town({"A": (0.0, 0.0), "B": (74.0, 0.0)}, [("A", "B", 1, True, [], 0)])
    points, faces = surface(graph)
    kept = np.abs(points[faces].mean(axis=1)[:, 0] - 50.0) > 3.0
    options = {"vehicle_count": 1, "cav_ranks": (0,), "spawn_center_m": (34.6, 0.0, 0.0)}
    with pytest.raises(InputError, match="a wheel leaves the drivable surface"):
        simulate_idm(demand(graph, (points, faces[kept]), **options))
