"""Live traffic: like a recording without controls, obedient with them, causal, and seen by others."""

from dataclasses import replace
from math import atan, cos, sin, tan

import numpy as np
import pytest

from mmw.core.constants import FRAME_DT, FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.core.kinematics import differentiate
from mmw.core.transforms import quaternion_to_ypr
from mmw.traffic.idm.simulation import STATION_SIGMA, simulate_idm
from mmw.traffic.live.causal import REACH, WEIGHTS, smooth_station
from mmw.traffic.live.control import Control
from mmw.traffic.live.idm_vehicles import IdmVehicles
from mmw.traffic.live.live_traffic import LiveTraffic
from mmw.traffic.live.obstacles import Body, LaneSamples
from mmw.traffic.roads.lane_graph import LaneGraph
from tests.fixtures.live_traffic import drive, sedans_on, speeds
from tests.fixtures.traffic_measures import measure, min_gap
from tests.fixtures.traffic_towns import CATALOG, crossroad, demand, oval, surface


@pytest.fixture(scope="module")
def cross() -> LaneGraph:
    """Return a crossroad inside a ring road."""
    return crossroad()


@pytest.fixture(scope="module")
def ring() -> LaneGraph:
    """Return a one-way circuit of two lanes."""
    return oval()


def test_weights_are_a_causal_low_pass_that_keeps_straight_lines():
    step = np.arange(-REACH, REACH + 1)
    assert WEIGHTS.sum() == pytest.approx(1.0, abs=1e-15) and WEIGHTS.min() > 0.0
    assert WEIGHTS @ step == pytest.approx(0.0, abs=1e-14)
    assert WEIGHTS @ step**2 == pytest.approx((STATION_SIGMA * FRAME_RATE_HZ) ** 2)  # that of a recording
    assert REACH == 24
    assert smooth_station((3.0 + 0.1 * step)[:, None])[0] == pytest.approx(3.0, abs=1e-14)
    assert smooth_station(np.full((len(step), 1), 123.456))[0] == 123.456


@pytest.mark.parametrize("town", ["cross", "ring"])
def test_without_controls_traffic_is_that_of_a_recording(town, request):
    """Within the limits of `test_traffic`, and as near as two low passes of one variance can be."""
    graph = request.getfixturevalue(town)
    asked = demand(graph, cav_ranks=(1, 4), frame_count=600)
    recorded, traffic = simulate_idm(asked).tracks, LiveTraffic(asked)
    traffic.advance(600)
    assert [track.name for track in traffic.tracks] == [track.name for track in recorded]
    poses = np.stack([track.poses for track in recorded], axis=1)
    # The low passes differ from the fourth order on: by at most 1.2 sigma^4 / 24 times the fourth derivative of the
    # station, which is a step of the jerk by 10 m/s^3 over an engine step: 2 mm.
    assert np.abs(traffic.poses[..., :3] - poses[..., :3]).max() < 0.002
    live, past = differentiate(traffic.poses), differentiate(poses)
    for name in ("acceleration", "body_rate"):
        assert np.abs(getattr(live, name)).max() < 1.01 * np.abs(getattr(past, name)).max()
    jerk, its_jerk = (np.linalg.norm(np.diff(rows[..., :3], n=3, axis=0), axis=2) for rows in (traffic.poses, poses))
    assert jerk.max() < 1.01 * its_jerk.max()
    found = measure(traffic.tracks, graph, surface(graph), CATALOG)
    assert found.min_gap > 0.4 and found.max_jerk < 9.0 and found.max_wheel_error < 0.02 and found.max_lateral < 2.5
    assert traffic.lane_changes == simulate_idm(asked).changes


def test_decisions_find_what_right_of_way_needs_prepared():
    """Boxes that vehicles sweep in junctions are computed at the start and in the rows between decisions."""
    traffic = LiveTraffic(demand(crossroad(), vehicle_count=12, frame_count=900))
    vehicles = traffic._vehicles
    assert isinstance(vehicles, IdmVehicles)
    sweeps, needed = vehicles._engine.table._sweeps, set()
    before = len(sweeps)
    for row in range(900):
        known, decides = len(sweeps), not vehicles._ready
        traffic.advance(row + 1)
        assert not decides or len(sweeps) == known, f"row {row}"
        needed |= {one.vehicle for one in vehicles._engine.reservations}
    assert len(needed) > 5 and len(sweeps) > before > 0


def test_same_controls_give_the_same_bytes_and_no_row_that_is_known_changes(ring):
    plain, first, second = (LiveTraffic(sedans_on(ring)) for _ in range(3))
    braking = {"cav_1": Control(acceleration_m_s2=-3.0)}
    for traffic in (plain, first, second):
        traffic.advance(203)
    for traffic in (first, second):
        traffic.command(braking)
    for traffic in (plain, first, second):
        traffic.advance(400)
    assert first.poses.tobytes() == second.poses.tobytes()
    differs = (first.poses != plain.poses).any(axis=(1, 2))
    row = int(np.argmax(differs))
    assert 203 <= row <= 203 + 6  # the next engine step reaches into a row within 60 ms
    # Half the control's way is done when the middle of the low pass has come to it: 0.24 s and at most 0.05 s later.
    # From there a jerk of 5 m/s^3 takes it 5 * 0.5^3 / 6 = 0.1 m away in 0.5 s.
    away = np.linalg.norm((first.poses - plain.poses)[:, 0, :2], axis=1)
    assert away[203 + 80] > 0.1


def test_acceleration_is_reached_and_held_and_others_brake(ring):
    traffic = LiveTraffic(sedans_on(ring, lane_changes=False))
    traffic.advance(300)
    now = speeds(drive(traffic, 10))[-1]
    poses = drive(traffic, 150, {"cav_1": Control(acceleration_m_s2=-1.5)})
    # The change takes 0.3 to 0.7 s at a jerk of 5 m/s^3; the low pass begins up to 0.05 s later and is 0.49 s long.
    assert np.diff(speeds(poses))[125:] / FRAME_DT == pytest.approx(-1.5, abs=1e-6)
    drive(traffic, 600, {"cav_1": Control(acceleration_m_s2=-6.0)})
    assert now > 5.0
    standing = drive(traffic, 300)[-50:]
    assert (standing == standing[0]).all()  # exactly
    assert min_gap(traffic.tracks, CATALOG) > 1.0
    behind = [speeds(traffic.poses[-50:, column]).max() for column in range(len(traffic.names))]
    assert sum(speed < 0.01 for speed in behind) >= 2  # a queue
    moving = drive(traffic, 300, {"cav_1": Control()})
    assert speeds(moving)[-1] > 2.0  # its driver is back


def test_target_speed_is_kept_and_lower_limits_win(ring):
    traffic = LiveTraffic(sedans_on(ring, vehicle_count=3, lane_changes=False))
    traffic.advance(300)
    poses = drive(traffic, 600, {"cav_1": Control(target_speed_m_s=4.0)})
    assert speeds(poses)[-1] == pytest.approx(4.0, abs=0.01)
    fast = speeds(drive(traffic, 500, {"cav_1": Control(target_speed_m_s=60.0)}))
    assert 5.0 < fast.max() < max(lane.speed for lane in ring.lanes.values()) + 0.1


def test_lane_change_happens_once_when_asked(ring):
    traffic = LiveTraffic(sedans_on(ring, vehicle_count=3))
    traffic.advance(300)
    own = [change for change in traffic.lane_changes if change[1] == "cav_1"]
    side = None
    for option in ("left", "right"):
        drive(traffic, 500, {"cav_1": Control(target_speed_m_s=8.0, lane_change=option)})  # others beside it pass
        found = [change for change in traffic.lane_changes if change[1] == "cav_1"]
        if len(found) > len(own):
            side = option
            break
    assert side is not None and len(found) == len(own) + 1
    _, _, lane, other = found[-1]
    assert getattr(ring.lanes[lane], side) == other
    assert measure(traffic.tracks, ring, surface(ring), CATALOG).max_offset < 1.8


def test_others_stop_for_a_body_that_is_put_across_the_road(ring):
    traffic = LiveTraffic(sedans_on(ring, vehicle_count=3, cav_ranks=(0,), lane_changes=False, frame_count=3200))
    traffic.advance(300)
    lane = next(lane for lane in ring.lanes.values() if not lane.junction)
    middle = lane.points[len(lane.points) // 2]
    heading = float(lane.headings[len(lane.points) // 2]) + np.pi / 2
    drive(traffic, 2800, {"cav_1": Control(pose=[*middle, heading])})
    pose = traffic.poses[-1, traffic.names.index("cav_1")]
    assert pose[:3] == pytest.approx(middle) and quaternion_to_ypr(pose[3:])[0] == pytest.approx(
        heading - 2 * np.pi, abs=7
    )
    rest = traffic.poses[-20:, [traffic.names.index(name) for name in ("veh_001", "veh_002")]]
    assert (rest == rest[0]).all()  # both have come round and wait
    assert min_gap([replace(track, poses=track.poses[-20:]) for track in traffic.tracks], CATALOG) > 0.5


def test_steered_vehicle_drives_the_circle_of_its_wheels():
    """Kinematic bicycle: a point midway between the axles is on a circle of radius L / (tan d cos b)."""
    graph = crossroad()
    traffic = LiveTraffic(demand(graph, (surface(graph)), vehicle_count=2, cav_ranks=(0,), frame_count=1200))
    traffic.advance(300)
    steer = 0.3
    drive(traffic, 200, {"cav_1": Control(steering_rad=steer, acceleration_m_s2=-6.0)})
    drive(traffic, 100, {"cav_1": Control(steering_rad=steer, acceleration_m_s2=1.0)})
    poses = drive(traffic, 300, {"cav_1": Control(steering_rad=steer)})
    model = CATALOG[traffic.tracks[0].model]
    slip = atan(0.5 * tan(steer))
    radius = model.wheelbase / (tan(steer) * cos(slip))
    a, b, c = (complex(*poses[row, :2]) for row in (0, 120, 260))
    w = (c - a) / (b - a)
    center = (b - a) * (w - abs(w) ** 2) / (2j * w.imag) + a
    assert abs(a - center) == pytest.approx(radius, rel=1e-3)
    turn = np.diff(np.unwrap(quaternion_to_ypr(poses[:, 3:])[:, 0])) / FRAME_DT
    assert turn == pytest.approx(speeds(poses) * cos(slip) * tan(steer) / model.wheelbase, rel=1e-3)
    assert abs(sin(slip)) > 0.1


def test_random_controls_leave_no_trace_of_nan_and_no_collision(ring):
    """Drivers keep to gaps whatever speed and lane they are told."""
    traffic, generator = LiveTraffic(sedans_on(ring, frame_count=1010)), np.random.default_rng(5)
    for _ in range(20):
        controls = {
            f"cav_{k}": Control(
                target_speed_m_s=float(generator.uniform(0, 15)),
                lane_change=(None, "left", "right")[int(generator.integers(3))],
            )
            for k in (1, 2, 3)
        }
        drive(traffic, 50, controls)
    assert np.isfinite(traffic.poses).all()
    assert min_gap(traffic.tracks, CATALOG) > 0.4


@pytest.mark.slow
@pytest.mark.parametrize(("town", "seed"), [("cross", 7), ("cross", 8), ("ring", 3), ("ring", 4)])
def test_whatever_some_do_the_others_never_collide(town, seed, request):
    """A thousand steps of random controls: accelerations without regard, speeds, lanes, steering, and a pose.

    Seeds are those with collisions, so that there is something to be kept out of.
    """
    graph, generator = request.getfixturevalue(town), np.random.default_rng(seed)
    count = 16 if town == "cross" else 12
    asked = demand(graph, cav_ranks=(0, 2, 4, 6, 8), vehicle_count=count, frame_count=1010, seed=seed)
    traffic, lane = LiveTraffic(asked), next(lane for lane in graph.lanes.values() if not lane.junction)
    traffic.advance(3)
    for step in range(1000):
        controls = {}
        if step % 25 == 0:
            controls = {name: random_control(generator) for name in ("cav_1", "cav_2", "cav_3")}
        if step > 200 and step % 10 == 0:
            steer, push = generator.uniform([-0.5, -2.0], [0.5, 2.0])
            controls["cav_4"] = Control(steering_rad=float(steer), acceleration_m_s2=float(push))
        if step == 500:
            controls["cav_5"] = Control(pose=[*lane.points[len(lane.points) // 2], float(generator.uniform(-3.0, 3.0))])
        traffic.command(controls)
        traffic.advance(traffic.rows + 1)
    assert np.isfinite(traffic.poses).all()
    assert min_gap(traffic.tracks, CATALOG) == 0.0
    assert min_gap([track for track in traffic.tracks if track.role != "cav"], CATALOG) > 0.4


def random_control(generator: np.random.Generator) -> Control | None:
    """Return any control of a vehicle on its route, or none."""
    lane = (None, "left", "right")[int(generator.integers(3))]
    return (
        None,
        Control(acceleration_m_s2=float(generator.uniform(-6.0, 6.0)), lane_change=lane),
        Control(target_speed_m_s=float(generator.uniform(0.0, 15.0)), lane_change=lane),
    )[int(generator.integers(3))]


def test_vehicle_that_enters_a_junction_without_leave_holds_up_others(cross):
    """It takes the connections that it crosses, and others still miss each other."""
    traffic = LiveTraffic(demand(cross, cav_ranks=(0,), vehicle_count=14, frame_count=1200))
    drive(traffic, 1100, {"cav_1": Control(acceleration_m_s2=0.3)})
    assert np.isfinite(traffic.poses).all()
    assert min_gap(traffic.tracks[1:], CATALOG) > 0.4


@pytest.mark.parametrize(
    ("control", "text"),
    [
        ({"acceleration_m_s2": float("nan")}, "acceleration_m_s2 = nan"),
        ({"acceleration_m_s2": 7}, "from -6 to 6"),
        ({"target_speed_m_s": -1}, "from 0 to 70"),
        ({"target_speed_m_s": "fast"}, "target_speed_m_s = fast"),
        ({"steering_rad": float("inf")}, "steering_rad = inf"),
        ({"lane_change": "up"}, "left, right or None"),
        ({"pose": [0, 0, 0]}, "seven finite numbers"),
        ({"pose": [0, 0, np.nan, 0]}, "seven finite numbers"),
        ({"pose": [0, 0, 0, 0, 0, 0, 0]}, "seven finite numbers"),
        ({"pose": [0, 0, 0, 0], "steering_rad": 0.1}, "exclude each other"),
        ({"target_speed_m_s": 3, "acceleration_m_s2": 1}, "exclude each other"),
    ],
)
def test_control_that_cannot_be_is_refused(control, text):
    with pytest.raises(InputError, match=text):
        Control(**control)


def test_control_of_the_wrong_actor_is_refused_and_changes_nothing(ring):
    asked = sedans_on(ring, vehicle_count=3, frame_count=400, lane_changes=False)
    traffic, plain = LiveTraffic(asked), LiveTraffic(asked)
    for bad, text in (
        ({"cav_9": Control()}, "no such actor; there are cav_1"),
        ({"cav_1": Control(target_speed_m_s=0.0), "x": None}, "no such actor"),
        ({"cav_1": 3.0}, "mmw.Control or None"),
        ({"cav_1": Control(lane_change="left")}, "lane_change needs traffic.lane_changes: true"),
    ):
        with pytest.raises(InputError, match=text):
            traffic.command(bad)
    traffic.advance(400)
    plain.advance(400)
    assert traffic.poses.tobytes() == plain.poses.tobytes()
    with pytest.raises(InputError, match="longer frame_count"):
        traffic.advance(401)


def test_vehicle_off_its_route_has_no_driver(ring):
    traffic = LiveTraffic(sedans_on(ring, vehicle_count=3, frame_count=400))
    traffic.advance(10)
    drive(traffic, 10, {"cav_1": Control(steering_rad=0.0)})
    with pytest.raises(InputError, match="has left its route"):
        traffic.command({"cav_1": Control(target_speed_m_s=3.0)})
    with pytest.raises(InputError, match="no route to go back to"):
        traffic.command({"cav_1": None})


def test_engine_without_steps_is_refused(ring):
    with pytest.raises(InputError, match="mode live steps the engines idm and sumo; change engine"):
        LiveTraffic(demand(ring, engine="replay", trajectories="drive.csv"))


def test_body_blocks_the_lane_it_stands_on_and_none_above_it(ring):
    samples, lane = LaneSamples(ring), next(iter(ring.lanes.values()))
    at = len(lane.points) // 2
    x, y, z = lane.points[at]
    heading = float(lane.headings[at])
    velocity = (3.0 * cos(heading), 3.0 * sin(heading))
    found = samples.blocked(Body((x, y, z), heading, velocity, (2.0, 0.9)))
    assert list(found) == [lane.name]
    span, station = found[lane.name], lane.plan_station[at]
    assert span.rear == pytest.approx(station - 2.0 - 1.15, abs=0.6)  # samples are 0.5 m apart
    assert span.front == pytest.approx(station + 2.0 + 1.15, abs=0.6)
    assert span.speed == pytest.approx(3.0, abs=0.01)
    assert samples.blocked(Body((x, y, z + 5.0), heading, velocity, (2.0, 0.9))) == {}
