"""Vehicles that were removed come back to their routes with their drivers, at a safe place, from rest."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.core.constants import FRAME_DT
from mmw.core.errors import InputError
from mmw.core.kinematics import differentiate
from mmw.traffic.demand import VehicleTrack
from mmw.traffic.live import return_places
from mmw.traffic.live.control import Control
from mmw.traffic.live.live_traffic import LiveTraffic
from mmw.traffic.live.presence import STILL_ROWS
from mmw.traffic.roads.lane_graph import LaneGraph
from tests.fixtures.live_traffic import drive, sedans_on, speeds
from tests.fixtures.sumo_installed import needs_sumo
from tests.fixtures.traffic_measures import measure, min_gap
from tests.fixtures.traffic_towns import CATALOG, crossroad, demand, flat, oval, roundabout, surface


@pytest.fixture(scope="module")
def ring() -> LaneGraph:
    """Return a one-way circuit of two lanes."""
    return oval()


def part(track: VehicleTrack, start: int, stop: int | None = None) -> VehicleTrack:
    """Return some rows of an actor."""
    return replace(track, poses=track.poses[start:stop], waits=None)


def column(traffic: LiveTraffic, name: str = "cav_1") -> np.ndarray:
    """Return the poses of an actor."""
    return traffic.poses[:, traffic.names.index(name)]


@pytest.mark.parametrize("phase", range(5))
def test_vehicle_comes_back_where_it_left_at_rest_and_drives_on(ring: LaneGraph, phase: int):
    traffic = LiveTraffic(sedans_on(ring, vehicle_count=1, cav_ranks=(0,)))
    traffic.advance(300 + phase)
    place = column(traffic)[-1, :3].copy()
    traffic.remove("cav_1")
    traffic.advance(330)
    traffic.add("cav_1")
    traffic.advance(900)
    own = column(traffic)
    assert np.isnan(own[300 + phase : 330]).all() and np.isfinite(own[330:]).all()
    assert np.linalg.norm(own[330, :3] - place) < 0.01
    assert (own[330 : 330 + STILL_ROWS] == own[330]).all(), "at rest, bit for bit"
    assert not (own[330 : 330 + STILL_ROWS + 60] == own[330]).all(), "and then its driver goes on"
    found = differentiate(own[330:])
    assert (found.velocity[:2] == 0.0).all() and (found.acceleration[:2] == 0.0).all()
    assert speeds(own[330:])[-1] > 7.0
    jerk = np.abs(np.diff(own[330:, :2], n=3, axis=0)).max() / FRAME_DT**3
    assert jerk < 9.0


def test_place_beside_a_standing_queue_is_not_taken(ring: LaneGraph):
    """Another vehicle stands where the one that was removed had been: it comes back elsewhere on its route."""
    traffic = LiveTraffic(sedans_on(ring, lane_changes=False))
    traffic.advance(300)
    place = column(traffic)[-1].copy()
    traffic.remove("cav_1")
    traffic.advance(320)
    traffic.command({"cav_2": Control(pose=place.tolist())})
    traffic.advance(340)
    traffic.add("cav_1")
    traffic.advance(700)
    own, other = column(traffic), column(traffic, "cav_2")
    assert np.linalg.norm(own[340, :2] - other[340, :2]) > 5.0
    present = [track for track in traffic.tracks if np.isfinite(track.poses[340:]).all()]
    assert len(present) == 8
    assert min_gap([part(track, 340) for track in present], CATALOG) > 0.4


@pytest.mark.parametrize("make", [pytest.param(oval, id="oval"), crossroad, pytest.param(roundabout)])
def test_many_come_and_go_without_a_collision(make):
    graph = make()
    ground = surface(graph, flat)
    asked = demand(graph, ground, vehicle_count=12, cav_ranks=(0, 1, 2), frame_count=2200)
    generator, absent, came = np.random.default_rng(3), {}, 0
    traffic, again = LiveTraffic(asked), LiveTraffic(asked)
    calls = []
    while traffic.rows < 2100:
        traffic.advance(traffic.rows + int(generator.integers(7, 60)))
        name = traffic.names[int(generator.integers(12))]
        if name in absent:
            try:
                traffic.add(name)
            except InputError as error:
                assert "no safe place" in str(error)
                continue
            del absent[name]
            came += 1
            calls.append((traffic.rows, "add", name))
        elif len(absent) < 4:
            traffic.remove(name)
            absent[name] = traffic.rows
            calls.append((traffic.rows, "remove", name))
    assert came > 10
    for row, call, name in calls:
        again.advance(row)
        getattr(again, call)(name)
    again.advance(traffic.rows)
    assert again.poses.tobytes() == traffic.poses.tobytes()
    gaps, steps = [], []
    for row in range(0, traffic.rows, 5):
        there = [track for track in traffic.tracks if np.isfinite(track.poses[row : row + 2]).all()]
        gaps.append(min_gap([part(track, row, row + 2) for track in there], CATALOG))
    assert min(gaps) > 0.4
    for track in traffic.tracks:
        is_there = np.isfinite(track.poses[:, 0])
        edges = np.flatnonzero(np.diff(np.concatenate([[0], is_there, [0]])))
        for start, stop in edges.reshape(-1, 2).tolist():
            if stop - start > 10:
                steps.append(measure([part(track, start, stop)], graph, ground, CATALOG))
    assert max(step.max_jerk for step in steps) < 9.5
    assert max(step.max_offset for step in steps) < 1.9 and max(step.max_wheel_error for step in steps) < 0.02


def test_steered_vehicle_gets_its_driver_back_and_control_of_the_first_rows_counts(ring: LaneGraph):
    traffic = LiveTraffic(sedans_on(ring, vehicle_count=2, cav_ranks=(0,)))
    traffic.advance(200)
    drive(traffic, 50, {"cav_1": Control(steering_rad=0.3)})
    traffic.remove("cav_1")
    traffic.advance(260)
    traffic.add("cav_1")
    traffic.command({"cav_1": Control(target_speed_m_s=3.0)})
    traffic.advance(700)
    assert speeds(column(traffic)[260:])[-1] == pytest.approx(3.0, abs=0.01)
    for rows in (0, 1, 3):
        traffic.remove("cav_1")
        traffic.advance(traffic.rows + 5)
        traffic.add("cav_1")
        start = traffic.rows
        traffic.advance(start + rows)
        traffic.command({"cav_1": Control(steering_rad=0.0, acceleration_m_s2=2.0)})
        traffic.advance(start + 60)
        own = column(traffic)[start:]
        assert np.isfinite(own).all() and (own[:STILL_ROWS] == own[0]).all()
        assert speeds(own)[-1] > 0.3


def test_bad_calls_change_nothing(ring: LaneGraph, monkeypatch: pytest.MonkeyPatch):
    traffic = LiveTraffic(sedans_on(ring, vehicle_count=3, frame_count=700))
    traffic.advance(300)
    with pytest.raises(InputError, match="add 'cav_1': is there already"):
        traffic.add("cav_1")
    traffic.remove("cav_1")
    with pytest.raises(InputError, match="has just been removed"):
        traffic.add("cav_1")
    traffic.advance(310)
    monkeypatch.setattr(return_places, "SEARCH_M", 0.0)
    place = column(traffic)[299]
    traffic.command({"cav_2": Control(pose=place.tolist())})
    plain = LiveTraffic(sedans_on(ring, vehicle_count=3, frame_count=700))
    plain.advance(300)
    plain.remove("cav_1")
    plain.advance(310)
    plain.command({"cav_2": Control(pose=place.tolist())})
    for one in (traffic, plain):
        one.advance(315)
    with pytest.raises(InputError, match=r"add 'cav_1': there is no safe place within .* along its route; step on"):
        traffic.add("cav_1")
    for one in (traffic, plain):
        one.advance(500)
    assert traffic.poses.tobytes() == plain.poses.tobytes()
    assert np.isnan(column(traffic)[300:]).all()


def test_actor_that_is_on_no_lane_needs_a_pose(ring: LaneGraph):
    drone = VehicleTrack("uav_1", "uav", "quadrotor", "", np.tile([0.0, 0, 20, 0, 0, 0, 1], (60, 1)))
    traffic = LiveTraffic(sedans_on(ring, vehicle_count=1, cav_ranks=(0,), frame_count=60), [drone])
    traffic.advance(3)
    traffic.remove("uav_1")
    traffic.advance(5)
    with pytest.raises(InputError, match="add 'uav_1': is no vehicle on a lane; give its pose"):
        traffic.add("uav_1")
    traffic.add("uav_1", [0.0, 0.0, 20.0, 0.0])


@needs_sumo
def test_sumo_says_that_it_needs_a_pose(ring: LaneGraph):
    traffic = LiveTraffic(sedans_on(ring, engine="sumo", vehicle_count=2, cav_ranks=(0,), frame_count=60))
    traffic.advance(5)
    traffic.remove("cav_1")
    traffic.advance(10)
    with pytest.raises(InputError, match=r"add 'cav_1': traffic\.engine = 'sumo': .* give a pose, or use engine: idm"):
        traffic.add("cav_1")
    traffic.add("cav_1", [0.0, 0.0, 0.0, 0.0])
    traffic.advance(20)
    traffic.close()
