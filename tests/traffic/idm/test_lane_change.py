"""Changes of lanes: decisions, lines, and motion without steps."""

from dataclasses import replace
from math import inf, sqrt

import numpy as np
import pytest

from mmw.core.transforms import quaternion_to_ypr
from mmw.traffic.demand import TrafficResult
from mmw.traffic.idm.driver import follow_leader
from mmw.traffic.idm.engine import IdmEngine
from mmw.traffic.idm.fleet import Fleet
from mmw.traffic.idm.lane_change import (
    LATERAL_ACCELERATION,
    POLITENESS,
    SAFE_BRAKING,
    AdjacentLanes,
    DesiredChange,
    LaneChanges,
    advantage,
    blend_share,
    blend_time,
)
from mmw.traffic.idm.simulation import record_steps, simulate_idm
from mmw.traffic.idm.vehicle import Car, Plan
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.traffic.spawn import DRIVER_FACTOR, SpawnPoint, Start
from mmw.traffic.vehicle_pose import follow_line, place_on_ground, sample_poses
from tests.fixtures.traffic_measures import measure
from tests.fixtures.traffic_towns import CATALOG, SEDAN, demand, oval, surface

DT = 0.01


@pytest.fixture(scope="module")
def circuit() -> LaneGraph:
    """Return a one-way circuit of two lanes."""
    return oval()


def make_fleet(graph: LaneGraph, seed: int = 0) -> Fleet:
    """Return a fleet of sedans for a minute."""
    return Fleet(demand(graph, catalog={"sedan": CATALOG["sedan"]}, seed=seed), 60.0)


def put(fleet: Fleet, lane: str, station: float, rank: int, top_speed: float = inf) -> Car:
    """Return a sedan on a lane that never goes faster than a speed."""
    point, generator = SpawnPoint(lane, station, (0.0, 0.0, 0.0)), np.random.default_rng(rank)
    car = fleet.add(Start(rank, point, False, generator.uniform(*DRIVER_FACTOR), 1.2, generator))
    car.plan.limit = [min(value, top_speed) for value in car.plan.limit]
    car.factor = 1.0
    return car


def refreshed(engine: IdmEngine) -> IdmEngine:
    """Return the engine after its cars were moved by hand."""
    engine.spans = engine._find_spans()
    engine.leaders = [engine._leader(index) for index in range(len(engine.cars))]
    return engine


def brute_follower(gap: float, speed: float, leader: float, desired: float, headway: float, time: float) -> tuple:
    """Return hardest braking [m/s^2] and least gap [m] of a follower behind a constant speed, by small Euler steps."""
    hardest, least = 0.0, gap
    for _ in range(round(time / DT)):
        target = 2.0 + max(0.0, speed * headway + speed * (speed - leader) / (2 * sqrt(1.8 * 2.0)))
        desired_acceleration = max(1.8 * (1 - (speed / desired) ** 4), -2.0) - 1.8 * (target / gap) ** 2
        hardest, least = max(hardest, -desired_acceleration), min(least, gap)
        gap += (leader - speed) * DT
        speed = max(0.0, speed + desired_acceleration * DT)
    return hardest, least


def test_safe_changes_never_make_the_follower_brake_hard(circuit):
    fleet = make_fleet(circuit)
    changes = LaneChanges(circuit, fleet.adjacent, fleet.change)
    generator = np.random.default_rng(3)
    me, slow, behind = put(fleet, "r0_f0", 90.0, 0), put(fleet, "r0_f0", 130.0, 1), put(fleet, "r0_f1", 40.0, 2)
    both, alone = IdmEngine(circuit, [me, slow, behind]), IdmEngine(circuit, [me, slow])
    lane, start = circuit.lanes["r0_f0"], behind.station
    accepted = refused = 0
    for _ in range(300):
        me.speed, slow.speed, behind.speed = generator.uniform((4, 0.5, 0), (12, 4, 13))
        behind.stand_at(start + generator.uniform(0, 44))
        if changes._consider(0, refreshed(alone), lane, "r0_f1") is None:
            continue  # it brings nothing, or does not fit
        desired = behind.desired_speed(behind.station)
        gap = me.rear - behind.front
        hardest, least = brute_follower(gap, behind.speed, me.speed, desired, behind.headway, 12.0)
        if changes._consider(0, refreshed(both), lane, "r0_f1") is not None:
            accepted += 1
            assert hardest < SAFE_BRAKING + 0.3 and least > 1.0
        else:
            refused += hardest > SAFE_BRAKING + 0.3
    assert accepted > 30 and refused > 30


def test_advantage_is_mobil(circuit):
    assert advantage((0.2, 1.0), (0.5, -0.3), (-1.0, 0.4)) == pytest.approx(0.8 + POLITENESS * (-0.8 + 1.4))
    assert follow_leader(8.0, 8.0, 1.2, inf, 0.0) == 0.0


def test_blend_keeps_the_lateral_limits():
    u = np.linspace(0, 1, 20001)
    w = blend_share(u)
    assert w[0] == 0 and w[-1] == pytest.approx(1)
    aside, time = 3.5, blend_time(3.5)
    lateral = np.diff(aside * w, 2) / (time * (u[1] - u[0])) ** 2
    assert np.abs(lateral).max() == pytest.approx(LATERAL_ACCELERATION, rel=1e-3)
    assert np.abs(lateral[[0, -1]]).max() < 1e-2  # no jump where the change begins and ends


def test_place_beside_on_concentric_arcs():
    angle = np.linspace(0, np.pi / 2, 60)
    circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    graph = LaneGraph({name: Lane(name, r * circle, 3.5, 10.0) for name, r in (("in", 30.0), ("out", 33.5))})
    station = np.linspace(1.0, 45.0, 40)
    across = AdjacentLanes(graph).across("in", "out", station)
    np.testing.assert_allclose(across, station * 33.5 / 30.0, atol=0.06)  # chords


def test_no_change_to_a_lane_that_ends_before(circuit):
    whole = circuit.lanes["r0_f1"]
    short = LaneGraph(dict(circuit.lanes) | {"r0_f1": replace(whole, points=whole.points[whole.points[:, 0] < 120.0])})
    for graph, expected in ((circuit, True), (short, False)):
        fleet = make_fleet(circuit)
        cars = [put(fleet, "r0_f0", 90.0, 0), put(fleet, "r0_f0", 130.0, 1)]
        engine = IdmEngine(graph, cars)
        cars[0].speed, cars[1].speed = 9.0, 3.0
        changes = LaneChanges(graph, AdjacentLanes(graph), fleet.change)
        found = changes._consider(0, refreshed(engine), graph.lanes["r0_f0"], "r0_f1")
        assert (found is not None) == expected


def change_of(fleet: Fleet, car: Car, row: int, length: float = 40.0) -> Plan:
    """Return the plan of a car that changes from r0_f0 to r0_f1 at a row."""
    plan = fleet.change(0, car, DesiredChange("r0_f1", row, length, 10.0, 1.0, 0.0), 0.0)
    assert plan is not None
    return plan


def test_new_line_keeps_what_was_driven_and_ends_on_the_new_lane(circuit):
    fleet = make_fleet(circuit)
    car = put(fleet, "r0_f0", 60.0, 0)
    old, row = car.plan, 14 * 10 + 900  # station 90 m
    new = change_of(fleet, car, row)
    np.testing.assert_array_equal(new.stance.columns[: row - 60], old.stance.columns[: row - 60])
    line = new.stance.track.line
    np.testing.assert_array_equal(line.points[: row + 1], old.stance.track.line.points[: row + 1])
    step = np.linalg.norm(np.diff(line.points[:, :2], axis=0), axis=1)
    assert step.max() < 0.1 + 1e-9 and step.min() > 0.0999 - 5e-4
    after = (line.station > 131.0) & (line.station < 250.0)
    lane = circuit.lanes["r0_f1"]
    np.testing.assert_allclose(line.points[after, 1], lane.points[0, 1], atol=1e-9)
    x = lane.points[0, 0] + line.station[after] - new.begins[1]
    np.testing.assert_allclose(line.points[after, 0], x, atol=1e-6)  # begins[1] puts marks where the car is
    assert line.lanes[:2] == ("r0_f0", "r0_f1") and line.lanes[2] in lane.successors


def test_poses_have_no_step_at_replanning(circuit):
    fleet = make_fleet(circuit)
    car = put(fleet, "r0_f0", 60.0, 0)
    station = 80.0 + 0.09 * np.arange(800)  # 9 m/s, past the whole change
    before = sample_poses(car.plan.stance, station)
    row = 14 * 10 + 900
    after = sample_poses(change_of(fleet, car, row).stance, station)
    driven = station < 90.0 - 6.0  # the front axle is 6 m before the place where the change begins
    np.testing.assert_allclose(after[driven], before[driven], atol=1e-8)
    assert np.abs(after[-1, :2] - before[-1, :2]).max() > 3.4
    position = after[:, :3]
    assert np.abs(np.diff(position, 3, axis=0) * 1e6).max() < 5.5
    assert np.abs(np.diff(position, 4, axis=0) * 1e8).max() < 100.0  # jerk is continuous: 1 m/s^3 a frame
    heading = np.unwrap(quaternion_to_ypr(after[:, 3:])[:, 0])
    assert np.abs(np.diff(heading, 2) * 1e4).max() < 0.6  # yaw acceleration [rad/s^2]
    track = follow_line(change_of(fleet, car, row).stance.track.line, SEDAN)
    fresh, _, why = place_on_ground(track, fleet.demand.ground, car.station)
    assert fresh is not None, why
    np.testing.assert_allclose(sample_poses(fresh, station), after, atol=1e-6)  # as if planned in one piece


def passing(graph: LaneGraph, changes: bool) -> tuple[np.ndarray, IdmEngine]:
    """Return stations of a slow sedan and three behind it at every step of 25 s [m], and the engine."""
    fleet = make_fleet(graph)
    cars = [put(fleet, "r0_f0", 180.0, 0, top_speed=2.0)]
    cars += [put(fleet, "r0_f0", 90.0 - 35.0 * k, k + 1) for k in range(3)]
    for car in cars:
        car.settled = 0.0  # no vehicle changes in the first seconds
    engine = IdmEngine(graph, cars, LaneChanges(graph, fleet.adjacent, fleet.change) if changes else None)
    return record_steps(engine, 500)[0], engine


def test_a_slow_vehicle_is_overtaken(circuit):
    free, engine = passing(circuit, True)
    held, _ = passing(circuit, False)
    assert engine.changes is not None and len(engine.changes.done) >= 2
    assert (free[-1] - free[0])[1:].sum() > 1.15 * (held[-1] - held[0])[1:].sum()
    assert (free[-1, 1:] > free[-1, 0]).any() and not (held[-1, 1:] > held[-1, 0]).any()
    for time, vehicle, before, after in engine.changes.done:
        assert time > 0 and vehicle > 0 and {before, after} in [{f"r{k}_f0", f"r{k}_f1"} for k in range(4)]
    first = round(engine.changes.done[0][0] / 0.05)
    assert first >= 120  # BETWEEN_CHANGES
    np.testing.assert_array_equal(free[: first + 1], held[: first + 1])  # up to the first decision nothing differs


def run(graph: LaneGraph, **options) -> TrafficResult:
    return simulate_idm(demand(graph, spawn_center_m=(150.0, 0.0, 0.0), **options))


def test_traffic_with_changes_obeys_the_laws(circuit):
    changes = 0
    for seed in range(4):
        found = run(circuit, frame_count=1500, vehicle_count=34, seed=seed)
        changes += len(found.changes)
        laws = measure(found.tracks, circuit, surface(circuit), CATALOG)
        assert laws.min_gap > 0.4 and laws.max_jerk < 9.0 and laws.departed == 0 and laws.stuck == 0
        assert laws.max_wheel_error < 0.02 and laws.max_lateral < 2.5 and laws.max_braking < 4.0
    assert changes >= 2


def test_same_seed_same_changes(circuit):
    options = {"frame_count": 1500, "vehicle_count": 34, "seed": 1}
    one, two = run(circuit, **options), run(circuit, **options)
    assert one.changes and one.changes == two.changes
    for a, b in zip(one.tracks, two.tracks, strict=True):
        np.testing.assert_array_equal(a.poses, b.poses)
    assert not run(circuit, **options, lane_changes=False).changes
