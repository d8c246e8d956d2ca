"""Traffic lights: the plan, the phases of a junction's arms, and the reaction of drivers."""

from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest

from mmw.core.transforms import quaternion_to_ypr
from mmw.traffic.demand import TrafficResult
from mmw.traffic.idm.junctions import ConflictTable
from mmw.traffic.idm.simulation import simulate_idm
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.signals import ALL_RED, GREEN, make_plans, must_stop, signal_states, turns_left
from mmw.traffic.vehicle_pose import directions, make_shape
from mmw.worlds.towns.description import TownDescription
from mmw.worlds.towns.signal_phases import assign_phases
from tests.fixtures.traffic_measures import measure
from tests.fixtures.traffic_towns import CATALOG, SEDAN, crossroad, demand, surface, with_lights

PHASES = {"r0": "a", "r2": "a", "r1": "b", "r3": "b"}


@pytest.fixture(scope="module")
def lit() -> LaneGraph:
    """Return a crossroad with lights in the middle; its east and west arms share a phase."""
    return with_lights(crossroad(), "X", PHASES)


def run(graph: LaneGraph, **changes) -> TrafficResult:
    options = {"frame_count": 4000, "vehicle_count": 20, "seed": 1, "signals": True}
    return simulate_idm(demand(graph, **(options | changes)))


@pytest.mark.parametrize(
    ("degrees", "lanes_in", "phases"),
    [
        ([0, 90, 180, 270], [1, 1, 1, 1], "abab"),
        ([10, 95, 170, 280], [2, 1, 2, 1], "abab"),
        ([0, 90, 180], [2, 1, 2], "aba"),
        ([0, 90, 180], [1, 1, 0], "ab"),  # the third arm only leads away
        ([0, 72, 144, 216, 288], [1] * 5, "abcde"),  # 36 deg off the straight line
        ([0, 60, 110, 182, 270], [1] * 5, "abcac"),
        ([0, 90, 176, 184], [1] * 4, "abac"),  # the first of two equally good ones
    ],
)
def test_opposite_arms_share_a_phase(degrees, lanes_in, phases):
    found = assign_phases([float(np.radians(d)) for d in degrees], lanes_in)
    names = dict.fromkeys(phase for phase in found if phase)
    assert len(found) == len(degrees)
    letters = "".join(phases[: len(found)])
    for i, j in combinations(range(len(letters)), 2):
        assert (found[i] == found[j]) == (letters[i] == letters[j])
    assert list(names) == sorted(names)


def test_plan_gives_every_phase_its_turn(lit):
    plan = make_plans(lit, 3)["X"]
    time = np.arange(0.0, 300.0, 0.05)
    states = [plan.state(t) for t in time]
    share = {phase: np.mean([state[phase] == "green" for state in states]) for phase in plan.phases}
    cycle = 2 * (GREEN + plan.amber + ALL_RED)
    for phase in ("a", "b"):
        assert share[phase] == pytest.approx(GREEN / cycle, abs=0.03)
        shown = [state[phase] for state in states]
        changes = {(x, y) for x, y in pairwise(shown) if x != y}
        assert changes == {("green", "amber"), ("amber", "red"), ("red", "green")}
    for one, two in pairwise(states):
        assert sum(value != "red" for value in one.values()) <= 1  # never two at a time
        if one["a"] != "red" and two["a"] == "red":
            assert two["b"] == "red"  # all red in between
    assert signal_states(lit, 3, 12.3) == {"X": plan.state(12.3)}
    assert make_plans(lit, 4)["X"].offset != plan.offset
    assert make_plans(lit, 3) == {"X": plan}
    assert make_plans(crossroad(), 3) == {}


def test_amber_is_long_enough_for_drivers_that_cannot_stop(lit):
    fast = LaneGraph({name: replace(lane, speed=20.0) for name, lane in lit.lanes.items()})
    for graph in (lit, fast):
        plan = make_plans(graph, 0)["X"]
        for speed in np.linspace(1.0, max(lane.speed for lane in graph.lanes.values()), 40):
            away = max(d for d in np.arange(0.1, 120, 0.1) if not must_stop(d, speed))
            assert away / speed <= plan.amber + 1e-6


def entries(graph: LaneGraph, result: TrafficResult) -> list[tuple[int, str, int]]:
    """Return (vehicle, connection, frame) of every front bumper that reaches the start of a connection through X."""
    connections = [lane for lane in graph.lanes.values() if lane.signal]
    found = []
    for vehicle, track in enumerate(result.tracks):
        shape = make_shape(CATALOG[track.model])
        forward = directions(quaternion_to_ypr(track.poses[:, 3:])[:, 0])
        bumper = track.poses[:, :2] + (0.5 * shape.wheelbase + shape.front) * forward
        route = result.routes[track.name]
        for connection in connections:
            if connection.name not in route:
                continue
            (along,), way = directions(connection.headings[:1]), bumper - connection.points[0, :2]
            ahead, aside = way @ along, np.abs(way @ [-along[1], along[0]])
            crossed = (ahead[:-1] < 0) & (ahead[1:] >= 0) & (aside[1:] < 1.0) & (forward[1:] @ along > 0.9)
            found += [(vehicle, connection.name, int(frame)) for frame in np.flatnonzero(crossed)[:1]]
    return found


@pytest.mark.parametrize("seed", [1, 2])
def test_no_vehicle_enters_on_red_or_is_stuck(lit, seed):
    result = run(lit, seed=seed)
    plan = make_plans(lit, seed)["X"]
    seen = set()
    for _, connection, frame in entries(lit, result):
        shown = plan.state(frame / 100)[lit.lanes[connection].signal]
        seen.add(shown)
        assert shown != "red"
    assert "green" in seen and len(entries(lit, result)) > 6
    laws = measure(result.tracks, lit, surface(lit), CATALOG)
    assert laws.min_gap > 0.4 and laws.max_jerk < 9.0 and laws.stuck == 0 and laws.max_braking < 4.5
    assert laws.longest_stop > 5.0  # they do stop


def test_without_signals_lights_change_nothing(lit):
    dark = run(crossroad(), signals=False, frame_count=600)
    same = run(lit, signals=False, frame_count=600)
    for one, two in zip(dark.tracks, same.tracks, strict=True):
        np.testing.assert_array_equal(one.poses, two.poses)


def test_signals_need_lights():
    with pytest.raises(ValueError, match=r"signals = true: no junction of the town has traffic lights"):
        run(crossroad())


def test_left_turns_yield_to_oncoming_traffic(lit):
    """Left turns on green enter only if no vehicle straight on enters within the next 2 seconds."""
    table, lefts = ConflictTable(lit), 0
    for seed in range(3):
        found = entries(lit, run(lit, seed=seed))
        for vehicle, connection, frame in found:
            if not turns_left(lit.lanes[connection]):
                continue
            lefts += 1
            for other, across, later in found:
                is_straight = not turns_left(lit.lanes[across])
                conflicts = is_straight and table.last_conflict(connection, SEDAN, across, SEDAN) > -np.inf
                if other != vehicle and conflicts and lit.lanes[across].signal == lit.lanes[connection].signal:
                    assert not 0 <= later - frame < 200
    assert lefts > 5


def test_connections_of_one_phase_conflict_only_at_left_turns() -> None:
    from mmw.worlds.towns.network import build_network
    from tests.fixtures.road_towns import small_town

    town = small_town()
    town["nodes"] |= {"E": [160, 0, 0], "F": [80, -90, 0]}
    town["roads"] = [
        *town["roads"][:5],
        {"id": "be", "from": "B", "to": "E", "profile": "wide", "via": []},
        {"id": "bf", "from": "B", "to": "F", "profile": "street"},
        {"id": "ec", "from": "E", "to": "C", "profile": "wide", "via": [[160, 90, 20]]},
        {"id": "fe", "from": "F", "to": "E", "profile": "street", "via": [[160, -90, 20]]},
    ]
    town["props"] = {"signalled": ["B", "E"]}
    graph = build_network(TownDescription.model_validate(town)).lanes
    for node, count in (("B", 2), ("E", 2)):
        connections = [lane for lane in graph.lanes.values() if lane.junction == node]
        signals = {connection.signal for connection in connections}
        assert len(signals) == count and all(signals)
        table = ConflictTable(graph)
        for one, two in combinations(connections, 2):
            arms = {graph.predecessors[name][0].rsplit("_", 1)[0] for name in (one.name, two.name)}
            conflicts = len(arms) == 2 and table.last_conflict(one.name, SEDAN, two.name, SEDAN) > -np.inf
            if conflicts and one.signal == two.signal:
                assert turns_left(one) or turns_left(two)
    assert not any(lane.signal for lane in graph.lanes.values() if lane.junction not in ("B", "E"))
