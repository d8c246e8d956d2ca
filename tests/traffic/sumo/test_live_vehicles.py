"""SUMO in step with a live simulation: like a recording without controls, obedient with them, seen by others."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.core.constants import FRAME_DT
from mmw.core.errors import InputError
from mmw.core.kinematics import differentiate
from mmw.traffic.live.control import Control
from mmw.traffic.live.live_traffic import LiveTraffic
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.sumo.motion_limits import LEAD_ROWS
from mmw.traffic.sumo.simulation import simulate_sumo
from tests.fixtures.live_traffic import drive, sedans_on, speeds
from tests.fixtures.sumo_installed import needs_sumo
from tests.fixtures.traffic_measures import measure, min_gap
from tests.fixtures.traffic_towns import CATALOG, crossroad, demand, flat, hill, oval, roundabout, surface

pytestmark = needs_sumo


@pytest.fixture(scope="module")
def ring() -> LaneGraph:
    """Return a one-way circuit of two lanes."""
    return oval()


def on_ring(ring: LaneGraph, **options) -> LiveTraffic:
    """Return sedans on the circuit, driven by SUMO."""
    return LiveTraffic(sedans_on(ring, engine="sumo", **options))


@pytest.mark.parametrize(
    ("make", "height", "count"),
    [
        (oval, flat, 40),
        pytest.param(lambda: crossroad(hill), hill, 14, marks=pytest.mark.slow),
        pytest.param(roundabout, flat, 14, marks=pytest.mark.slow),
    ],
)
def test_without_controls_traffic_is_that_of_a_recording(make, height, count):
    """Both filters have a standard deviation of 0.12 s, unless that of the recording is wider, up to 0.6 s."""
    graph = make()
    ground = surface(graph, height)
    asked = demand(graph, ground, engine="sumo", vehicle_count=count, cav_ranks=(5, 2), frame_count=600)
    recorded, traffic = simulate_sumo(asked).tracks, LiveTraffic(asked)
    traffic.advance(600)
    traffic.close()
    roster = [(track.name, track.role, track.model, track.paint) for track in recorded]
    assert [(track.name, track.role, track.model, track.paint) for track in traffic.tracks] == roster
    poses = np.stack([track.poses for track in recorded], axis=1)
    assert np.abs(traffic.poses[..., :3] - poses[..., :3]).max() < 0.03
    live, past = differentiate(traffic.poses), differentiate(poses)
    for name in ("acceleration", "body_rate"):
        assert np.abs(getattr(live, name)).max() < 1.1 * np.abs(getattr(past, name)).max()
    found = measure(traffic.tracks, graph, ground, CATALOG)
    assert found.min_gap > 0.4 and found.max_jerk < 9.5 and found.max_wheel_error < 0.02 and found.max_lateral < 2.6


def test_two_at_once_give_the_same_bytes_and_no_row_that_is_known_changes(ring):
    plain, first, second = (on_ring(ring, frame_count=420) for _ in range(3))
    for traffic in (plain, first, second):
        traffic.advance(203)
    for traffic in (first, second):
        traffic.command({"cav_1": Control(acceleration_m_s2=-3.0)})
    for traffic in (plain, first, second):
        traffic.advance(400)
        traffic.close()
    assert first.poses.tobytes() == second.poses.tobytes()
    row = int(np.argmax((first.poses != plain.poses).any(axis=(1, 2))))
    # SUMO's next step reaches into a row within a step and its weight; the limits know `LEAD_ROWS` more.
    assert 203 <= row <= 203 + 15 + LEAD_ROWS
    away = np.linalg.norm((first.poses - plain.poses)[:, 0, :2], axis=1)
    assert away[203 + 125] > 0.1


def test_acceleration_is_reached_and_held_and_others_brake(ring):
    traffic = on_ring(ring, lane_changes=False, frame_count=2500)
    traffic.advance(300)
    assert speeds(drive(traffic, 10))[-1] > 5.0
    poses = drive(traffic, 200, {"cav_1": Control(acceleration_m_s2=-1.5)})
    assert np.diff(speeds(poses))[130:] / FRAME_DT == pytest.approx(-1.5, abs=1e-3)
    drive(traffic, 550, {"cav_1": Control(acceleration_m_s2=-6.0)})
    standing = drive(traffic, 1100)[-50:]
    assert (standing == standing[0]).all()  # exactly
    assert min_gap(traffic.tracks, CATALOG) > 1.0
    behind = [speeds(traffic.poses[-50:, column]).max() for column in range(len(traffic.names))]
    assert sum(speed < 0.01 for speed in behind) >= 2  # a queue
    assert speeds(drive(traffic, 300, {"cav_1": Control()}))[-1] > 2.0  # its driver is back
    traffic.close()


def test_acceleration_ends_at_the_highest_limit_of_the_town(ring):
    traffic = on_ring(ring, vehicle_count=1, cav_ranks=(0,))
    poses = drive(traffic, 1600, {"cav_1": Control(acceleration_m_s2=3.0)})
    traffic.close()
    assert speeds(poses)[-1] == pytest.approx(max(lane.speed for lane in ring.lanes.values()), abs=0.05)


def test_target_speed_is_kept_and_lower_limits_win(ring):
    traffic = on_ring(ring, vehicle_count=3, lane_changes=False)
    traffic.advance(300)
    poses = drive(traffic, 800, {"cav_1": Control(target_speed_m_s=4.0)})
    assert speeds(poses)[-1] == pytest.approx(4.0, abs=0.01)
    fast = speeds(drive(traffic, 600, {"cav_1": Control(target_speed_m_s=60.0)}))
    traffic.close()
    assert 8.0 < fast.max() < max(lane.speed for lane in ring.lanes.values()) + 0.1


def test_lane_change_happens_once_when_asked(ring):
    traffic = on_ring(ring, vehicle_count=3)
    traffic.advance(300)
    asked = [drive(traffic, 600, {"cav_1": Control(lane_change=option)}) for option in ("left", "right")]
    traffic.close()
    found = [change for change in traffic.lane_changes if change[1] == "cav_1"]
    assert len(asked) == 2 and 1 <= len(found) <= 2
    for _, _, lane, other in found:
        assert other in (ring.lanes[lane].left, ring.lanes[lane].right)
    measures = measure(traffic.tracks, ring, surface(ring), CATALOG)
    assert measures.max_offset < 1.8 and measures.max_jerk < 9.5
    still = on_ring(ring, vehicle_count=1, cav_ranks=(0,), lane_changes=False, frame_count=20)
    with pytest.raises(InputError, match=r"lane_change needs traffic\.lane_changes: true"):
        still.command({"cav_1": Control(lane_change="left")})
    still.close()


def test_others_stop_for_a_body_that_is_put_across_the_road(ring):
    traffic = on_ring(ring, vehicle_count=3, cav_ranks=(0,), lane_changes=False, frame_count=3200)
    traffic.advance(300)
    lane = next(lane for lane in ring.lanes.values() if not lane.junction)
    at = len(lane.points) // 2
    poses = drive(traffic, 2800, {"cav_1": Control(pose=[*lane.points[at], float(lane.headings[at]) + np.pi / 2])})
    traffic.close()
    assert poses[-1, :3] == pytest.approx(lane.points[at])
    rest = traffic.poses[-20:, [traffic.names.index(name) for name in ("veh_001", "veh_002")]]
    assert (rest == rest[0]).all()  # both have come round and wait
    assert min_gap([replace(track, poses=track.poses[-20:]) for track in traffic.tracks], CATALOG) > 0.5


def test_others_stop_for_a_person_in_the_junction():
    """A body blocks the connections that it stands on; those who go elsewhere drive on."""
    cross = crossroad()
    asked = demand(cross, engine="sumo", cav_ranks=(0,), vehicle_count=10, frame_count=1300)
    plain, traffic = LiveTraffic(asked), LiveTraffic(asked)
    plain.advance(1300)
    drive(traffic, 1300, {"cav_1": Control(pose=[0.0, 0.0, 0.0, 0.3])})
    for one in (plain, traffic):
        one.close()
    stand = [(speeds(one.poses[-50:, k]) < 0.01).all() for one in (traffic, plain) for k in range(1, 10)]
    assert sum(stand[:9]) > sum(stand[9:]) + 1
    assert min_gap(traffic.tracks[1:], CATALOG) > 0.4


def test_steered_vehicle_leaves_sumo_and_is_seen(ring):
    traffic = on_ring(ring, vehicle_count=3)
    traffic.advance(300)
    drive(traffic, 300, {"cav_1": Control(steering_rad=0.0, acceleration_m_s2=-6.0)})
    with pytest.raises(InputError, match="has left its route"):
        traffic.command({"cav_1": Control(target_speed_m_s=3.0)})
    traffic.close()
    assert np.isfinite(traffic.poses).all()
    assert min_gap(traffic.tracks, CATALOG) > 0.4


def test_random_controls_leave_no_trace_of_nan_and_no_collision(ring):
    traffic, generator = on_ring(ring, frame_count=1010), np.random.default_rng(5)
    for _ in range(20):
        controls = {
            f"cav_{k}": Control(
                target_speed_m_s=float(generator.uniform(0, 15)),
                lane_change=(None, "left", "right")[int(generator.integers(3))],
            )
            for k in (1, 2, 3)
        }
        drive(traffic, 50, controls)
    traffic.close()
    assert np.isfinite(traffic.poses).all()
    assert min_gap(traffic.tracks, CATALOG) > 0.4


def test_control_of_the_wrong_actor_is_refused_and_steps_after_close_too(ring):
    traffic = on_ring(ring, vehicle_count=2, cav_ranks=(0,), frame_count=400)
    with pytest.raises(InputError, match="no such actor; there are cav_1"):
        traffic.command({"cav_1": Control(target_speed_m_s=0.0), "x": None})
    traffic.advance(10)
    traffic.close()
    traffic.close()
    with pytest.raises(InputError, match="SUMO has ended"):
        traffic.advance(100)
