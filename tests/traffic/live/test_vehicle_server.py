"""Vehicles of several episodes that one server drives: the rows of each alone, bit for bit, and faults told apart."""

import pickle
from functools import partial
from typing import Any

import numpy as np
import pytest

from mmw.core.errors import InputError
from mmw.traffic.demand import TrafficDemand
from mmw.traffic.live import vehicle_server
from mmw.traffic.live.control import Control
from mmw.traffic.live.live_engine import LiveEngine
from mmw.traffic.live.live_traffic import LiveTraffic, Started
from mmw.traffic.live.vehicle_server import Begun, Driven, Resume, Resumed, ServedVehicles, Start, VehicleServer
from mmw.traffic.roads.lane_graph import LaneGraph
from tests.fixtures.live_traffic import sedans_on
from tests.fixtures.traffic_towns import oval

ROWS = 3
"""Rows at the start, as a first frame 1 needs."""


@pytest.fixture(scope="module")
def ring() -> LaneGraph:
    """Return a one-way circuit of two lanes."""
    return oval()


def resume(server: VehicleServer, call: Resume) -> np.ndarray:
    """Return the pose of a vehicle that comes back."""
    (answer,) = server.answer([], pickle.loads(pickle.dumps([call])))
    if isinstance(answer, InputError):
        raise answer
    assert isinstance(answer, Resumed)
    return answer.pose


def begin(server: VehicleServer, asked: TrafficDemand, seeds: range) -> dict[int, tuple[ServedVehicles, LiveTraffic]]:
    """Return the served vehicles and the traffic of episodes, by seed, which is their key."""
    found = {}
    for seed, begun in zip(seeds, server.answer([], [Start(k, k, None, ROWS) for k in seeds]), strict=True):
        assert isinstance(begun, Begun)
        vehicles = ServedVehicles(seed, begun, partial(resume, server))
        traffic = LiveTraffic(asked.with_seed(seed), (), Started(vehicles, begun.people))
        traffic.advance(ROWS)
        found[seed] = vehicles, traffic
    return found


def told_by(traffic: LiveTraffic, name: str) -> str:
    """Add a vehicle without a pose, and return the error; an empty one if it is back."""
    try:
        traffic.add(name)
    except InputError as error:
        return str(error)
    return ""


def drawn(generator: np.random.Generator, names: list[str]) -> dict[str, Control | None]:
    """Return controls as somebody may give them in a row: of none, of one vehicle, or of two."""
    choices = (
        None,
        Control(target_speed_m_s=float(generator.uniform(0, 14))),
        Control(acceleration_m_s2=float(generator.uniform(-4, 3))),
        Control(acceleration_m_s2=1.0, lane_change="left"),
        Control(target_speed_m_s=9.0, lane_change="right"),
    )
    some = generator.choice(names, int(generator.integers(3)), replace=False).tolist()
    return {name: choices[int(generator.integers(len(choices)))] for name in some}


def test_rows_are_those_of_each_episode_alone(ring: LaneGraph) -> None:
    """Many controls fall into one decision, few later; a vehicle is steered, another one removed; both come back."""
    asked, seeds = sedans_on(ring, frame_count=700), range(5, 9)
    server = VehicleServer(pickle.loads(pickle.dumps(asked)))
    served, alone = begin(server, asked, seeds), {seed: LiveTraffic(asked.with_seed(seed)) for seed in seeds}
    generators, came = {seed: np.random.default_rng(seed) for seed in seeds}, 0
    for traffic in alone.values():
        traffic.advance(ROWS)
    for row in range(ROWS, 600):
        for seed in seeds:
            is_busy = row < 150 or generators[seed].random() < 0.03
            controls = drawn(generators[seed], served[seed][1].names[3:]) if is_busy else {}
            if row == 300 + seed:
                controls["cav_1"] = Control(steering_rad=0.02, acceleration_m_s2=-0.5)
            for traffic in (alone[seed], served[seed][1]):
                traffic.command(controls)
                if row == 400 + seed:
                    traffic.remove("cav_2")
                if row == 431:
                    traffic.remove("cav_1")
            for name in ("cav_1", "cav_2"):
                if row >= 450 + seed and name in alone[seed]._presence.absent:
                    told = [told_by(traffic, name) for traffic in (alone[seed], served[seed][1])]
                    assert told[0] == told[1]
                    came += not told[0]
        asking = [seed for seed in seeds if served[seed][0].must_ask]
        calls = [served[seed][0].ask(row, served[seed][1].seen) for seed in asking]
        for seed, driven in zip(asking, server.answer([], pickle.loads(pickle.dumps(calls))), strict=True):
            assert isinstance(driven, Driven)
            served[seed][0].take(driven)
        for seed in seeds:
            alone[seed].advance(row + 1)
            served[seed][1].advance(row + 1)
    for seed in seeds:
        assert served[seed][1].poses.tobytes() == alone[seed].poses.tobytes()
        assert served[seed][1].lane_changes == alone[seed].lane_changes
    assert sum(len(traffic.lane_changes) for traffic in alone.values()) >= 3 and came >= 6


@pytest.mark.parametrize("where", ["decision", "rows"])
def test_fault_of_an_episode_is_its_own_answer(ring: LaneGraph, where: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asked, seeds = sedans_on(ring, frame_count=400), range(3)
    server = VehicleServer(asked)
    served = begin(server, asked, seeds)
    while not served[0][0].must_ask:
        for _, traffic in served.values():
            traffic.advance(traffic.rows + 1)
    row, engine = served[0][1].rows, server._vehicles[1]._engine
    if where == "rows":
        engine.cars[2].stand_at(1e5)
    step = LiveEngine.step

    def fail(self: LiveEngine) -> None:
        if self is engine and where == "decision":
            raise ZeroDivisionError("a bug")
        step(self)

    monkeypatch.setattr(LiveEngine, "step", fail)
    answers = server.answer([], [served[seed][0].ask(row, served[seed][1].seen) for seed in seeds])
    assert isinstance(answers[1], ZeroDivisionError if where == "decision" else InputError)
    for seed in (0, 2):
        driven, traffic = answers[seed], LiveTraffic(asked.with_seed(seed))
        assert isinstance(driven, Driven)
        served[seed][0].take(driven)
        traffic.advance(row + 1)
        served[seed][1].advance(row + 1)
        assert served[seed][1].poses.tobytes() == traffic.poses.tobytes()


def test_fault_of_the_joint_evaluation_counts_for_all(ring: LaneGraph, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows that can be had of each episode alone, but not of both at once, tell of a fault: they are not used."""
    asked, seeds = sedans_on(ring, frame_count=40), range(2)
    server = VehicleServer(asked)
    both = begin(server, asked, seeds)
    rows_after = vehicle_server.rows_after

    def fail_for_two(vehicles: Any, row: int) -> Any:
        if len(vehicles) > 1:
            raise FloatingPointError("only together")
        return rows_after(vehicles, row)

    monkeypatch.setattr(vehicle_server, "rows_after", fail_for_two)
    calls = [vehicles.ask(traffic.rows, traffic.seen) for vehicles, traffic in both.values()]
    answers = server.answer([], calls)
    assert [str(answer) for answer in answers] == ["only together"] * 2


def test_episode_that_cannot_start_is_its_own_answer_and_a_forgotten_one_is_gone(
    ring: LaneGraph, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = sedans_on(ring)
    server, whole = VehicleServer(asked), TrafficDemand.with_seed

    def with_seed(self: TrafficDemand, seed: int, *fleet: Any) -> TrafficDemand:
        if seed == 4:
            raise InputError("no place is left")
        return whole(self, seed, *fleet)

    monkeypatch.setattr(TrafficDemand, "with_seed", with_seed)
    good, bad = server.answer([], [Start(0, 3, None, ROWS), Start(1, 4, None, ROWS)])
    assert isinstance(good, Begun) and isinstance(bad, InputError)
    assert list(server._vehicles) == [0]
    assert server.answer([0, 1], []) == [] and not server._vehicles
